"""What a receiver has seen of its senders, by the sequence numbers of their headers. Pure."""

from __future__ import annotations

from collections import OrderedDict

from .base import Statistics

SENDERS = 1024
"""Of so many senders, the most recently heard ones, a ledger remembers the numbers."""

WINDOW = 1024
"""So many numbers of a sender that have been skipped a ledger remembers; older ones count as seen."""

_EARLIER = 64
"""Of a sender that is first heard in mid-stream, so many earlier messages may still be on their way."""


class Ledger:
    """Counts what was lost and repeated. Senders number the messages of a link from 1, without gaps.

    With `ordered`, messages of a sender arrive in order, so a gap is a loss. Without, several may
    be on their way at once, and only repetitions can be told: what comes late is new if its number
    was skipped. However late that is; but only the last WINDOW skipped numbers are remembered, and
    of a message that may or may not have been seen it is said that it was, since nothing must be
    executed twice.
    """

    def __init__(self, stats: Statistics, *, ordered: bool) -> None:
        self._stats, self._ordered = stats, ordered
        self._seen: OrderedDict[int, tuple[int, dict[int, None]]] = OrderedDict()
        """Of each sender the highest number, and those below it that were skipped, in their order."""
        self._latest: int | None = None
        """Who was heard last, and so is the last of these."""

    def admit(self, sender: int, sequence: int) -> bool:
        """Note a message; False if it was seen before. What precedes the first one heard is no loss."""
        known = self._seen.get(sender)
        if known is None:
            if len(self._seen) >= SENDERS:
                self._seen.popitem(last=False)
            self._seen[sender] = sequence, {} if self._ordered else _between(max(0, sequence - _EARLIER), sequence)
            self._latest = sender
            return True
        highest, skipped = known
        if sequence > highest:
            if self._ordered:
                if sequence != highest + 1:
                    self._stats.lost += sequence - highest - 1
            elif sequence > highest + 1:
                skipped |= _between(highest, sequence)
                while len(skipped) > WINDOW:
                    del skipped[next(iter(skipped))]
            self._seen[sender] = sequence, skipped
        elif sequence in skipped:
            del skipped[sequence]
        else:
            self._stats.repeated += 1
            return False
        if sender != self._latest:
            self._seen.move_to_end(sender)
            self._latest = sender
        return True


def _between(low: int, high: int) -> dict[int, None]:
    """The last WINDOW numbers between two."""
    return dict.fromkeys(range(max(low + 1, high - WINDOW), high))
