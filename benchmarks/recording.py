"""Measures `rc record` while another process publishes 6 MB at 30 Hz and 200 octets at 1 kHz, which is 180 MB/s.

The pictures are random, so no compression makes them smaller. The recording is written into the folder for temporary
files. Lost are messages that were published and are not in the recording, wherever they were lost.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robocomp_py.contract.component import Port
from robocomp_py.contract.interface import Interface, Operation, Verb
from robocomp_py.contract.qos import QoS
from robocomp_py.runtime import ports
from robocomp_py.runtime.monitor import Monitor
from robocomp_py.runtime.route import Route
from robocomp_py.transports.base import Link, TransportConfig, find_transport

from .goals import Finding, failed
from .ours import BYTES, IMPLEMENTS, Handlers
from .pair import place
from .parties import BROKERED, FAILURES, PATIENCE
from .process import ROOT, cpu_seconds, running
from .query import Tell
from .rounds import Effort
from .scale.crowd import Control, Member, together
from .tables import Table

COMPRESSIONS = ("none", "lz4")
PROCESSOR, MEMORY = 60.0, 356.0
"""Goals, in % of one core and in MB."""

LARGE, LARGE_HZ = 6_000_000, 30
SMALL, SMALL_HZ = 200, 1000

SETTLED = 1.5
"""Seconds until what was subscribed is connected, and until the last messages are written."""

_seen: Operation[None] = Operation("Benchmark::Camera", "seen", BYTES)
_moved: Operation[None] = Operation("Benchmark::Wheel", "moved", BYTES)


@dataclass(frozen=True)
class Row:
    """Of one recording. The processor is that of `rc record`, in % of one core; memory is its largest, in MB."""

    middleware: str
    compress: str
    rate: float
    """MB published each second: less than wanted if the publisher was too slow."""
    sent: int
    large: int
    small: int
    """Large and small messages that were lost."""
    dropped: int
    """Of both, those that were lost because the disk was too slow."""
    processor: float
    memory: float
    failure: str = ""

    @property
    def lost(self) -> int:
        return self.large + self.small

    @property
    def is_good(self) -> bool:
        return not self.lost and self.processor <= PROCESSOR and self.memory <= MEMORY


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> list[Row]:
    rows = []
    for middleware in middlewares:
        if middleware == "inproc" or middleware in BROKERED:
            continue  # no other process hears the first; the others cannot tell what uses them
        for compress in COMPRESSIONS:
            tell(f"record · {middleware} · {compress}")
            try:
                rows.append(_recorded(middleware, compress, effort.watched))
            except FAILURES as exc:
                rows.append(Row(middleware, compress, 0.0, 0, 0, 0, 0, 0.0, 0.0, f"{exc}"))
    return rows


def _recorded(middleware: str, compress: str, seconds: float) -> Row:
    name = f"benchmark{os.getpid()}"
    with place(), tempfile.TemporaryDirectory(prefix="rc-") as folder, contextlib.ExitStack() as undo:
        publisher = Member(_publish, middleware, name, seconds, fresh=True)
        undo.enter_context(together(publisher))
        publisher.told()
        command = [sys.executable, "-m", "robocomp_py.cli.rc", "record", name, "-o", f"{folder}/run", "--json"]
        command += ["--middleware", middleware, "--compress", compress]
        recorder = undo.enter_context(
            running(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        )
        assert recorder.stderr
        said = [recorder.stderr.readline() for _ in range(2)]
        if not all(f" over {middleware}" in line for line in map(str, said)):
            raise RuntimeError(f"{middleware}: rc record says {' '.join(map(str, said)).strip()}")
        time.sleep(SETTLED)
        before = cpu_seconds(recorder.pid)
        publisher.say("go")
        took, sent = publisher.told(10 * seconds + PATIENCE)
        time.sleep(SETTLED)
        processor, memory = (cpu_seconds(recorder.pid) - before) / took * 100, _largest(recorder.pid)
        recorder.send_signal(signal.SIGINT)
        out, errors = recorder.communicate(timeout=6 * PATIENCE)
        told = _topics(str(out), str(errors))
    rate = (sent["seen"] * LARGE + sent["moved"] * SMALL) / took / 1e6
    written = {each["channel"].rpartition("/")[2]: each["messages"] for each in told}
    lost = {operation: number - written[operation] for operation, number in sent.items()}
    return Row(
        middleware,
        compress,
        rate,
        sum(sent.values()),
        lost[_seen.name],
        lost[_moved.name],
        sum(each["dropped"] for each in told),
        processor,
        memory,
    )


def _topics(out: str, errors: str) -> list[dict[str, Any]]:
    try:
        topics: list[dict[str, Any]] = json.loads(out)["topics"]
    except ValueError as exc:
        raise RuntimeError(f"rc record failed: {errors.strip()}") from exc
    return topics


def _largest(pid: int) -> float:
    """The most memory that a process has had, in MB; what it shares with others is included."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1000 for line in lines if line.startswith("VmHWM:"))


