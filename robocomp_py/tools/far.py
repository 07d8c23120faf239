"""Topics and queries of other hosts, by their scouts. What they tell comes from outside, and is checked."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from functools import partial
from typing import Any, NamedTuple

from ..errors import RobocompError
from ..wire import json
from .network import Channel
from .posts import Message as Answer
from .posts import Post, ScoutError
from .thrown import ThrownError
from .traffic import Arrival

_SPARE = 10.0
"""Seconds beyond its deadline in which the outcome of a call has come from its host."""


class Message(NamedTuple):
    time: float
    """When it arrived, in seconds since 1970."""
    channel: str
    message: Any
    """As JSON; a text that says why, if it cannot be decoded."""
    dropped: int
    """Messages that arrived since the last one and did not fit."""
    sent: float | None
    """When it was sent, by the clock of its publisher's host, in seconds since 1970; None if it does not tell."""
    number: int | None
    """Counts the messages of its publisher from 1; None if it does not tell."""


class Far:
    """Takes messages, decoded there, and passes them on."""

    def __init__(
        self, take: Callable[[str, Message], object], miss: Callable[[int], object], full: bool = True
    ) -> None:
        """`take` gets the name of a channel and a message, `miss` the number of messages that were lost on their way.

        Unless `full`, messages may be shortened.
        """
        self._take, self._miss, self._full = take, miss, full
        self._published: dict[str, bool] = {}
        self.error: RobocompError | None = None
        """What went wrong."""

    def following(self, post: Post, topics: Sequence[Channel]) -> AbstractContextManager[Any]:
        """While entered, these topics are heard on the host of this scout."""
        self._published.update(dict.fromkeys((each.name for each in topics), False))
        return post.following("hear", partial(self._answer, post.host), **_named(topics), full=self._full)

    def presences(self) -> list[tuple[str, bool]]:
        """The topics, and whether something publishes them now."""
        return list(self._published.items())

    def _answer(self, host: str, answer: Answer | RobocompError) -> None:
        match answer:
            case {"message": [str(channel), shown, int(dropped), sent, number]} if channel in self._published:
                self._published[channel] = True
                stamp = float(sent) if isinstance(sent, int | float) else None
                count = number if isinstance(number, int) else None
                self._take(channel, Message(0.0, channel, shown, max(0, dropped), stamp, count))
            case {"presence": [str(channel), bool(is_published)]} if channel in self._published:
                self._published[channel] = is_published
            case {"dropped": int(number)}:
                self._miss(max(0, number))
            case _:
                self.error = self.error or ended(host, answer)


class FarArrivals:
    """Takes the arrivals of messages, and passes them on with times of the clock here."""

    def __init__(self, take: Callable[[Arrival], object]) -> None:
        self._take = take
        self.error: RobocompError | None = None

    def following(self, post: Post, topics: Sequence[Channel]) -> AbstractContextManager[Any]:
        names = frozenset(each.name for each in topics)
        return post.following("arrivals", _Clocked(self, post.host, names, self._take), **_named(topics))

    def presences(self) -> list[tuple[str, bool]]:
        return []


class _Clocked:
    """Takes the arrivals on one host."""

    def __init__(self, far: FarArrivals, host: str, names: frozenset[str], take: Callable[[Arrival], object]) -> None:
        self._far, self._host, self._names, self._take = far, host, names, take
        self._ahead = math.inf
        """Seconds by which the clock here is ahead of the one there: the least that was seen, which had the fastest
        way."""

    def __call__(self, answer: Answer | RobocompError) -> None:
        match answer:
            case {"arrivals": list(arrivals), "now": float(now)}:
                self._ahead = min(self._ahead, time.monotonic() - now)
                for each in arrivals:
                    match each:
                        case [str(channel), float(at), int(octets), int(source), int(sequence), age] if (
                            channel in self._names
                        ):
                            known = float(age) if isinstance(age, int | float) else math.nan
                            self._take(Arrival(channel, at + self._ahead, octets, source, sequence, known))
            case {"dropped": int()}:
                pass  # the numbers of messages tell, too
            case _:
                self._far.error = self._far.error or ended(self._host, answer)


def _named(topics: Sequence[Channel]) -> dict[str, Any]:
    """What a question for topics has."""
    used = dict.fromkeys(middleware for each in topics for middleware in each.middlewares)
    return {"channels": [each.name for each in topics], "middlewares": list(used)}


def ended(host: str, answer: Answer | RobocompError) -> RobocompError | None:
    """What an answer that is not expected means; None if it is to be ignored."""
    if isinstance(answer, RobocompError):
        return answer
    return ScoutError(f"{host}: {answer['error']}") if "error" in answer else None


def asked(channel: Channel, values: tuple[Any, ...], deadline: float) -> tuple[Any, ...]:
    """Have the scout of a channel call its query; returns the outputs. A command has none.

    Raises ThrownError, and ScoutError if the call fails otherwise.
    """
    assert channel.via
    operation = channel.operation
    arguments = json.shown(operation.inputs, values)
    answer, *_ = channel.via.ask(
        "call",
        deadline + _SPARE,
        channel=channel.name,
        middlewares=channel.middlewares,
        arguments=arguments,
        within=deadline,
    ) or ({},)
    try:
        match answer:
            case {"result": result}:
                return json.taken(operation.outputs, result, operation.name)
            case {"thrown": str(name), "fields": fields}:
                kind = next(each for each in operation.raises if each.name == name)
                raise ThrownError(kind, json.taken(kind.all_fields, fields, name))
    except (ValueError, StopIteration) as exc:
        raise ScoutError(f"{channel.via.host}: the answer of its scout is not understood: {exc}") from exc
    raise ScoutError(f"{channel.via.host}: its scout gives no answer")
