"""Topics and queries of other hosts, through the scouts there. Their answers come from outside, and are checked."""

from __future__ import annotations

import base64
import binascii
import math
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack
from functools import partial
from typing import Any, NamedTuple

from ..errors import DecodeError, RobocompError
from ..transports.base import Heard, Statistics
from .network import Channel
from .posts import Message as Answer
from .posts import Post, ScoutError
from .thrown import ThrownError
from .traffic import Arrival

_SPARE = 10.0
"""Seconds after the deadline of a call in which its outcome arrives from the other host."""


class Message(NamedTuple):
    time: float
    """When it arrived, in seconds since 1970."""
    channel: str
    message: Any
    """As JSON, or a text that says why it cannot be decoded."""
    dropped: int
    """Messages that arrived since the last one and did not fit."""
    sent: float | None
    """When it was sent, by the clock of its publisher's host, in seconds since 1970; None if it does not tell."""
    number: int | None
    """Counts the messages of its publisher from 1; None if it does not tell."""
    host: str = ""
    """The host whose scout has heard it; "" if this process has."""


class Far:
    """Takes messages that scouts have decoded, and passes them on."""

    def __init__(
        self, take: Callable[[str, Message], object], miss: Callable[[int], object], full: bool = True
    ) -> None:
        """`take` gets the name of a channel and a message, `miss` the number of messages that were lost on their way.

        Unless `full`, messages may be shortened.
        """
        self._take, self._miss, self._full = take, miss, full
        self._published: dict[tuple[str, str], bool] = {}
        """By channel and host."""
        self.lost: dict[str, RobocompError] = {}
        """The hosts that are not heard any more, and why."""

    def following(self, post: Post, topics: Sequence[Channel]) -> AbstractContextManager[Any]:
        """While entered, these topics are heard on the host of this scout."""
        self._published.update(dict.fromkeys(((each.name, post.host) for each in topics), False))
        return post.following("hear", partial(self._answer, post.host), **_named(topics), full=self._full)

    def presences(self) -> dict[tuple[str, str], bool]:
        """The topics by name and host, and whether something publishes them there now; lost hosts have none."""
        return {key: is_published for key, is_published in self._published.copy().items() if key[1] not in self.lost}

    def _answer(self, host: str, answer: Answer | RobocompError) -> None:
        match answer:
            case {"message": [str(channel), shown, int(dropped), sent, number]} if (channel, host) in self._published:
                self._published[channel, host] = True
                stamp = float(sent) if isinstance(sent, int | float) else None
                count = number if isinstance(number, int) else None
                self._take(channel, Message(0.0, channel, shown, max(0, dropped), stamp, count, host))
            case {"presence": [str(channel), bool(is_published)]} if (channel, host) in self._published:
                self._published[channel, host] = is_published
            case {"dropped": int(number)}:
                self._miss(max(0, number))
            case _:
                _note(self.lost, host, answer)


class FarArrivals:
    """Takes the arrivals of messages, and passes them on with times of the clock here."""

    def __init__(self, take: Callable[[Arrival], object]) -> None:
        self._take = take
        self.lost: dict[str, RobocompError] = {}
        """As that of `Far`."""

    def following(self, post: Post, topics: Sequence[Channel]) -> AbstractContextManager[Any]:
        names = frozenset(each.name for each in topics)
        return post.following("arrivals", _Clocked(self, post.host, names, self._take), **_named(topics))

    def presences(self) -> dict[tuple[str, str], bool]:
        return {}


class _Clocked:
    """Takes the arrivals on one host."""

    def __init__(self, far: FarArrivals, host: str, names: frozenset[str], take: Callable[[Arrival], object]) -> None:
        self._far, self._host, self._names, self._take = far, host, names, take
        self._ahead: float | None = None
        """Seconds to add to times of the clock there: its offset, and the time that the first answer took. The value
        stays the same, so that intervals are measured by the clock there."""

    def __call__(self, answer: Answer | RobocompError) -> None:
        match answer:
            case {"arrivals": list(arrivals), "now": float(now)}:
                if self._ahead is None:
                    self._ahead = time.monotonic() - now
                for each in arrivals:
                    match each:
                        case [str(channel), float(at), int(octets), int(source), int(sequence), age] if (
                            channel in self._names
                        ):
                            known = float(age) if isinstance(age, int | float) else math.nan
                            self._take(Arrival(channel, at + self._ahead, octets, source, sequence, known, self._host))
            case {"dropped": int()}:
                pass  # the numbers of messages tell, too
            case _:
                _note(self._far.lost, self._host, answer)


_LONGEST = 256 * 1024 * 1024
"""Octets of a message."""

_MOST_SOURCES = 1000
"""Publishers whose numbers are remembered."""


