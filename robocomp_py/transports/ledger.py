"""What a receiver has seen of its senders, by the sequence numbers of their headers. Pure."""

from __future__ import annotations

from collections import OrderedDict

from .base import Statistics

SENDERS = 1024
"""Of so many senders, the most recently heard ones, a ledger remembers the numbers."""

WINDOW = 256
"""A number so far behind the highest one counts as seen."""


class Ledger:
    """Counts what was lost and repeated. Senders number the messages of a link from 1, without gaps.

    With `ordered`, messages of a sender arrive in order, so a gap is a loss. Without, several may
    be on their way at once, and only repetitions can be told.
    """

    def __init__(self, stats: Statistics, *, ordered: bool) -> None:
        self._stats, self._ordered = stats, ordered
        self._seen: OrderedDict[int, tuple[int, set[int]]] = OrderedDict()

    def admit(self, sender: int, sequence: int) -> bool:
        """Note a message; False if it was seen before. What precedes the first one heard is no loss."""
        known = self._seen.get(sender)
        if known is None:
            if len(self._seen) >= SENDERS:
                self._seen.popitem(last=False)
            self._seen[sender] = sequence, {sequence}
            return True
        highest, recent = known
        if sequence in recent or sequence <= highest - WINDOW or (self._ordered and sequence <= highest):
            self._stats.repeated += 1
            return False
        if self._ordered:
            self._stats.lost += sequence - highest - 1
            recent = set()
        elif len(recent) >= 2 * WINDOW:
            recent = {number for number in recent if number > highest - WINDOW}
        recent.add(sequence)
        self._seen[sender] = max(highest, sequence), recent
        self._seen.move_to_end(sender)
        return True
