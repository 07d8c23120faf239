"""Measures the processor time of a look by `rc monitor` and `rc top`, at 5 and at 500 components.

The 5 are those that are shipped, the commands are whole processes, and a browser reads the page of the monitor. Of 500
components, the announcements are read, but this process gives their answers, encoded: as many components would take
all of a small machine. What starts a command is not part of a look.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import pty
import select
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
import zlib
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from http.client import HTTPResponse
from pathlib import Path
from typing import Any

import numpy as np

from robocomp_py import installed
from robocomp_py.cli import top as rc_top
from robocomp_py.garbage import no_collection
from robocomp_py.runtime.calls import Call
from robocomp_py.runtime.RoboCompCommonBehavior import COMMONBEHAVIOR_INTERFACE
from robocomp_py.runtime.RoboCompIntrospection import INTROSPECTION_INTERFACE, Description, Measure, Measures
from robocomp_py.tools import asking
from robocomp_py.tools.access import Access
from robocomp_py.tools.census import take_census, take_each
from robocomp_py.tools.lookout import Lookout, Rounds
from robocomp_py.tools.monitor.server import Board
from robocomp_py.tools.monitor.view import connections, form, picture, told
from robocomp_py.tools.network import Channel
from robocomp_py.transports.base import Reply, Status
from robocomp_py.transports.directory import Directory
from robocomp_py.transports.members import Entry
from robocomp_py.wire.messagepack import MessagePack

from .components import COMPONENTS, component
from .ours import TOPIC, news
from .pair import place
from .parties import PATIENCE
from .process import ROOT, cpu_seconds, running

LOOKS, FIRST, EVERY = 8, 2, 0.25
"""Looks over which processor time is averaged, looks before them, and seconds from one to the next."""

WANDERS = 4
"""Components beside the world that they share."""

Look = Callable[[], object]


@contextlib.contextmanager
def few(middleware: str) -> Iterator[str]:
    """A world and those that move in it; yields their run-time folder."""
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as runtime, contextlib.ExitStack() as undo:
        started = partial(component, folder=COMPONENTS, middleware=middleware, runtime=runtime, domain="default")
        undo.enter_context(started("world2d", instance="world"))
        for number in range(WANDERS):
            undo.enter_context(started("wander", instance=f"wander{number}"))
        yield runtime


def monitor(middleware: str, runtime: str) -> tuple[float, int]:
    """Seconds of processor time for a look, and the octets of the page."""
    command = _rc("monitor", "--json", "--every", f"{EVERY:g}", "--middleware", middleware)
    environment = os.environ | {"ROBOCOMP_RUNTIME_DIR": runtime}
    with running(command, cwd=ROOT, stdout=subprocess.PIPE, env=environment) as process:
        assert process.stdout
        url = json.loads(process.stdout.readline())["url"]
        with urllib.request.urlopen(url, timeout=PATIENCE) as page:
            octets = len(page.read())
        asked = urllib.request.Request(url.replace("/?", "/events?"), headers={"Accept-Encoding": "gzip"})
        with urllib.request.urlopen(asked, timeout=PATIENCE) as events:
            return _of_a_look(process.pid, _looks_of(events)), octets


def top(middleware: str, runtime: str) -> float:
    """Seconds of processor time for a look, shown in a terminal."""
    ours, its = pty.openpty()
    command = _rc("top", "--every", f"{EVERY:g}", "--middleware", middleware)
    environment = os.environ | {"ROBOCOMP_RUNTIME_DIR": runtime, "COLUMNS": "200", "LINES": "60"}  # the head is whole
    with (
        os.fdopen(ours, "rb", buffering=0) as screen,
        running(command, cwd=ROOT, stdout=its, stderr=its, env=environment) as process,
    ):
        os.close(its)
        return _of_a_look(process.pid, _tables_of(screen))


def _looks_of(events: HTTPResponse) -> Iterator[object]:
    """One after the other, as the page gets them. The first one comes twice: with a picture, and before it."""
    unpacker, text, last = zlib.decompressobj(wbits=zlib.MAX_WBITS | _GZIP), b"", None
    while packed := events.read1():
        *lines, text = (text + unpacker.decompress(packed)).split(b"\n")
        for line in lines:
            if line.startswith(b"data: {") and (at := json.loads(line.removeprefix(b"data: "))["at"]) != last:
                last = at
                yield at


_GZIP = 16
"""What makes zlib read gzip."""


def _tables_of(screen: io.FileIO) -> Iterator[object]:
    """One after the other, as the terminal gets them: each has this word in its head once."""
    text = b""
    while select.select([screen], [], [], PATIENCE)[0] and (read := screen.read(65536)):
        *heads, text = (text + read).split(b"suspended")
        yield from heads


def _of_a_look(pid: int, looks: Iterator[object]) -> float:
    for _ in range(FIRST):
        next(looks)
    before = cpu_seconds(pid)
    for _ in range(LOOKS):
        next(looks)
    return (cpu_seconds(pid) - before) / LOOKS


def _rc(*words: str) -> list[str]:
    return [sys.executable, "-m", "robocomp_py.cli.rc", *words]


# Many components.


def many(number: int, rounds: int) -> tuple[float, float]:
    """Seconds of processor time for a look of the monitor, and for one of `rc top`; medians."""
    with place() as here, announced(Path(here.folder), number, ring=True), _Answers() as access:
        looks = _monitor(access), _top(access)
        monitor, top = (statistics.median(_seconds_of(look, access, rounds)) for look in looks)
        return monitor, top


@contextlib.contextmanager
def announced(runtime: Path, number: int, *, ring: bool = False) -> Iterator[None]:
    """Members of a directory that are as many components would be: without ports, or each with a topic that the next
    one hears."""
    folder = runtime / "zeromq"
    folder.mkdir(mode=0o700, exist_ok=True)
    directory = Directory(folder)
    with contextlib.ExitStack() as undo:
        for each in range(number):
            name, heard = f"component{each}", f"component{(each or number) - 1}"
            member = directory.join(name)
            undo.callback(member.close)
            ends = [("serves", name, interface, one) for interface in OWN for one in interface.operations]
            if ring:
                ends += [("publishes", name, TOPIC, news), ("subscribes", heard, TOPIC, news)]
            with member.gathered():
                for role, whose, interface, one in ends:
                    channel = f"{whose}/{interface.short}/{one.name}"
                    member.add(Entry(role, channel, one.fingerprint, one.text, "ipc:///nowhere"))
        yield


OWN = COMMONBEHAVIOR_INTERFACE, INTROSPECTION_INTERFACE
"""What every component serves."""


class _Answers(Access):
    """Answers what components are asked, without them."""

    def __init__(self) -> None:
        super().__init__()
        self._codec, self._begun = MessagePack(), time.monotonic()
        self._calls: dict[str, Call[Any]] = {}
        self._given: dict[str, Reply] = {}
        self.go_on()

    def go_on(self) -> None:
        """From now on, answers are of now."""
        awake = time.monotonic() - self._begun + 1000
        latest = np.full(256, 1e-4, np.float32)
        ends = ("publishes", "subscribesTo")
        operations = [
            Measure("topic", verb, news.name, "*/Topic/news", "", int(awake), 0, 256, latest) for verb in ends
        ]
        measures = Measures(time.time_ns(), awake, "compute", 1.0, int(awake), operations=operations)
        for name, value in (
            ("describe", Description("component", "component", "host", os.getpid())),
            ("measure", measures),
        ):
            (operation,) = (each for each in INTROSPECTION_INTERFACE.operations if each.name == name)
            self._given[name] = Reply(Status.OK, self._codec.encoder(operation.response)((value,)))

    def keep(self, channels: Iterable[Channel]) -> None: ...

    def ask_again(self, channel: Channel, values: tuple[Any, ...], deadline: float) -> tuple[Any, ...]:
        call = self._calls.get(channel.name)
        if call is None:
            call = self._calls[channel.name] = Call(channel.operation, self._codec)
        call.encode(values)
        return (call.result(self._given[channel.operation.name]),)


def _monitor(access: _Answers) -> Look:
    """A look of `rc monitor`, without the picture: it is drawn when its shape changes."""
    lookout, board = Lookout(access, lambda: None, partial(take_each, ["zeromq"])), Board()

    def look() -> None:
        found = lookout.look()
        with no_collection():
            arrows = connections(found)
            graph = picture(found, arrows)
            form(graph)
            board.show(told(found, graph, arrows))

    return look


def _top(access: _Answers) -> Look:
    rounds, options = Rounds(access), argparse.Namespace(all=False)

    def look() -> None:
        network = take_census(["zeromq"])
        answers = rounds.ask(network, asking.components(network), PATIENCE)
        heard = {each.name for each in network.channels.values() if each.users}
        rc_top.lines([rc_top.mark_unheard(each.now, heard) for each in answers.values()], options)

    return look


def _seconds_of(look: Look, access: _Answers, rounds: int) -> list[float]:
    """Processor time of each look, after the first one."""
    taken = []
    with installed.asked_once():
        for _ in range(rounds + 1):
            access.go_on()
            begun = time.process_time()
            look()
            taken.append(time.process_time() - begun)
    return taken[1:]
