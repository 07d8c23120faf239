"""The followers of a clock, each of which passes a question on to the next, so that the leader asks only the first.

A follower passes a step on if nothing is new but when it is due: if it is settled, and its counters stand as when it
last answered the leader. Otherwise it answers, since the leader may have to wait until messages are handled. So the
order of steps, and what happens between them, is the same as if the leader asked each of them.

    leader ─step─▶ first ─step, due─▶ second ─step, dues─▶ third ─answer, dues─▶ leader

The leader connects two neighbours by a pair of sockets, which it sends to them. If a follower is killed, or does not
answer, the leader asks each one by itself, and connects those that are left.
"""

from __future__ import annotations

import select
import time
from collections.abc import Sequence

from ..errors import Timeout
from .line import STEP, Answer, Line

LONGEST = 1000
"""Maximum number of followers that a question passes."""

_DEADLINE = 0.5
"""Seconds for a question to all of them. Then the leader asks each one, which tells the one that does not answer."""


class Chain:
    """The lines of followers that are connected, in their order. Used by one thread."""

    def __init__(self, lines: Sequence[Line]) -> None:
        self._lines = {line.fileno(): line for line in lines}
        self._poll = select.poll()
        for number in self._lines:
            self._poll.register(number, select.POLLIN)

    def step(self, first: Line, hops: int, now: int) -> Answer:
        """Ask the first one, whose question is passed on so often. Raises Timeout, or Unreachable if one is gone.

        The answer is that of the last one, or of an earlier one that has news.
        """
        end = time.monotonic() + _DEADLINE
        number = first.send(STEP, now, hops)
        while ready := self._poll.poll(max(0.0, end - time.monotonic()) * 1000):
            for each, _ in ready:
                answer = self._lines[each].receive()
                if answer.number == number:  # else it is one that came too late
                    return answer
        raise Timeout(f"no answer for {_DEADLINE:g} s")