class FarLink:
    """The subscription to a topic of another host. It is used as a link that receives."""

    def __init__(self, channel: Channel, sink: Callable[[Heard], object]) -> None:
        """`sink` gets messages, whose payloads are standard CDR, on a thread of the post. It may raise DecodeError.

        Raises what asking a scout raises.
        """
        assert channel.via
        self._name, self._post, self._sink = channel.name, channel.via, sink
        self._question = _named([channel]) | {"fingerprint": channel.operation.fingerprint}
        self._sequences: dict[int, int] = {}
        self._parts: list[bytes] = []
        self._size = 0
        self._following = ExitStack()
        self._lock = threading.RLock()  # a sink may close this link
        self._is_closed = False
        self.stats = Statistics()
        """`lost` counts messages that did not arrive here, by gaps in the numbers of their publishers."""
        self.error: RobocompError | None = None
        """Why nothing comes any more."""
        self.open()

    @property
    def host(self) -> str:
        return self._post.host

    def open(self) -> None:
        """Subscribe, also again after an error, unless it is closed. Raises what asking a scout raises."""
        if self._is_closed:
            return
        self._following.close()
        self.error = None
        try:
            self._following.enter_context(self._post.following("octets", self._answer, **self._question))
        except RobocompError as exc:
            self.error = exc
            raise

    def close(self) -> None:
        """Idempotent. After it returns, the sink is not called again."""
        with self._lock:
            self._is_closed = True
        self._following.close()

    def _answer(self, answer: Answer | RobocompError) -> None:
        match answer:
            case {"octets": [int(source), int(sequence), int(stamp), int(place), int(parts), str(data)]}:
                with self._lock:
                    if not self._is_closed:
                        self._note(source, sequence, stamp, place, parts, data)
            case {"dropped": int()}:
                pass  # the numbers of messages tell, too
            case _:
                self.error = self.error or ended(self._post.host, answer)

    def _note(self, source: int, sequence: int, stamp: int, place: int, parts: int, data: str) -> None:
        """Take a part of a message. If a part is missing, those after it are ignored, and so is their message."""
        if place == 0:
            self._parts, self._size = [], 0
        elif place != len(self._parts):
            return
        try:
            self._parts.append(base64.b64decode(data, validate=True))
        except binascii.Error:
            self.stats.malformed += 1
            return
        self._size += len(self._parts[-1])
        if self._size > _LONGEST:
            self._parts, self._size = [], 0
        if len(self._parts) != parts:
            return
        self._count(source, sequence)
        try:
            self._sink(Heard(self._name, source, sequence, stamp, b"".join(self._parts)))
        except DecodeError:
            self.stats.malformed += 1

    def _count(self, source: int, sequence: int) -> None:
        self.stats.received += 1
        missing = sequence - self._sequences.get(source, sequence - 1) - 1
        if source and missing >= 0:
            self.stats.lost += missing
            if len(self._sequences) >= _MOST_SOURCES:
                self._sequences.clear()
            self._sequences[source] = sequence


def _named(topics: Sequence[Channel]) -> dict[str, Any]:
    """The fields that name topics in a question."""
    used = dict.fromkeys(middleware for each in topics for middleware in each.middlewares)
    over = [each.middlewares[0] for each in topics]
    return {"channels": [each.name for each in topics], "over": over, "middlewares": list(used)}


def _note(lost: dict[str, RobocompError], host: str, answer: Answer | RobocompError) -> None:
    if error := ended(host, answer):
        lost.setdefault(host, error)


def ended(host: str, answer: Answer | RobocompError) -> RobocompError | None:
    """The error that an unexpected answer means; None if the answer is to be ignored."""
    if isinstance(answer, RobocompError):
        return answer
    return ScoutError(f"{host}: {answer['error']}") if "error" in answer else None


def asked(channel: Channel, values: tuple[Any, ...], deadline: float) -> tuple[Any, ...]:
    """Let the scout of a channel call its query, or send its command. Returns the outputs; a command has none.

    Raises ThrownError, and ScoutError if the call fails otherwise.
    """
    from ..wire import json

    assert channel.via
    operation = channel.operation
    arguments = json.show_fields(operation.inputs, values)
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
                return json.take_fields(operation.outputs, result, operation.name)
            case {"thrown": str(name), "fields": fields}:
                kind = next(each for each in operation.raises if each.name == name)
                raise ThrownError(kind, json.take_fields(kind.all_fields, fields, name))
    except (ValueError, StopIteration) as exc:
        raise ScoutError(f"{channel.via.host}: the answer of its scout is not understood: {exc}") from exc
    raise ScoutError(f"{channel.via.host}: its scout gives no answer")
