"""Other processes of the fault suite: what each of them does, and how a test controls it."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any, Protocol, TypeAlias

from ..contract.qos import QoS, Reliability
from ..errors import Timeout, Unreachable
from ..transports.base import Caller, Capability, Outlet, Reply, Status, Transport
from ..wire.codec import Payload
from .parts import A_MOMENT, answering, asker, blob, command, processes, query, start_process, topic, unblob
from .patience import SOON

LARGE = 6_000_000
FLOOD = 3000
"""Messages of MESSAGE octets: twice the memory that a flood may cost."""
MESSAGE = 100_000
RELIABLE = QoS(Reliability.RELIABLE, depth=4)

Control: TypeAlias = "Connection[Any, Any]"
Act: TypeAlias = Callable[[Transport, str, "Control"], None]
"""What another process does, on a transport of its own; when it returns, that process ends properly."""


class Suite(Protocol):
    """What opens transports in another process."""

    def open_transport(self) -> Transport: ...

    def open_as_another_user(self) -> Transport: ...


class Other:
    """Another process with a transport of its own."""

    def __init__(self, suite: type[Suite], name: str, act: Act, folder: str = "") -> None:
        """`folder` is its run-time folder, to act as another user."""
        self._control, theirs = processes.Pipe()
        self._process = start_process(_live, suite, name, act, theirs, folder)
        theirs.close()

    def tell(self, what: object) -> None:
        self._control.send(what)

    def heard(self) -> Any:
        """Its next message."""
        assert self._control.poll(SOON * 3)
        return self._control.recv()

    def all_heard(self) -> list[Any]:
        """All its messages until its end."""
        said = []
        with contextlib.suppress(EOFError, ConnectionResetError):
            while self._control.poll(0):
                said.append(self._control.recv())
        return said

    def stop(self) -> None:
        """Stop the process, so that it hangs."""
        assert self._process.pid is not None
        os.kill(self._process.pid, signal.SIGSTOP)

    def go_on(self) -> None:
        assert self._process.pid is not None
        os.kill(self._process.pid, signal.SIGCONT)

    def join(self) -> None:
        """Wait until it has ended."""
        self._process.join(SOON)
        assert not self._process.is_alive()

    def kill(self) -> None:
        self._process.kill()
        self._process.join()


Start: TypeAlias = Callable[..., Other]
"""Of an `Act`, and the run-time folder of another user, if it is one."""


def _live(suite: type[Suite], name: str, act: Act, control: Control, folder: str) -> None:
    if folder:
        os.environ["ROBOCOMP_RUNTIME_DIR"] = folder
    transport = suite().open_as_another_user() if folder else suite().open_transport()
    try:
        act(transport, name, control)
    finally:
        transport.close()


# What they do.


def _until_told(control: Control) -> None:
    """Wait for a message, or for the end of the parent process."""
    with contextlib.suppress(EOFError):
        if control.poll(SOON * 10):
            control.recv()


def reply_and_die(transport: Transport, name: str, control: Control) -> None:
    reply = blob(transport, large_bytes(1))

    def service(payload: Payload, expires: float) -> Reply:
        control.send("replying")
        threading.Timer(0.001, os.kill, (os.getpid(), signal.SIGKILL)).start()  # it takes longer than that to write
        return Reply(Status.OK, reply)

    transport.server(query(name), service)
    control.send("serving")
    _until_told(control)


def ask_again_and_again(transport: Transport, name: str, control: Control) -> None:
    caller, say = transport.caller(query(name)), threading.Lock()
    assert caller.wait_peer(SOON)

    def ask(numbers: range) -> None:
        for number in numbers:
            asker(transport, caller, "ask")(b"%d" % number)
            with say:
                control.send(number)

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(ask, (range(1, 100_000, 2), range(2, 100_000, 2))))


def ask_in_a_loop(transport: Transport, name: str, control: Control) -> None:
    caller, word = transport.caller(query(name)), control.recv()
    assert caller.wait_peer(SOON)
    assert asker(transport, caller, "ask")(word) == word
    control.send("answered")
    while not control.poll(0):
        asker(transport, caller, "ask")(word)
    control.send("stopped")


def ask_without_waiting(transport: Transport, name: str, control: Control) -> None:
    caller, room = transport.caller(query(name)), threading.Semaphore(200)
    assert caller.wait_peer(SOON)
    while not control.poll(0):
        if room.acquire(timeout=A_MOMENT):
            caller.call(blob(transport, b"flood"), SOON * 3).add_done_callback(lambda _: room.release())


def publish_again_and_again(transport: Transport, name: str, control: Control) -> None:
    outlet = transport.outlet(topic(name))
    assert outlet.wait_peer(SOON)
    messages = [blob(transport, large_bytes(value)) for value in (1, 2, 3)]
    while not control.poll(0):
        for message in messages:
            outlet.send(message)


def listen(transport: Transport, name: str, control: Control) -> None:
    say = threading.Lock()

    def heard(payload: Payload) -> None:
        with say:
            control.send(unblob(transport, payload))

    transport.inlet(topic(name, QoS(depth=4)), heard)
    if Capability.RELIABLE in transport.capabilities:
        transport.inlet(topic(name + "r", QoS(Reliability.RELIABLE, depth=4)), heard)
    with say:
        control.send("listening")
    _until_told(control)


def take_numbers(transport: Transport, name: str, control: Control) -> None:
    transport.inlet(topic(name, RELIABLE), lambda payload: control.send(number_of(transport, payload)))
    control.send("listening")
    _until_told(control)


def listen_as_tap(transport: Transport, name: str, control: Control) -> None:
    channel = replace(topic(name, QoS(depth=4)), tap=True)
    transport.inlet(channel, lambda payload: control.send(number_of(transport, payload)))
    control.send("listening")
    _until_told(control)


def take_commands(transport: Transport, name: str, control: Control) -> None:
    transport.inlet(command(name), lambda payload: control.send(number_of(transport, payload)))
    control.send("listening")
    _until_told(control)


def open_everything(transport: Transport, name: str, control: Control) -> None:
    everything(transport, name)
    control.send("open")
    _until_told(control)


def flood(transport: Transport, name: str, control: Control) -> None:
    outlet, number = transport.outlet(topic(name, QoS(depth=4))), 0
    assert outlet.wait_peer(SOON)
    while not control.poll(0.005):  # until the first one was heard
        outlet.send(numbered(transport, number))
        number += 1
    control.recv()
    control.send(number - 1)
    control.recv()
    control.send(_flooded(transport, outlet, number, max(FLOOD, number + FLOOD)))
    number = max(FLOOD, number + FLOOD)
    while not control.poll(0.005):  # slowly, so that these arrive and reveal earlier losses
        number += 1
        outlet.send(numbered(transport, number))
    control.recv()
    control.send(number)
    _until_told(control)


def flood_reliably(transport: Transport, name: str, control: Control) -> None:
    outlet = transport.outlet(topic(name, QoS(Reliability.RELIABLE, depth=16)))
    assert outlet.wait_peer(SOON)
    while not control.poll(0.005):
        outlet.send(numbered(transport, 0))
    control.recv()
    control.send(_flooded(transport, outlet, 1, FLOOD))
    _until_told(control)


def _flooded(transport: Transport, outlet: Outlet, first: int, last: int) -> str:
    """Send these messages at full speed; return the rate as a text."""
    begun = time.monotonic()
    for number in range(first, last + 1):
        outlet.send(numbered(transport, number), SOON)
    taken = time.monotonic() - begun
    return f"{last + 1 - first} messages of {MESSAGE} octets at {(last + 1 - first) / taken:.0f}/s"


# What both sides use.


def large_bytes(value: int) -> bytes:
    return bytes([value]) * LARGE


def numbered(transport: Transport, number: int) -> Payload:
    return blob(transport, b"%08d" % number + bytes(MESSAGE - 8))


def number_of(transport: Transport, payload: Payload) -> int:
    return int(unblob(transport, payload)[:8])


def answered(transport: Transport, caller: Caller, how: str, data: bytes) -> bytes | None:
    try:
        return asker(transport, caller, how)(data)
    except (Unreachable, Timeout):
        return None  # it still uses the killed one


def everything(transport: Transport, name: str) -> None:
    """An open link of every kind, used as far as possible within one process."""
    transport.server(query(name), answering(transport, bytes.upper))
    transport.inlet(command(name + "c"), lambda _: None)
    transport.inlet(topic(name + "t"), lambda _: None)
    outlet, caller = transport.outlet(topic(name + "t")), transport.caller(query(name))
    assert outlet.wait_peer(SOON)
    assert caller.wait_peer(SOON)
    outlet.send(blob(transport, bytes(MESSAGE)))
    assert answered(transport, caller, "ask", b"x") == b"X"
