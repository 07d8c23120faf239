"""The suite for `self.caller`: whether handlers learn over a transport which instance called, or sent a message.

class TestMine(CallersConformance):
    def open_transport(self, owner="test"):
        return MyTransport(TransportConfig(owner=owner))
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import pytest

from ..contract.component import Component, Port
from ..contract.interface import Verb
from ..runtime import settings
from ..runtime.instances import NamedProxies
from ..runtime.run import Running
from ..runtime.worker import Worker
from .instances import NEWS, TELLER, NewsPublisher, TellerProxy, started_until
from .parts import ComponentSuite
from .patience import SOON, wait_until


class _Base(Worker[None]):
    middleware = "tested"
    reads_caller = True
    period = 1.0

    def __init__(self) -> None:
        self.errands: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        """What `compute` has to do."""

    def compute(self) -> None:
        while not self.errands.empty():
            self.errands.get()()


class Hub(_Base):
    """Notes the callers of all its handlers."""

    component = Component(
        "hub",
        (
            Port(Verb.IMPLEMENTS, TELLER),
            Port(Verb.SUBSCRIBES, NEWS),
            Port(Verb.REQUIRES, TELLER, proxy=TellerProxy),
        ),
        period=0.01,
    )
    teller_proxy: TellerProxy

    def __init__(self) -> None:
        super().__init__()
        self.heard: queue.Queue[tuple[str, int]] = queue.Queue()
        self.noted: queue.Queue[tuple[str, int]] = queue.Queue()
        self.outside: list[str] = []

    def compute(self) -> None:
        self.outside.append(self.caller)
        super().compute()

    def Teller_tell(self, what: str) -> str:
        before = self.caller
        if what == "nested":  # other handlers run meanwhile
            answer = self.teller_proxy.tell("inner")
            return f"{before} {answer} {self.caller}"
        return f"{what} of {before}"

    def Teller_note(self, number: int) -> None:
        self.noted.put((self.caller, number))

    def News_push(self, number: int) -> None:
        self.heard.put((self.caller, number))


class Concurrent(Hub):
    """Several handlers at a time."""

    component = replace(
        Hub.component,
        ports=tuple(replace(port, concurrent=not port.verb.has_proxy) for port in Hub.component.ports),
    )

    def __init__(self) -> None:
        super().__init__()
        self.inside = threading.Barrier(2)

    def Teller_tell(self, what: str) -> str:
        before = self.caller
        self.inside.wait(SOON)
        return f"{before} {self.caller}"


class Peer(_Base):
    """Calls the hub, and publishes by its own name and as further ones."""

    component = Component(
        "peer",
        (
            Port(Verb.REQUIRES, TELLER, proxy=TellerProxy),
            Port(Verb.PUBLISHES, NEWS, each=True, proxy=NewsPublisher),
        ),
        period=0.01,
    )
    teller_proxy: TellerProxy
    news: NamedProxies[NewsPublisher]


class Echo(_Base):
    """Is asked by the hub."""

    component = Component("echo", (Port(Verb.IMPLEMENTS, TELLER),), period=0.01)

    def Teller_tell(self, what: str) -> str:
        return f"{what} of {self.caller}"

    def Teller_note(self, number: int) -> None:
        pass


class CallersSuite(ComponentSuite):
    """The base of tests of callers."""

    @pytest.fixture
    def start(self, ending: ExitStack) -> Callable[..., Any]:
        """Starts a component; returns its worker once it is ready."""

        def start(kind: type[Worker[Any]], name: str, *sets: str) -> Any:
            document = settings.Document()
            for assignment in sets:
                settings.override(document, assignment)
            checked = settings.check(kind.component, document, name)
            running = Running(kind, checked, lambda _: lambda config: self.open_transport(config.owner))
            return started_until(ending, running)

        return start


class CallersConformance(CallersSuite):
    """The tests. The announcement of a client may come after its first calls; until then its name is not known."""

    def test_a_handler_learns_which_instance_called(self, start: Callable[..., Any]) -> None:
        start(Echo, "echo")
        start(Hub, "hub", "ports.teller.from=echo")
        left, right = (start(Peer, name, "ports.teller.from=hub") for name in ("left", "right"))
        for name, peer in (("left", left), ("right", right)):
            self._ask_until(peer, "hello", f"hello of {name}")
        assert left.teller_proxy.tellAsync("again").result(SOON) == "again of left"

    def test_a_command_has_its_sender(self, start: Callable[..., Any]) -> None:
        start(Echo, "echo")
        hub = start(Hub, "hub", "ports.teller.from=echo")
        for name in ("left", "right"):
            proxy = start(Peer, name, "ports.teller.from=hub").teller_proxy

            def noted(proxy: TellerProxy = proxy) -> str:
                proxy.note(1)
                sender, number = hub.noted.get(timeout=SOON)
                assert number == 1
                return str(sender)

            wait_until(noted)
            assert noted() == name

    def test_a_publication_has_its_instance(self, start: Callable[..., Any]) -> None:
        start(Echo, "echo")
        hub = start(Hub, "hub", "ports.teller.from=echo")
        peer = start(Peer, "peer", "ports.teller.from=hub")
        names = ("peer", "front", "back")
        proxies = [peer.news.add(name) for name in names]
        heard: set[tuple[str, int]] = set()

        def all_are_heard() -> bool:
            for number, proxy in enumerate(proxies):
                proxy.push(number)
            while not hub.heard.empty():
                heard.add(hub.heard.get())
            return len(heard) >= len(names)

        wait_until(all_are_heard)
        assert heard == {(name, number) for number, name in enumerate(names)}

    def test_the_caller_stays_the_same_while_a_handler_waits(self, start: Callable[..., Any]) -> None:
        start(Echo, "echo")
        hub = start(Hub, "hub", "ports.teller.from=echo")
        peer = start(Peer, "peer", "ports.teller.from=hub")
        self._ask_until(peer, "nested", "peer inner of hub peer")
        assert set(hub.outside) == {""}, "compute has no caller"

    def test_handlers_that_run_at_once_have_their_own_callers(self, start: Callable[..., Any]) -> None:
        start(Echo, "echo")
        start(Concurrent, "hub", "ports.teller.from=echo")
        peers = [start(Peer, name, "ports.teller.from=hub") for name in ("left", "right")]

        def answers() -> list[str]:
            asked = [peer.teller_proxy.tellAsync("now") for peer in peers]
            return [answer.result(SOON) for answer in asked]

        wait_until(lambda: answers() == ["left left", "right right"])

    @staticmethod
    def _ask_until(peer: Peer, what: str, answer: str) -> None:
        wait_until(lambda: peer.teller_proxy.tell(what) == answer)
