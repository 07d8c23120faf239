"""Detects lost and repeated messages by the sequence numbers in their headers. Pure."""

from __future__ import annotations

from collections import OrderedDict

from .base import Statistics

SENDERS = 1024
"""Maximum number of senders that a ledger remembers: those of the latest messages."""

WINDOW = 1024
"""Maximum number of skipped sequence numbers that a ledger remembers per sender; older ones count as seen."""

_EARLIER = 64
"""Numbers before the first message of a sender that may still arrive."""


class Ledger:
    """Counts what was lost and repeated. Senders number the messages of a link from 1, without gaps.

    With `ordered`, messages of a sender arrive in order, so a gap is a loss. Without, they may overtake
    each other, and only repetitions are detected: a late message is new if its number was skipped.
    The last WINDOW skipped numbers are remembered. An older number counts as seen, since no request
    may be executed twice.
    """

    def __init__(self, stats: Statistics, *, ordered: bool) -> None:
        self._stats, self._ordered = stats, ordered
        self._seen: OrderedDict[int, tuple[int, dict[int, None]]] = OrderedDict()
        """By sender: the highest number, and the skipped numbers below it, in order."""
        self._latest: int | None = None
        """The sender of the latest message, which is the last key of `_seen`."""

    def knows(self, sender: int) -> bool:
        """Whether a message of this sender was noted, and not so many others since that it is forgotten."""
        return sender in self._seen

    def admit(self, sender: int, sequence: int) -> bool:
        """Note a message; False if it was seen before. Numbers before the first message count as no loss."""
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
    """The numbers between two, at most the last WINDOW."""
    return dict.fromkeys(range(max(low + 1, high - WINDOW), high))
