"""Answers the queries of a recording: each with the newest response that was recorded until then.

A client waits until all operations of an interface are there. So those that were not recorded are there, too: queries
fail, and commands are discarded. An interface without recorded queries is not served, and a message says so.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from ...contract import told
from ...contract.interface import Operation, Pattern
from ...errors import DecodeError, RobocompError
from ...transports.base import Link
from ...wire import names
from ..access import Access
from ..announced import OWN
from ..network import End, Network
from ..recording.calls import CALLS, INFO
from ..recording.reader import RecordedTopic, Recording, named
from .choice import Remap, under_its_name

_STATUS = [each.name for each in INFO.fields].index("status")


@dataclass
class Answer:
    """A query that is answered."""

    topic: RecordedTopic
    """Of its calls."""
    channel: str
    """Under which it is served."""
    operation: Operation[Any] = field(repr=False)
    answered: int = 0
    """Calls."""
    ways: dict[str, Link] = field(default_factory=dict, repr=False)
    """By the middlewares over which it is served."""


def answers_of(recording: Recording, only: Sequence[str], remaps: Iterable[Remap]) -> list[Answer]:
    """The queries of a recording that can be answered. Raises RecordingError if it does not have what is named."""
    wanted = {topic for name in only for topic in named(recording, name)}
    remaps, found = list(remaps), []
    for name, topic in recording.topics.items():
        is_query = topic.called is not None and topic.metadata.get("calls") == Pattern.QUERY
        if topic.called is not None and is_query and (not only or name in wanted):
            channel = name.removesuffix(CALLS)
            for each in remaps:
                channel = each.applied(channel)
            found.append(Answer(topic, channel, under_its_name(topic.called, channel)))
    return found


def servers(answers: Iterable[Answer], network: Network) -> list[str]:
    """What serves these queries now, for people."""
    found = []
    for channel in dict.fromkeys(each.channel for each in answers):
        there = network.channels.get(channel)
        serving = {(each.told.owner, each.told.pid): None for each in there.providers} if there else {}
        found += [f"{channel} is served by {owner or 'a program'} (process {pid}) now" for owner, pid in serving]
    return found


class Answers:
    """Serves queries over each middleware by which something calls them. `look` and `note` belong to one thread each.

    Their links end with `access`.
    """

    def __init__(
        self, access: Access, answers: Sequence[Answer], tell: Callable[[str], object], *, always: Sequence[str] = ()
    ) -> None:
        """`tell` gets messages for people. Over middlewares in `always`, queries are served in any case."""
        self._access, self._tell, self._always = access, tell, always
        self._answers = answers
        self._by_topic = {each.topic.name: each for each in answers}
        self._decoders = {each.topic.name: each.topic.decoder() for each in answers}
        self._responses: dict[str, tuple[Any, ...]] = {}
        """By topic."""
        self._counting = threading.Lock()
        self._queries: list[str] = []
        self._told: set[str] = set()
        self._refused: set[tuple[str, str]] = set()
        """Channels that nothing was recorded of, with the middlewares over which they are there."""

    @property
    def queries(self) -> list[str]:
        """The channels of the queries that it serves now, also of those that fail."""
        return list(self._queries)

    def begin(self, recording: Recording, start: int, end: int | None) -> None:
        """Answer as at this time of the recording; before the first response, with that. Raises RecordingError."""
        for message in recording.messages(list(self._by_topic), None, start):
            self.note(message.topic.name, message.data)
        for name in self._by_topic:
            for message in recording.messages([name], start, end) if name not in self._responses else ():
                self.note(name, message.data)
                if name in self._responses:
                    break

    def note(self, topic: str, data: bytes) -> bool:
        """A recorded call is due: from now on its response is the answer. False if this is no topic of calls."""
        if topic not in self._by_topic:
            return False
        try:
            info, _, response = self._decoders[topic](data)
        except DecodeError as exc:
            self._complain(topic, f"a call of {topic} does not fit its contract: {exc}")
            return True
        if info[_STATUS] == "ok" and response:
            self._responses[topic] = tuple(response[0])
        return True

    def look(self, network: Network) -> bool:
        """Serve what is called. Whether something calls any of the queries."""
        is_called = False
        for each in self._answers:
            called = [
                end
                for end in network.ends
                if end.role == "calls"
                and names.matches(end.told.channel, each.channel)
                and end.told.fingerprint in (0, each.operation.fingerprint)
            ]
            is_called = is_called or bool(called)
            for middleware in dict.fromkeys([*self._always, *(end.middleware for end in called)]):
                if middleware not in each.ways:
                    self._serve(each, middleware)
        if is_called:
            self._complete(network)
        self._tell_unanswered(network)
        return is_called

    def _tell_unanswered(self, network: Network) -> None:
        """Tell once of each interface that is called, and neither recorded nor served."""
        ports = dict.fromkeys(each.channel.rpartition("/")[0] for each in self._answers)
        queries = [each for each in network.channels.values() if each.pattern is Pattern.QUERY and each.providers]
        for end in network.ends if ports else ():
            port, _, operation = end.told.channel.rpartition("/")
            if end.role != "calls" or port in self._told or names.segment(end.told.channel) in OWN:
                continue
            there = [*(f"{each}/{operation}" for each in ports), *(each.name for each in queries)]
            if not any(names.matches(end.told.channel, each) for each in there):
                owner = end.told.owner or "a program"
                what = port.removeprefix(f"{names.ANY}/")
                self._complain(port, f"{what} is not served: {owner} calls it, and no query of it was recorded")

    def _complete(self, network: Network) -> None:
        """Be there for what else clients need of the same interfaces."""
        ports = dict.fromkeys(each.channel.rpartition("/")[0] for each in self._answers)
        served = {each.channel for each in self._answers}
        for end in network.ends:
            used = end.told.channel
            for channel in (f"{port}/{names.operation(used)}" for port in ports):
                is_needed = end.role in ("calls", "commands") and channel not in served and names.matches(used, channel)
                if is_needed and (channel, end.middleware) not in self._refused:
                    self._refused.add((channel, end.middleware))
                    self._refuse(channel, end)

    def _refuse(self, channel: str, end: End) -> None:
        try:
            operation = told.operation(end.told.text)
            if end.role == "calls":
                self._access.server(end.middleware, channel, operation, _unrecorded)
                self._queries.append(channel)
            else:
                self._access.receiver(end.middleware, channel, operation, lambda payload: None)
        except (RobocompError, ValueError) as exc:
            self._complain(f"{channel} {end.middleware}", f"{channel} over {end.middleware}: {exc}")

    def _serve(self, answer: Answer, middleware: str) -> None:
        if answer.topic.name not in self._responses:
            self._complain(answer.channel, f"{answer.channel} is not served: no call of it was answered")
            return

        def serve() -> tuple[Any, ...]:
            with self._counting:
                answer.answered += 1
            return self._responses[answer.topic.name]

        try:
            answer.ways[middleware] = self._access.server(middleware, answer.channel, answer.operation, serve)
            self._queries.append(answer.channel)
        except RobocompError as exc:
            self._complain(f"{answer.channel} {middleware}", f"{answer.channel} over {middleware}: {exc}")

    def _complain(self, about: str, text: str) -> None:
        if about not in self._told:
            self._told.add(about)
            self._tell(text)


def _unrecorded() -> tuple[Any, ...]:
    raise RobocompError("the recording has no response")
