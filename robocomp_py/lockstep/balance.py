"""Whether all messages that were sent have been handled, from the counters of all components. Pure."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..wire import names
from .RoboCompLockstep import Counter, Report, Way

Place = tuple[str, int]
"""An instance, and the number of one of its counters."""

Numbers = Mapping[str, Sequence[int]]
"""The numbers of each instance, in the order of its counters."""


class State(NamedTuple):
    """How a component is at an instant."""

    due: int
    """When it has something to do next, in ns."""
    settled: bool
    """Whether all its threads wait."""
    version: int
    """Another one when its counters are others, or the component was restarted."""
    numbers: tuple[int, ...]
    """In the order of its counters."""
    made: int = 0
    """Calls of others that it has made so far. Their handlers may have sent something."""

    @classmethod
    def of(cls, report: Report) -> State:
        return cls(report.due, report.settled, report.version, tuple(report.numbers.tolist()), report.calls)

    def report(self) -> Report:
        """The same, as it travels."""
        return Report(self.due, self.settled, self.version, self.made, np.array(self.numbers, np.int64))


@dataclass
class Flow:
    """Messages of some senders to some receivers. Equal numbers, but for an offset, mean that none is under way."""

    channel: str
    senders: Sequence[Place]
    receivers: Sequence[Place]
    offset: int = 0

    @property
    def is_of_calls(self) -> bool:
        return False

    @property
    def concerned(self) -> Sequence[Place]:
        """Whose numbers change when a message under way arrives."""
        return self.receivers

    def under_way(self, numbers: Numbers) -> int:
        """How many messages are not handled yet. Negative if more were handled, as by a late subscriber."""
        return _sum(self.senders, numbers) + self.offset - _sum(self.receivers, numbers)

    def level(self, numbers: Numbers) -> None:
        """Count no message as under way at these numbers."""
        self.offset -= self.under_way(numbers)


@dataclass
class Calls(Flow):
    """Calls in progress. A call is under way if no server executes it, or if its end has not reached the client."""

    @property
    def is_of_calls(self) -> bool:
        return True

    @property
    def concerned(self) -> Sequence[Place]:
        return [*self.receivers, *self.senders]

    def under_way(self, numbers: Numbers) -> int:
        return max(0, _sum(self.senders, numbers) - _sum(self.receivers, numbers))

    def level(self, numbers: Numbers) -> None:
        """Without effect: a call ends by itself."""


class Balance:
    """The flows between some components."""

    def __init__(self, counters: Mapping[str, Sequence[Counter]]) -> None:
        self.flows = [*_topics(counters), *_commands_and_calls(counters)]

    @property
    def receivers(self) -> set[str]:
        """The instances to which others send something."""
        return {
            name for flow in self.flows for name, _ in flow.receivers if any(name != each for each, _ in flow.senders)
        }

    def under_way(self, numbers: Numbers) -> list[Flow]:
        """The flows with messages that are not handled yet."""
        return [flow for flow in self.flows if flow.under_way(numbers) > 0]

    def ahead(self, numbers: Numbers) -> list[Flow]:
        """The flows of which more messages were handled than sent, as far as these numbers tell."""
        return [flow for flow in self.flows if flow.under_way(numbers) < 0]

    def take_over(self, before: Balance, numbers: Numbers) -> None:
        """Go on with the messages of an earlier balance, although senders have come or gone meanwhile.

        What was sent by a sender that is gone is under way until it is handled. `numbers` has those of all components
        but those that were restarted: their messages count anew.
        """
        earlier = {tuple(flow.receivers): flow for flow in before.flows if not flow.is_of_calls}
        for flow in self.flows:
            if not flow.is_of_calls and (known := earlier.get(tuple(flow.receivers))):
                gone = [each for each in known.senders if each not in flow.senders]
                new = [each for each in flow.senders if each not in known.senders]
                if all(name in numbers for name, _ in (*gone, *flow.senders, *flow.receivers)):
                    flow.offset = known.offset + _sum(gone, numbers) - _sum(new, numbers)

    def level(self, numbers: Numbers, *, all: bool = False) -> None:
        """Forget messages that were handled without having been counted; with `all`, also those that are missing."""
        for flow in self.flows:
            if all or flow.under_way(numbers) < 0:
                flow.level(numbers)


def _topics(counters: Mapping[str, Sequence[Counter]]) -> Iterator[Flow]:
    publishers = [
        (counter.channels[0], (name, number))
        for name, every in counters.items()
        for number, counter in enumerate(every)
        if counter.way is Way.Publishes and counter.channels
    ]
    for name, every in counters.items():
        for number, counter in enumerate(every):
            if counter.way is Way.Hears and counter.channels:
                senders = [
                    place
                    for channel, place in publishers
                    if place[0] != name and any(names.matches(pattern, channel) for pattern in counter.channels)
                ]
                yield Flow(counter.channels[0], senders, [(name, number)])


def _commands_and_calls(counters: Mapping[str, Sequence[Counter]]) -> Iterator[Flow]:
    """One flow for each operation, over all its servers, since a client may not have chosen one of them."""
    places: defaultdict[tuple[Way, str], list[Place]] = defaultdict(list)
    for name, every in counters.items():
        for number, counter in enumerate(every):
            if counter.channels:
                places[counter.way, "/".join(counter.channels[0].split("/")[-2:])].append((name, number))
    for (way, operation), receivers in places.items():
        if way is Way.Takes:
            yield Flow(operation, places.get((Way.Sends, operation), ()), receivers)
        elif way is Way.Serves:
            yield Calls(operation, places.get((Way.Calls, operation), ()), receivers)


def _sum(places: Sequence[Place], numbers: Numbers) -> int:
    return sum(numbers[name][number] for name, number in places if number < len(numbers[name]))
