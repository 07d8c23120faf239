"""Scouts on other hosts, as a tool asks them; see `scout`. What they answer comes from outside, and is checked."""

from __future__ import annotations

import contextlib
import itertools
import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

from ..errors import (
    Busy,
    Closed,
    ContractMismatch,
    DeploymentError,
    HostUnreachable,
    Refused,
    RobocompError,
    Timeout,
    Unreachable,
    UnsupportedQoS,
)
from ..threads import start_thread

_WAITING = 10_000
"""Answers to one question that may wait; a scout does not send more at a time."""

WINDOW = 2 * 1024 * 1024
"""The weight of the octets that a scout sends before the tool has told that it took them. Controllers of networks keep
more than that for a tool, so its other answers get through."""

_TOLD = WINDOW // 8
"""The weight of octets after which a tool tells so."""

Message = Mapping[str, Any]

Taker = Callable[[Message | RobocompError], object]
"""Gets the answers to a question; an error if none will follow, since the scout has ended."""


class Line(Protocol):
    """A connection to a scout, such as `deploy.client.ScoutLine`; one thread reads, others write."""

    def say(self, message: Message) -> None:
        """Raises RobocompError."""

    def told(self) -> Message | None:
        """The next answer; None once it is closed. Raises RobocompError once there is no scout any more."""

    def close(self) -> None:
        """Let the thread that reads go on."""

    def release(self) -> None:
        """Free it, once no thread reads."""


def weight(octets: str) -> int:
    """What a part of a message counts for in `WINDOW`; also many small ones must not be too many lines."""
    return len(octets) + 2048


class Post:
    """A host of a network with a scout, which is started when it is first asked. For any number of threads."""

    def __init__(self, host: str, connect: Callable[[], Line]) -> None:
        """`connect` starts a scout; it may raise RobocompError."""
        self.host, self._connect = host, connect
        self.options: Mapping[str, Mapping[str, Any]] = {}
        """Of middlewares there, by their names."""
        self._lock = threading.Lock()
        self._session: _Session | None = None

    def ask(self, do: str, deadline: float, **more: Any) -> list[Message]:
        """All answers to a question.

        Raises HostUnreachable if they do not come within `deadline` seconds, and ScoutError if there is an error.
        """
        answers: queue.SimpleQueue[Message | RobocompError] = queue.SimpleQueue()
        end = time.monotonic() + deadline
        found: list[Message] = []
        with self.following(do, answers.put, **more):
            while True:
                try:
                    answer = answers.get(timeout=max(0.0, end - time.monotonic()))
                except queue.Empty:
                    raise HostUnreachable(f"{self.host}: no answer within {deadline:g} s") from None
                if isinstance(answer, RobocompError):
                    raise answer
                if "error" in answer:
                    raise failure(answer)
                if answer.get("end"):
                    return found
                if "dropped" in answer:
                    raise HostUnreachable(f"{self.host}: the connection is too slow: answers were lost")
                found.append(answer)

    @contextlib.contextmanager
    def following(self, do: str, take: Taker, **more: Any) -> Iterator[None]:
        """While entered, `take` gets the answers to a question, on a thread of this object. Raises RobocompError."""
        session = self._opened()
        number = session.begin(do, take, {"options": self.options, **more} if self.options else more)
        try:
            yield
        finally:
            session.cease(number)

    def close(self) -> None:
        """End the scout. Idempotent; the next question starts another one."""
        with self._lock:
            session, self._session = self._session, None
        if session:
            session.close()

    def _opened(self) -> _Session:
        with self._lock:
            if self._session and self._session.has_ended:
                self._session.close()
                self._session = None
            self._session = self._session or _Session(self.host, self._connect())
            return self._session


class ScoutError(RobocompError):
    """A scout could not do what it was asked for; the message is its own."""


_KINDS = {
    each.__name__: each for each in (Busy, Closed, ContractMismatch, Refused, Timeout, Unreachable, UnsupportedQoS)
}
"""Outcomes of calls that a tool has to know."""


def failure(answer: Message) -> RobocompError:
    """The error that a scout tells."""
    return _KINDS.get(str(answer.get("kind")), ScoutError)(str(answer["error"]))


class _Session:
    """One scout, from its start to its end."""

    def __init__(self, host: str, line: Line) -> None:
        self._host, self._line = host, line
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()
        self._takers: dict[int, Taker] = {}
        self._saying = threading.Lock()
        self._taken = 0
        """The weight of octets that came and are not told yet; only the thread that reads uses it."""
        self._error: RobocompError | None = None
        self.has_ended = False
        self._thread = threading.Thread(target=self._read, name=f"scout of {host}", daemon=True)
        start_thread(self._thread)

    def begin(self, do: str, take: Taker, more: Message) -> int:
        number = next(self._numbers)
        with self._lock:
            if self.has_ended:
                raise self._reason()
            self._takers[number] = take
        try:
            self._say({"id": number, "do": do, **more})
        except BaseException:
            self._takers.pop(number, None)
            raise
        return number

    def cease(self, number: int) -> None:
        """End a question that has not ended itself."""
        if self._takers.pop(number, None) and not self.has_ended:
            with contextlib.suppress(RobocompError):
                self._say({"id": number, "do": "cease"})

    def _say(self, message: Message) -> None:
        with self._saying:
            self._line.say(message)

    def _took(self, octets: int) -> None:
        """Let the scout send more."""
        self._taken += octets
        if self._taken >= _TOLD:
            self._say({"id": 0, "do": "took", "octets": self._taken})
            self._taken = 0

    def _reason(self) -> RobocompError:
        """Why it has ended."""
        return self._error or DeploymentError(f"{self._host}: its scout has ended")

    def close(self) -> None:
        self._line.close()
        self._thread.join()
        self._line.release()

    def _read(self) -> None:
        try:
            while (answer := self._line.told()) is not None:
                if "dropped" in answer:
                    for each in list(self._takers.values()):
                        each(answer)
                    self._took(WINDOW)  # at most that much is lost
                    continue
                number = answer.get("id")
                take = self._takers.get(number) if isinstance(number, int) else None
                if take and answer.get("end"):
                    self._takers.pop(int(answer["id"]), None)
                if take:
                    take(answer)
                match answer:
                    case {"octets": [*_, str(octets)]}:
                        self._took(weight(octets))
        except RobocompError as exc:
            self._error = exc
        finally:
            with self._lock:
                self.has_ended = True
                takers = list(self._takers.values())
                self._takers.clear()
            for take in takers:
                take(self._reason())


def ask_all(
    posts: Sequence[Post], do: str, deadline: float, **more: Any
) -> tuple[dict[Post, list[Message]], dict[str, str]]:
    """What scouts answer, all at a time; and why a host could not be asked, by its name."""

    def asked(post: Post) -> list[Message] | RobocompError:
        try:
            return post.ask(do, deadline, **more)
        except RobocompError as exc:
            return exc

    answers, lost = dict[Post, list[Message]](), dict[str, str]()
    with ThreadPoolExecutor(max(1, len(posts)), "survey") as pool:
        for post, found in zip(posts, pool.map(asked, posts), strict=True):
            if isinstance(found, RobocompError):
                lost[post.host] = str(found)
            else:
                answers[post] = found
    return answers, lost
