"""The control socket of a running network: it answers questions and takes commands. `client.py` connects to it.

Requests and answers are JSON objects, one a line. A client may send several requests on one connection:

    {"do": "status"}                                          {"status": {a Snapshot}}
    {"do": "restart", "names": ["laser"]}                     {"accepted": true}
    {"do": "stop", "names": ["laser"]}                        {"accepted": true}; "restart" starts them again
    {"do": "down", "grace": 0}                                {"accepted": true}; ends when the network has
    {"do": "logs", "names": [], "count": 20, "follow": true}  {"time": 1.5, "name": "laser", "line": "…"} for each, with
                                                              "record" if it was logged; {"now": true} after those of
                                                              the past if asked with "mark": true; {"dropped": 3} where
                                                              some were lost, {"end": true}
    {"do": "scout", "host": "base"}                           {"accepted": true}; from then on, all lines are for the
                                                              scout on that host; {"heard": "…"} for each of its
                                                              lines, {"dropped": 3} where some were lost, and
                                                              {"end": true, "why": "…"}, with "unreachable": true if
                                                              its host is out of reach
    anything wrong                                            {"error": "a sentence for people"}, with "unreachable":
                                                              true if a host is out of reach

Clients cannot hurt the network, or each other for long:

- Requests and the number of connections are bounded. Further clients wait in the kernel's queue.
- A new connection has SILENT_S to send its first request.
- When all connections are taken, one that waits for a request makes room: at first one that has never sent any, then
  the one that has been silent for longest. Each connection has TURN_S to send a request before that. A request that
  is being answered is always answered.
- A client that does not read its answers is disconnected.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import socket
import sys
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

from ..errors import DeploymentError, HostUnreachable
from .events import EndRequested, RestartRequested, StopRequested
from .naming import DEPLOYER, meant
from .ring import MOST_LINES, Line
from .scouting import Scout
from .snapshot import Network
from .sockets import listening

log = logging.getLogger("robocomp.deploy")

LINE = 65536
"""Bytes that a request may have."""

CLIENTS = 32
"""How many may be connected at a time."""

SILENT_S = 5.0
"""Seconds that a new connection has for its first request."""

TURN_S = 0.05
"""Seconds for which a connection may be silent before it makes room for another one."""

_SCARCE_S = 0.5
"""Seconds between attempts to accept a connection while that fails: usually for lack of file descriptors."""

SLOW_S = 5.0
"""Seconds after which a client that does not read its answer is disconnected."""

BEHIND = 5000
"""Lines of output that are kept for a client that follows them too slowly."""

_TOGETHER = 200
"""Lines that are sent at once."""


class Lines(Protocol):
    """What the processes of a network have printed. To be used on the event loop only."""

    def last(self, names: Collection[str], count: int) -> Sequence[Line]:
        """The newest lines of these processes (of all, if none is named), the oldest first."""

    def follow(self, sink: Callable[[Line], None]) -> Callable[[], None]:
        """Call `sink` with each new line. Returns a function that ends this."""


class Control:
    """Open while the network runs. To be used on its event loop only."""

    def __init__(self, network: Network, lines: Lines) -> None:
        self._network, self._lines = network, lines
        self._clients: list[_Client] = []
        self._listener: socket.socket | None = None
        self._accepting: asyncio.Task[None] | None = None
        self._left = asyncio.Event()
        """A client has left, or waits for a request now."""

    async def open(self, path: Path) -> None:
        """Raises OSError if there can be no socket of this path."""
        self._listener = listening(path)
        self._accepting = asyncio.create_task(self._accept(self._listener), name="control socket")

    async def close(self) -> None:
        """Disconnect all clients. Idempotent."""
        if self._accepting:
            self._accepting.cancel()
            await asyncio.gather(self._accepting, return_exceptions=True)
            self._accepting = None
        if self._listener:  # before clients are disconnected: one that finds no socket knows that the network ends
            self._listener.close()
            self._listener = None
        tasks = [client.leave() for client in self._clients]
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _accept(self, listener: socket.socket) -> None:
        loop, complained = asyncio.get_running_loop(), False
        while True:
            await self._room()
            try:
                accepted, _ = await loop.sock_accept(listener)
                reader, writer = await asyncio.open_unix_connection(sock=accepted, limit=LINE)
            except OSError as exc:
                if not complained:
                    log.warning("the control socket cannot accept clients: %s; trying again", exc.strerror)
                complained = True
                await asyncio.sleep(_SCARCE_S)
                continue
            complained = False
            client = _Client(reader, writer, loop.time())
            client.task = asyncio.create_task(self._attend(client), name="control client")
            self._clients.append(client)

    async def _room(self) -> None:
        """Wait until there is room for one more client, and make it if need be."""
        while len(self._clients) >= CLIENTS:
            self._left.clear()
            waiting = [client for client in self._clients if client.waits]
            wait_s = None
            if waiting:
                first = min(waiting, key=lambda client: (client.has_asked, client.heard))
                wait_s = first.heard + TURN_S - asyncio.get_running_loop().time()
                if wait_s <= 0:
                    self._clients.remove(first)
                    first.leave()
                    continue
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(wait_s):
                    await self._left.wait()

    async def _attend(self, client: _Client) -> None:
        try:
            await self._serve(client)
        except (TimeoutError, OSError):
            pass  # the client has gone, or does not read
        finally:
            if client in self._clients:
                self._clients.remove(client)
            self._left.set()
            client.writer.transport.abort()  # what was sent has left the process: `send` waits for that

    async def _serve(self, client: _Client) -> None:
        while True:
            try:
                async with asyncio.timeout(None if client.has_asked else SILENT_S):
                    line = await client.reader.readuntil()
            except asyncio.IncompleteReadError:
                return
            except asyncio.LimitOverrunError:
                await client.send({"error": f"a request has at most {LINE} bytes"})
                return
            client.has_asked, client.waits = True, False
            try:
                await self._answer(read_request(line), client)
            except DeploymentError as exc:
                lost = {"unreachable": True} if isinstance(exc, HostUnreachable) else {}
                await client.send({"error": str(exc), **lost})
            self._rest(client)

    def _rest(self, client: _Client) -> None:
        """Nothing is being answered to it, so it may make room."""
        client.heard, client.waits = asyncio.get_running_loop().time(), True
        self._left.set()

    async def _answer(self, request: Request, client: _Client) -> None:
        match request.do:
            case "status":
                await client.send({"status": asdict(self._network.snapshot())})
            case "restart":
                self._network.ask(RestartRequested(request.names))
                await client.send({"accepted": True})
            case "stop":
                if not request.names:
                    raise DeploymentError('"names" of this request is what is to be stopped; "down" stops all')
                self._network.ask(EndRequested(request.names))
                await client.send({"accepted": True})
            case "down":
                self._network.ask(StopRequested(grace=request.grace, why="requested by rcdeploy down"))
                await client.send({"accepted": True})
            case "logs":
                await self._tell_lines(request, client)
            case "scout":
                await self._scout(request.host, client)
            case other:
                raise DeploymentError(f"there is no request `{other}`")

    async def _tell_lines(self, request: Request, client: _Client) -> None:
        with contextlib.ExitStack() as following:
            others = [name for name in request.names if name != DEPLOYER]
            names = {each.name for each in meant(others, self._network.snapshot().processes)} if others else set[str]()
            names |= {DEPLOYER} & set(request.names)
            followed = _Followed(names)
            if request.follow:
                following.callback(self._lines.follow(followed.take))
            await client.send(*map(_told, self._lines.last(names, request.count) if request.count else ()))
            if request.mark:
                await client.send({"now": True})
            if request.follow:
                await self._follow(followed, client)
        await client.send({"end": True})

    async def _scout(self, host: str, client: _Client) -> None:
        """Carry lines between a scout and its tool, until one of them leaves."""
        scout = self._network.scout(host)
        hearing: asyncio.Task[None] | None = None
        try:
            await client.send({"accepted": True})
            hearing = asyncio.create_task(_hear(client, scout), name="lines for a scout")
            while not hearing.done() and not scout.has_ended:
                self._rest(client)
                news = asyncio.create_task(scout.news.wait())
                try:
                    await asyncio.wait((hearing, news), return_when=asyncio.FIRST_COMPLETED)
                finally:
                    news.cancel()
                client.waits = False
                await client.send(*_heard(scout))
            lost = {"unreachable": True} if scout.is_lost else {}
            if not hearing.done():
                await client.send(*_heard(scout), {"end": True, "why": scout.why, **lost})
        finally:
            scout.close()
            if hearing:
                hearing.cancel()
                await asyncio.gather(hearing, return_exceptions=True)
        raise ConnectionAbortedError  # nothing else can be asked on this connection

    async def _follow(self, followed: _Followed, client: _Client) -> None:
        gone = asyncio.create_task(client.reader.read(1))  # a client that follows sends nothing until it leaves
        try:
            while not gone.done():
                self._rest(client)
                news = asyncio.create_task(followed.news.wait())
                try:
                    await asyncio.wait((gone, news), return_when=asyncio.FIRST_COMPLETED)
                finally:
                    news.cancel()
                client.waits = False
                await client.send(*followed.taken())
        finally:
            gone.cancel()


@dataclass(eq=False)
class _Client:
    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter
    heard: float
    """When it connected, or was sent its newest answer, by the clock of the loop."""
    waits: bool = True
    """Nothing is being answered, so it may make room; also true between two lines that it follows."""
    has_asked: bool = False
    task: asyncio.Task[None] | None = None

    def leave(self) -> asyncio.Task[None]:
        """Have it disconnected, which is done when the task has ended."""
        assert self.task
        self.task.cancel()
        self.writer.transport.abort()  # the task may not have begun
        return self.task

    def __post_init__(self) -> None:
        self.writer.transport.set_write_buffer_limits(high=0)  # to drain is to have everything sent

    async def send(self, *answers: Mapping[str, Any]) -> None:
        """Raises TimeoutError if the client does not read, OSError if it has gone."""
        for start in range(0, len(answers), _TOGETHER):
            part = answers[start : start + _TOGETHER]
            self.writer.write(b"".join(json.dumps(answer).encode() + b"\n" for answer in part))
            async with asyncio.timeout(SLOW_S):
                await self.writer.drain()


def _heard(scout: Scout) -> list[Mapping[str, Any]]:
    """Answers for all that a scout has said and lost since the last time."""
    lines: list[Mapping[str, Any]] = [{"heard": line} for line in scout.taken()]
    dropped, scout.dropped = scout.dropped, 0
    return [*lines, {"dropped": dropped}] if dropped else lines


async def _hear(client: _Client, scout: Scout) -> None:
    """Pass on what the tool says, until it leaves or says too much."""
    with contextlib.suppress(OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
        while True:
            scout.say((await client.reader.readuntil()).decode(errors="replace").rstrip("\n"))


class _Followed:
    """The lines that a following client has not received yet, as far as there is room."""

    def __init__(self, names: Collection[str]) -> None:
        self._names = names
        self._waiting: deque[Line] = deque()
        self._dropped = 0
        self.news = asyncio.Event()

    def take(self, line: Line) -> None:
        if self._names and line.name not in self._names:
            return
        if len(self._waiting) < BEHIND:
            self._waiting.append(line)
        else:
            self._dropped += 1
        self.news.set()

    def taken(self) -> list[Mapping[str, Any]]:
        """Answers for all there is."""
        lines, dropped = list(map(_told, self._waiting)), self._dropped
        self._waiting.clear()
        self._dropped = 0
        self.news.clear()
        return [*lines, {"dropped": dropped}] if dropped else lines


def _told(line: Line) -> Mapping[str, Any]:
    told = {"time": line.at, "name": line.name, "line": line.text}
    return told | {"record": asdict(line.record)} if line.record else told


@dataclass(frozen=True)
class Request:
    do: str
    names: tuple[str, ...] = ()
    """Instances, processes or systems; () means all."""
    count: int = 0
    follow: bool = False
    mark: bool = False
    """Whether the end of the past is told."""
    grace: float | None = None
    host: str = ""


def read_request(line: bytes) -> Request:
    """Raises DeploymentError, with a message for people, if it is not a request."""
    try:
        found = json.loads(line)
    except (ValueError, RecursionError) as exc:
        raise DeploymentError("a request is a JSON object on a line") from exc
    if not isinstance(found, dict) or "do" not in found:
        raise DeploymentError('a request is a JSON object with a key "do"')
    for key, value in found.items():
        fits, what = _FIELDS.get(key, (None, ""))
        if fits is None:
            raise DeploymentError(f"a request has no {json.dumps(key)}; it may have: {', '.join(_FIELDS)}")
        if not fits(value):
            raise DeploymentError(f'"{key}" of a request is {what}')
    fields: dict[str, Any] = {key: tuple(value) if key == "names" else value for key, value in found.items()}
    return Request(**fields)


_FIELDS: Mapping[str, tuple[Callable[[Any], bool], str]] = {
    "do": (lambda value: isinstance(value, str), "a word"),
    "names": (lambda value: isinstance(value, list) and all(isinstance(n, str) for n in value), "a list of names"),
    "count": (lambda value: type(value) is int and 0 <= value <= MOST_LINES, f"a whole number up to {MOST_LINES}"),
    "follow": (lambda value: isinstance(value, bool), "true or false"),
    "mark": (lambda value: isinstance(value, bool), "true or false"),
    "host": (lambda value: isinstance(value, str), "a name"),
    "grace": (lambda value: type(value) in (int, float) and 0 <= value <= sys.float_info.max, "a number of seconds"),
}
