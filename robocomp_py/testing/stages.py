"""Where a component under test runs: in real time on a thread, or in virtual time."""

from __future__ import annotations

import contextlib
import itertools
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Protocol, TypeVar

from ..errors import TransportError
from ..runtime.clock import ns
from ..runtime.monitor import Threads
from ..runtime.run import Running
from ..runtime.settings import Settings
from ..runtime.worker import Worker
from ..threads import fulfil
from ..transports.base import Caller, Channel, Outlet, Reply, Transport, TransportConfig
from ..transports.inproc import InprocTransport
from ..virtual.executor import Executor, Pause
from ..virtual.simulation import Simulated
from ..virtual.transport import Air, VirtualTransport
from ..virtual.turns import TurnClock, TurnThreads
from ..wire.codec import Codec, Payload
from .patience import SOON, wait_until

R = TypeVar("R")

Hindered = Callable[[Channel, Payload, Codec], TransportError | None]
"""The error with which a command or publication of the component ends; None if it is sent."""

_GRACE = 5.0
"""Virtual seconds that a component has to end."""

_buses = itertools.count(1)


class Stage(Protocol):
    running: Running
    threads: Threads | None

    def open(self) -> Transport:
        """The transport of the fakes."""
        ...

    def start(self) -> None: ...

    def wait(self, condition: Callable[[], object], timeout: float, what: str = "") -> None:
        """Wait until a condition holds or the component has ended. Raises AssertionError after `timeout` seconds."""
        ...

    def run(self, seconds: float) -> None: ...

    def do(self, call: Callable[[], R]) -> R:
        """Make a call to the component, from outside of it."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait in a fake, until the end of the test at most."""
        ...

    def every(self, seconds: float, call: Callable[[], object]) -> None:
        """Make a call again and again, until the end of the test."""
        ...

    def stop(self, fakes: Transport) -> bool:
        """Stop the component; returns whether it has ended."""
        ...


class RealTime:
    threads = None

    def __init__(self, worker: type[Worker[Any]], settings: Settings, hindered: Hindered, *, hand_over: bool) -> None:
        bus = f"test-{next(_buses)}"
        self.running = Running(
            worker,
            settings,
            lambda name: lambda config: _Faced(InprocTransport(TransportConfig({"bus": bus}, config.owner)), hindered),
        )
        self._options = {"bus": bus, "hand_over": hand_over}
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self.running.run, name="component under test")
        self._beats: threading.Thread | None = None

    def open(self) -> Transport:
        return InprocTransport(TransportConfig(self._options, "test"))

    def start(self) -> None:
        self._thread.start()

    def wait(self, condition: Callable[[], object], timeout: float, what: str = "") -> None:
        wait_until(lambda: condition() or not self._thread.is_alive(), timeout, what)

    def run(self, seconds: float) -> None:
        self._thread.join(seconds)

    def do(self, call: Callable[[], R]) -> R:
        return call()

    def sleep(self, seconds: float) -> None:
        self._ending.wait(seconds)

    def every(self, seconds: float, call: Callable[[], object]) -> None:
        def again() -> None:
            while not self._ending.wait(seconds):
                call()

        self._beats = threading.Thread(target=again, name="beats of fakes")
        self._beats.start()

    def stop(self, fakes: Transport) -> bool:
        self._ending.set()
        self.running.stop()
        if self._beats:
            self._beats.join(SOON)
        if self._thread.ident is not None:
            self._thread.join(3 * SOON)
        assert isinstance(fakes, InprocTransport)
        with contextlib.suppress(AssertionError):  # a fake that is stuck: the links say so when they are closed
            wait_until(lambda: fakes.idle, SOON, "the fakes have received what was sent to them")
        return not self._thread.is_alive()