# The other process.


def _publish(control: Control, middleware: str, name: str, seconds: float) -> None:
    transport, monitor, links = find_transport(middleware)(TransportConfig(owner=name)), Monitor(), list[Link]()

    def route(port: Port, operation: Operation[Any]) -> Route:
        channel = f"{name}/{port.interface.short}/{operation.name}"
        return Route(transport, "", channel, QoS(), PATIENCE)

    def publishes(operation: Operation[None]) -> Callable[[np.ndarray[Any, Any]], object]:
        port = Port(Verb.PUBLISHES, Interface(operation.interface, (operation,)), proxy=ports.Proxy)
        proxy, _ = ports.bind_proxy(port, route, monitor, links=links)
        return lambda data: proxy._send(operation, (data,), None)

    try:
        links += ports.bind_handlers(IMPLEMENTS, Handlers(lambda _: None), route, monitor)  # as each component serves
        acts = {_seen.name: (publishes(_seen), LARGE, LARGE_HZ), _moved.name: (publishes(_moved), SMALL, SMALL_HZ)}
        monitor.open()
        control.send("ready")
        control.recv()
        monitor.enter()
        control.send(_published(acts, seconds))
        monitor.leave()
        control.recv()  # until the recorder has ended
    finally:
        monitor.turn_away()
        ports.close_all(links)
        monitor.close()
        transport.close()


def _published(
    acts: dict[str, tuple[Callable[[np.ndarray[Any, Any]], object], int, int]], seconds: float
) -> tuple[float, dict[str, int]]:
    """How long it took, and how many messages were sent of each topic."""
    chance = np.random.default_rng(1)
    data = {name: chance.integers(0, 256, size, np.uint8) for name, (_, size, _) in acts.items()}
    sent = dict.fromkeys(acts, 0)
    begun = time.monotonic()
    while (passed := time.monotonic() - begun) < seconds:
        for name, (send, _, hertz) in acts.items():
            if sent[name] <= passed * hertz:
                send(data[name])
                sent[name] += 1
        ahead = min(sent[name] / hertz for name, (_, _, hertz) in acts.items()) - (time.monotonic() - begun)
        if ahead > 0:
            time.sleep(ahead)
    return time.monotonic() - begun, sent


# What is shown.


def table(rows: list[Row]) -> Table:
    head = (
        "",
        "compress",
        "published",
        "messages",
        "large lost",
        "small lost",
        "by the disk",
        "processor",
        "memory",
        "goals",
    )
    cells = [
        (
            row.middleware,
            row.compress,
            f"{row.rate:.0f} MB/s",
            f"{row.sent:,}",
            f"{row.large:,}",
            f"{row.small:,}",
            f"{row.dropped:,}",
            f"{row.processor:.0f} %",
            f"{row.memory:.0f} MB",
            "met" if row.is_good else "missed",
        )
        for row in rows
        if not row.failure
    ]
    note = "; ".join(f"{row.middleware} {row.compress} failed: {row.failure}" for row in rows if row.failure)
    title = f"rc record: {LARGE / 1e6:g} MB at {LARGE_HZ} Hz and {SMALL} B at {SMALL_HZ} Hz"
    return Table("record", title, head, cells, note=note)


def findings(rows: list[Row]) -> list[Finding]:
    return [
        failed("record", row.middleware, row.compress)
        if row.failure
        else Finding(
            "record",
            row.middleware,
            row.compress,
            f"{row.lost:,} of {row.sent:,}, {row.processor:.0f} %, {row.memory:.0f} MB",
            row.is_good,
            value=row.lost / max(1, row.sent) + row.processor / 1e6,
        )
        for row in rows
    ]
