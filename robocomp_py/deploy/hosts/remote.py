"""The agent of another host, as `run.py` sees it: one connection, one channel, and a way back when it is lost."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import logging
import secrets
import shlex
import sys
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import asyncssh

from ...errors import DeploymentError, HostUnreachable
from ..agents import Agent, Listener, Usage
from ..beside import beside
from ..launcher.output import LINE
from ..plan import Host
from ..process import Process
from ..relocation import places, relocate
from ..scouting import Scout
from . import ssh
from .bundle import FILES, KEYS, Bundle, collect, pack
from .lines import (
    BEAT,
    LONGEST_TOLD,
    SILENCE,
    VERSION,
    Lines,
    Message,
    Misunderstood,
    heard,
    packed,
    shown,
    told,
    usage_of,
)

log = logging.getLogger("robocomp.deploy")

ANSWER_TIMEOUT = 60.0
"""Seconds for a host to get ready, and to start one process."""

CLOSING = 25.0
"""Seconds within which it ends everything."""

FIRST_PAUSE, LONGEST_PAUSE = 0.5, 10.0
"""Seconds between two attempts to reach it again."""

WORTH_TELLING = 1_000_000
"""Bytes from which on sending reports its progress."""

_CHUNK = 256 * 1024


@dataclass(frozen=True)
class Share:
    """The part of a network that runs on one host."""

    network: str
    processes: tuple[Process, ...]
    hosted: tuple[tuple[str, Mapping[str, Any]], ...] = ()
    """Middlewares whose shared part the agent runs there, with their options."""
    needs: Mapping[str, str] = field(default_factory=dict)
    """Required modules, and the packages that provide them."""
    keys: Mapping[Path, str] = field(default_factory=dict)
    """Files that only this host gets, and their places below `keys`."""
    keys_folder: Path | None = None
    """Their folder as commands name it; the host has another one."""


class RemoteAgent(Agent):
    def __init__(
        self,
        host: Host,
        share: Share,
        listener: Listener,
        note: Callable[[str], None] = log.info,
        **options: Any,
    ) -> None:
        """`note` is called with progress; `options` are passed to asyncssh."""
        self._host, self._share, self._listener = host, share, listener
        self._note, self._options = note, options
        self._names = {process.name for process in share.processes}
        self._controller = secrets.token_hex(8)
        self._bundle: Bundle | None = None
        self._places: Mapping[Path, str] = places(share.processes, FILES)
        self._channel: ssh.Channel | None = None
        self.kept: list[str] = []
        """What ran there when the connection was made."""
        self._root = self._python = self._folder = ""
        self._starting: dict[str, asyncio.Future[None]] = {}
        self._usage: dict[str, Usage] = {}
        self._scouts: dict[int, Scout] = {}
        self._numbers = itertools.count(1)
        self._heard_at = 0.0
        self._closed = asyncio.Event()
        """Set when the agent has reported that nothing is left."""
        self._closing = False
        self._tasks: set[asyncio.Task[None]] = set()

    # Commands of run.py.

    async def open(self) -> None:
        """Raises HostUnreachable; DeploymentError if the network runs there already, or cannot."""
        self._bundle = self._bundle or await beside(self._pack)
        await self._reach()

    async def start(self, process: Process) -> None:
        if self._channel is None:
            raise DeploymentError(f"{process.name}: {ssh.called(self._host)} is out of reach")
        answer = asyncio.get_running_loop().create_future()
        self._starting[process.name] = answer
        try:
            self._send(do="start", process=told(process, self._command(process), self._folder))
            async with asyncio.timeout(ANSWER_TIMEOUT):
                await answer
        except TimeoutError as exc:
            message = f"{process.name}: {ssh.called(self._host)} has not started it within {ANSWER_TIMEOUT:g} s"
            raise DeploymentError(message) from exc
        finally:
            self._starting.pop(process.name, None)

    def stop(self, name: str) -> None:
        self._send(do="stop", name=name)

    def kill(self, name: str) -> None:
        self._send(do="kill", name=name)

    def usage(self) -> Mapping[str, Usage]:
        return self._usage

    def scout(self) -> Scout:
        """Start a process there that looks at what runs. Raises HostUnreachable."""
        if self._channel is None:
            raise HostUnreachable(f"{ssh.called(self._host)} is out of reach")
        number = next(self._numbers)

        def leave() -> None:
            self._scouts.pop(number, None)
            self._send(do="scout_end", id=number)

        self._scouts[number] = scout = Scout(lambda line: self._send(do="scout_line", id=number, line=line), leave)
        self._send(do="scout", id=number)
        return scout

    def _lose_scouts(self, why: str) -> None:
        scouts = list(self._scouts.values())
        self._scouts.clear()
        for each in scouts:
            each.end(f"{ssh.called(self._host)} is out of reach: {why}", is_lost=True)

    async def close(self) -> None:
        self._closing = True
        self._lose_scouts("the network ends")
        channel = self._channel
        if channel:
            self._send(do="close")
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(CLOSING):
                    await self._closed.wait()
            self._channel = None
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        if channel:
            await channel.close()

    # Connecting.

    def _pack(self) -> Bundle:
        return pack(collect(self._places, self._share.keys))

    async def _reach(self) -> None:
        """Connect to the agent, starting it if needed. Raises DeploymentError."""
        assert self._bundle
        asked = {
            "bundle": self._bundle.name,
            "needs": dict(self._share.needs),
            "workdir": self._host.workdir,
            "network": self._called,
        }
        source = Path(__file__).with_name("bootstrap.py").read_text(encoding="utf-8")
        channel = await ssh.run(self._host, [self._host.python, "-c", source, json.dumps(asked)], **self._options)
        try:
            async with asyncio.timeout(ANSWER_TIMEOUT):
                told = _Told(channel)
                boot = await self._told(told, channel, "boot")
            self._root, self._python, self._folder = boot["root"], boot["python"], boot["folder"]
            if not boot["there"]:
                await self._deliver(channel, self._bundle)
            async with asyncio.timeout(ANSWER_TIMEOUT):
                hello = await self._told(told, channel, "hello")
                self.kept = [shown(str(name)) for name in hello["kept"]]
                self._check_version(hello)
                channel.writer.write(packed(self._opening()))
                await self._told(told, channel, "opened")
        except (OSError, asyncssh.Error, TimeoutError, Misunderstood) as exc:
            channel.abort()
            why = f"no answer within {ANSWER_TIMEOUT:g} s" if isinstance(exc, TimeoutError) else shown(str(exc))
            raise HostUnreachable(f"{ssh.called(self._host)}: the agent there did not start: {why}") from exc
        except BaseException:
            channel.abort()
            raise
        self._channel, self._heard_at = channel, asyncio.get_running_loop().time()
        self._task(self._listen(channel, told), f"listen to {self._host.name}")
        self._task(self._beat(channel), f"beat for {self._host.name}")

    @property
    def _called(self) -> str:
        """The network's name there: two of its hosts may be the same machine."""
        return f"{self._share.network}.{self._host.name}"

    async def _told(self, lines: _Told, channel: ssh.Channel, what: str) -> Message:
        """The next message of the kind `what`. Raises DeploymentError."""
        while (message := await lines.next(noise=what == "boot")) is not None:
            if message.get("tell") == what:
                return message
            if message.get("tell") == "refused":
                error = HostUnreachable if what in ("boot", "hello") else DeploymentError
                raise error(f"{ssh.called(self._host)}: {shown(message['why'])}")
        said = await channel.said()
        if channel.exit_status == 127:
            hint = f'there is no `{self._host.python}`; if it is called otherwise: python "NAME"; in its `host`'
            raise HostUnreachable(f"{ssh.called(self._host)}: {hint}")
        raise HostUnreachable(f"{ssh.called(self._host)}: the agent there has ended: {said}")

    def _check_version(self, hello: Message) -> None:
        if hello.get("version") != VERSION:
            raise HostUnreachable(
                f"{ssh.called(self._host)}: another version of robocomp_py has left {', '.join(self.kept)} "
                "running there; end it with that version (rcdeploy down), or kill it"
            )

    def _opening(self) -> Message:
        return {
            "do": "open",
            "controller": self._controller,
            "network": self._share.network,
            "command": shlex.join(["rcdeploy", *sys.argv[1:]]),
            "keep": self._host.keep,
            "hosted": [[name, self._with_keys(options)] for name, options in self._share.hosted],
            "names": [process.name for process in self._share.processes],
        }

    async def _deliver(self, channel: ssh.Channel, bundle: Bundle) -> None:
        size = len(bundle.packed)
        channel.writer.write(packed({"size": size}))
        told_at = 0
        for start in range(0, size, _CHUNK):
            if size >= WORTH_TELLING and start * 10 // size > told_at:
                told_at = start * 10 // size
                self._note(f"{self._host.name}: {told_at * 10} % of {size / 1e6:.1f} MB sent")
            channel.writer.write(bundle.packed[start : start + _CHUNK])
            async with asyncio.timeout(ANSWER_TIMEOUT):
                await channel.writer.drain()

    def _command(self, process: Process) -> tuple[str, ...]:
        there = {path: f"{self._root}/{place}" for path, place in self._places.items()}
        return tuple(map(self._with_keys, relocate(process, there, self._python)))

    def _with_keys(self, what: Any) -> Any:
        """The same, with the host's own folder of keys."""
        if isinstance(what, Mapping):
            return {key: self._with_keys(value) for key, value in what.items()}
        if isinstance(what, list | tuple):
            return [self._with_keys(each) for each in what]
        if isinstance(what, str) and self._share.keys_folder:
            return what.replace(str(self._share.keys_folder), f"{self._root}/{KEYS}")
        return what

    # Connected.

    async def _listen(self, channel: ssh.Channel, lines: _Told) -> None:
        why = "the connection was closed"
        try:
            while (message := await lines.next()) is not None:
                self._heard_at = asyncio.get_running_loop().time()
                self._take(message)
                if self._closed.is_set():
                    return
            if not self._closing:
                why = await channel.said() or why
        except (OSError, asyncssh.Error, DeploymentError) as exc:
            why = shown(getattr(exc, "reason", "") or str(exc)) or type(exc).__name__
        self._lose(channel, why)

    async def _beat(self, channel: ssh.Channel) -> None:
        loop = asyncio.get_running_loop()
        now = awake_since = loop.time()
        while self._channel is channel:
            self._send(do="alive")
            lay_down = now
            await asyncio.sleep(BEAT)
            now = loop.time()
            if now - lay_down > 2 * BEAT:
                awake_since = now  # this process was held up itself, and could receive nothing
            if now - max(self._heard_at, awake_since) > SILENCE:
                self._lose(channel, f"no message for {SILENCE:g} s")

    def _take(self, message: Message) -> None:
        name = message.get("name", "")
        if "name" in message and not (isinstance(name, str) and name in self._names):
            return  # left by an earlier controller, and being ended
        match message["tell"]:
            case "output":
                self._listener.output(name, message["line"][:LINE].replace("\n", " "))
            case "lost_lines":
                self._note(
                    f"{self._host.name}: {message['count']} lines of output were dropped: the connection is too slow"
                )
            case "ready":
                self._listener.ready(name)
            case "status":
                self._listener.status(name, shown(message["text"]))
            case "left":
                self._listener.left(name, message["instance"])
            case "contract":
                operations = {shown(str(each)): shown(str(said)) for each, said in message["operations"].items()}
                self._listener.contract(name, message["instance"], operations)
            case "hung":
                self._listener.hung(name)
            case "exited":
                self._listener.exited(name, message["code"])
            case "usage":
                self._usage = {name: use for name, use in usage_of(message["of"]).items() if name in self._names}
            case "started":
                self._settle(name, None)
            case "failed":
                self._settle(name, DeploymentError(shown(message["why"])))
            case "refused":
                self._note(f"{ssh.called(self._host)}: {shown(message['why'])}")
            case "scout_line":
                if scout := self._scouts.get(message["id"]):
                    scout.hear(message["line"])
            case "scout_end":
                if scout := self._scouts.pop(message["id"], None):
                    scout.end(f"{ssh.called(self._host)}: {shown(message['why']) or 'its scout has ended'}")
            case "closed":
                self._closed.set()

    def _settle(self, name: str, error: DeploymentError | None) -> None:
        answer = self._starting.get(name)
        if answer and not answer.done():
            if error:
                answer.set_exception(error)
            else:
                answer.set_result(None)

    def _send(self, **message: Any) -> None:
        if self._channel:
            with contextlib.suppress(OSError, asyncssh.Error):  # the agent notices the closed connection
                self._channel.writer.write(packed(message))

    # Lost and found.

    def _lose(self, channel: ssh.Channel, why: str) -> None:
        if self._channel is not channel:
            return
        self._channel = None
        channel.abort()
        self._usage = {}
        self._lose_scouts(why)
        if self._closing:
            self._closed.set()
            return
        for name in list(self._starting):
            self._settle(name, DeploymentError(f"{name}: the connection to {ssh.called(self._host)} was lost"))
        self._listener.lost(self._host.name, why)
        self._task(self._find_again(), f"find {self._host.name}")

    async def _find_again(self) -> None:
        pause, told = FIRST_PAUSE, ""
        while True:
            await asyncio.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)
            try:
                await self._reach()
            except DeploymentError as exc:
                if str(exc) != told:
                    told = str(exc)
                    self._note(f"{told}; trying again")
                continue
            self._listener.back(self._host.name)
            return

    def _task(self, work: Any, name: str) -> None:
        task = asyncio.create_task(work, name=name)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


class _Told:
    """What comes from a host, in lines."""

    def __init__(self, channel: ssh.Channel) -> None:
        self._channel, self._lines = channel, Lines(LONGEST_TOLD)
        self._waiting: deque[Message] = deque()

    async def next(self, *, noise: bool = False) -> Message | None:
        """The next message; None at the end. With `noise`, other output may come before it.

        Raises OSError, asyncssh.Error, and DeploymentError if it is not understood.
        """
        while not self._waiting:
            data = await self._channel.reader.read(65536)
            if not data:
                return None
            self._waiting.extend(self._lines.feed(_without_noise(data) if noise else data))
        return heard(self._waiting.popleft())


def _without_noise(data: bytes) -> bytes:
    """What a shell says at its start comes before anything of ours, which begins with a brace."""
    if data.startswith(b"{"):
        return data
    _, newline, ours = data.partition(b"\n{")
    return newline[1:] + ours