class VirtualTime:
    def __init__(self, worker: type[Worker[Any]], settings: Settings, hindered: Hindered, *, hand_over: bool) -> None:
        self._executor = Executor()
        self.threads = TurnThreads(self._executor)
        self._air, self._hand_over = Air(self._executor, _NobodyListens()), hand_over
        self.running = Running(
            worker,
            settings,
            lambda name: lambda config: _Faced(VirtualTransport(self._air, config.owner, "test"), hindered),
            clock=TurnClock(self._executor),
            threads=self.threads,
            seed=0,
        )

    def open(self) -> Transport:
        return VirtualTransport(self._air, "test", "test", hand_over=self._hand_over)

    def start(self) -> None:
        self.running.begin()
        self._executor.add(Simulated(self.running, self.running.settings.instance))

    def wait(self, condition: Callable[[], object], timeout: float, what: str = "") -> None:
        end = self._executor.now + ns(timeout)
        while not condition() and not self.running.is_over:
            if not self._executor.run_next(end):  # one by one, so that the condition is looked at on this thread
                raise AssertionError(f"not in {timeout:g} s: {what or getattr(condition, '__name__', condition)}")

    def run(self, seconds: float) -> None:
        self._executor.run(lambda: self.running.is_over, self._executor.now + ns(seconds))

    def do(self, call: Callable[[], R]) -> R:
        if self._executor.in_own_thread:  # in a fake
            return call()
        result: Future[R] = Future()
        self._executor.do(lambda: fulfil(result, call))
        self._executor.run(result.done, self._executor.now + ns(2 * SOON))
        return result.result(0)

    def sleep(self, seconds: float) -> None:
        Pause(self._executor).wait(self._executor.now + ns(seconds))

    def every(self, seconds: float, call: Callable[[], object]) -> None:
        def again() -> None:
            call()
            self._executor.at(self._executor.now + ns(seconds), again)

        again()

    def stop(self, fakes: Transport) -> bool:
        self.running.stop()
        self._executor.run(lambda: self.running.is_over, self._executor.now + ns(_GRACE))
        self._executor.run(bool, self._executor.now)  # the fakes receive what was sent to them
        self._executor.close()
        self.running.end()
        return self.running.is_over


class _NobodyListens:
    def sent(self, sender: str, channel: Channel, payload: Payload) -> None: ...

    def answered(self, channel: Channel, reply: Reply) -> None: ...


# Fakes decide whether messages arrive.


class Raised:
    """Replaces a reply's payload: the error with which the component's call ends."""

    def __init__(self, error: TransportError) -> None:
        self.error = error


class _Faced:
    """The transport of the component under test."""

    def __init__(self, transport: Transport, hindered: Hindered) -> None:
        self._transport, self._hindered = transport, hindered

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def caller(self, channel: Channel) -> Any:
        return _FacedCaller(self._transport.caller(channel))

    def outlet(self, channel: Channel) -> Any:
        return _FacedOutlet(self._transport.outlet(channel), channel, self._transport.codec, self._hindered)


class _FacedCaller:
    def __init__(self, caller: Caller) -> None:
        self._caller = caller

    def __getattr__(self, name: str) -> Any:
        return getattr(self._caller, name)

    def ask(self, payload: Payload, deadline: float) -> Reply:
        return _outcome(self._caller.ask(payload, deadline))

    def call(self, payload: Payload, deadline: float) -> Future[Reply]:
        asked, answer = self._caller.call(payload, deadline), Future[Reply]()

        def ended(done: Future[Reply]) -> None:
            if done.cancelled() or not answer.set_running_or_notify_cancel():
                return
            try:
                answer.set_result(_outcome(done.result()))
            except BaseException as exc:  # passed to the waiting caller
                answer.set_exception(exc)

        asked.add_done_callback(ended)
        return answer


def _outcome(reply: Reply) -> Reply:
    if isinstance(reply.payload, Raised):
        raise reply.payload.error
    return reply


class _FacedOutlet:
    def __init__(self, outlet: Outlet, channel: Channel, codec: Codec, hindered: Hindered) -> None:
        self._outlet, self._channel, self._codec, self._hindered = outlet, channel, codec, hindered

    def __getattr__(self, name: str) -> Any:
        return getattr(self._outlet, name)

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        error = self._hindered(self._channel, payload, self._codec)
        if error:
            raise error
        self._outlet.send(payload, deadline)
