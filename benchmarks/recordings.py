"""Measures what is done with recordings: how late a replay is, how fast a component runs again, and what a killed
recorder loses.

All commands are whole processes, over shared memory. A message is late by the time from when it was due until it is
heard in another process; what is due is counted from the message that came soonest. What a killed recorder loses is the
time from the newest message that `rc bag mend` saves to the end of the recorder, of several that are killed at
different times after they last wrote.
"""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from robocomp_py.contract.component import Port
from robocomp_py.contract.interface import Interface, Operation, Pattern, Verb
from robocomp_py.contract.qos import QoS, Reliability
from robocomp_py.runtime import ports
from robocomp_py.runtime.monitor import Monitor
from robocomp_py.runtime.route import Route
from robocomp_py.tools.recording.bag import BagWriter
from robocomp_py.tools.recording.layout import Topic
from robocomp_py.tools.recording.reader import Recording
from robocomp_py.transports.base import Link, TransportConfig, find_transport
from robocomp_py.wire.cdr import Cdr

from .components import COMPONENTS, component
from .ours import BYTES, PUBLISHES, news
from .pair import place
from .parties import INT, PATIENCE, Array, stamp
from .process import ROOT, running
from .scale.crowd import Control, Member, together

MIDDLEWARE = "shm"

SECONDS = 3.0
"""Of the recording that is replayed, and of the diary."""

KILLED, AFTER, APART = 4, 2.5, 0.22
"""Recorders that are killed; seconds from their start until the first one is, and from one to the next."""

_scanned: Operation[None] = Operation("Benchmark::Laser", "scanned", BYTES, pattern=Pattern.PUBLISH)
_seen: Operation[None] = Operation("Benchmark::Eye", "seen", BYTES, pattern=Pattern.PUBLISH)
_MIX = ((_scanned, 200, 100), (_seen, 300_000, 30))
"""What is replayed: octets, and messages a second."""

_QOS = QoS(Reliability.RELIABLE, depth=1000)


def lateness() -> float:
    """Seconds by which a hundredth of the messages of a replay are late, or more."""
    with place(), tempfile.TemporaryDirectory(prefix="rc-") as folder:
        due = _recorded(Path(folder, "run"))
        heard = _Heard()
        transport, monitor, links = find_transport(MIDDLEWARE)(TransportConfig()), Monitor(), list[Link]()
        try:
            for operation, _, _ in _MIX:
                port = Port(Verb.SUBSCRIBES, Interface(operation.interface, (operation,)), qos=_QOS)
                links += ports.bind_handlers(
                    port,
                    heard,
                    lambda port, operation: Route(transport, "", _channel(operation), _QOS, PATIENCE),
                    monitor,
                )
            monitor.open()
            _rc("replay", f"{folder}/run", "--middleware", MIDDLEWARE)
            monitor.turn_away()
        finally:
            ports.close_all(links)
            monitor.close()
            transport.close()
        if len(heard.times) != due:
            raise RuntimeError(f"of {due} replayed messages, {len(heard.times)} were heard")
        late = sorted(arrived - position for position, arrived in heard.times)
        return (late[len(late) * 99 // 100] - late[0]) / 1e9


class _Heard:
    def __init__(self) -> None:
        self.times: list[tuple[int, int]] = []
        """Of each message: when it is due, from the beginning of the recording, and when it came; in ns."""

    def Laser_scanned(self, data: Array) -> None:
        self.times.append((INT.unpack_from(data.data)[0], time.monotonic_ns()))

    Eye_seen = Laser_scanned


def _recorded(folder: Path) -> int:
    """Write the recording; the number of its messages."""
    writer, encode = BagWriter(folder), Cdr().encoder(_seen.request)
    messages = sorted(
        (number * 1_000_000_000 // hertz, which, number)
        for which, (_, _, hertz) in enumerate(_MIX)
        for number in range(int(SECONDS * hertz))
    )
    topics = [writer.add(Topic(_channel(each), each, "recorder", MIDDLEWARE, _QOS)) for each, _, _ in _MIX]
    for position, which, number in messages:
        data = np.zeros(_MIX[which][1], np.uint8)
        INT.pack_into(data.data, 0, position)
        writer.write(topics[which], bytes(encode((data,))), 10**18 + position, 10**18 + position, number + 1)
    writer.close()
    return len(messages)


def _channel(operation: Operation[Any]) -> str:
    return f"recorded/{operation.interface.rpartition('::')[2]}/{operation.name}"


def speed() -> tuple[float, int]:
    """How many times faster than it was a shipped component runs again, and how many of its outputs differ."""
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as runtime:
        diary = f"{runtime}/wander.mcap"
        with (
            component("world2d", COMPONENTS, MIDDLEWARE, runtime=runtime),
            component(
                "wander", COMPONENTS, MIDDLEWARE, f"component.diary={diary}", runtime=runtime, PYTHONHASHSEED="1"
            ),
        ):
            time.sleep(SECONDS)
        told = json.loads(_rc("rerun", str(COMPONENTS / "wander"), diary, "--json"))
        return told["seconds"] / told["took"], len(told["differences"])


def loss() -> float:
    """Seconds of a recording that a killed recorder loses at most."""
    with place(), tempfile.TemporaryDirectory(prefix="rc-") as folder, contextlib.ExitStack() as undo:
        publisher = Member(_publish)
        undo.enter_context(together(publisher))
        publisher.told()
        recorders = []
        for number in range(KILLED):
            command = [*_RC, "record", "publisher", "-o", f"{folder}/{number}", "--middleware", MIDDLEWARE]
            recorder = undo.enter_context(running(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE))
            recorders.append(recorder)
        for recorder in recorders:
            assert recorder.stderr
            recorder.stderr.readline()  # it is subscribed
        time.sleep(AFTER)
        ends = []
        for recorder in recorders:
            time.sleep(APART)
            recorder.send_signal(signal.SIGKILL)
            ends.append(time.monotonic_ns())
        return max(ended - _newest(f"{folder}/{number}") for number, ended in enumerate(ends)) / 1e9


def _newest(folder: str) -> int:
    """When the last message was sent that a recording without an end has."""
    _rc("bag", "mend", folder, "-o", f"{folder}-whole")
    decode = Cdr().decoder(news.request)
    with Recording(Path(f"{folder}-whole")) as recording:
        *_, last = recording.messages()
        (data,) = decode(last.data)
        return int(INT.unpack_from(data.data)[0])


def _publish(control: Control) -> None:
    transport, monitor = find_transport(MIDDLEWARE)(TransportConfig(owner="publisher")), Monitor()
    proxy, links = ports.bind_proxy(
        PUBLISHES,
        lambda port, operation: Route(transport, "", f"publisher/Topic/{operation.name}", QoS(), PATIENCE),
        monitor,
    )
    try:
        monitor.open()
        monitor.enter()
        data = np.zeros(64, np.uint8)
        control.send("ready")
        while not control.poll(0.01):
            stamp(data)
            proxy._send(news, (data,), None)
        monitor.leave()
    finally:
        monitor.turn_away()
        ports.close_all(links)
        monitor.close()
        transport.close()


_RC = (sys.executable, "-m", "robocomp_py.cli.rc")


def _rc(*words: str) -> str:
    """What a command says."""
    done = subprocess.run([*_RC, *words], cwd=ROOT, capture_output=True, text=True, timeout=6 * PATIENCE)
    if done.returncode:
        raise RuntimeError(f"rc {words[0]} failed: {done.stderr.strip() or done.stdout.strip()}")
    return done.stdout
