"""The suite for named instances: whether a component can provide an interface under several names over a transport.

class TestMine(InstancesConformance):
    def open_transport(self, owner="test"):
        return MyTransport(TransportConfig(owner=owner))
"""

from __future__ import annotations

import queue
import threading
from abc import abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import ExitStack
from functools import partial
from typing import Any

import pytest

from ..contract.component import Component, Port
from ..contract.interface import Interface, Operation, Pattern, Verb
from ..contract.types import INT32, STRING, Field
from ..errors import AlreadyServed, Closed, Unreachable
from ..runtime import settings
from ..runtime.instances import InstanceHandler, NamedHandlers, NamedProxies
from ..runtime.monitor import Monitor
from ..runtime.ports import Proxy, bind_handlers, bind_proxy, close_all
from ..runtime.route import Route
from ..runtime.run import Running
from ..runtime.worker import Worker
from ..transports.base import Link, Transport
from .parts import ComponentSuite
from .patience import SOON, wait_until

_QUERY: Operation[str] = Operation(
    "Conformance::Teller", "tell", (Field("what", STRING),), (Field("ret", STRING),), (), Pattern.QUERY
)
_COMMAND: Operation[None] = Operation("Conformance::Teller", "note", (Field("number", INT32),), (), (), Pattern.COMMAND)
_PUBLICATION: Operation[None] = Operation(
    "Conformance::News", "push", (Field("number", INT32),), (), (), Pattern.PUBLISH
)
TELLER = Interface("Conformance::Teller", (_QUERY, _COMMAND))
NEWS = Interface("Conformance::News", (_PUBLICATION,))


class TellerHandler(InstanceHandler):
    """As rcgen generates it."""

    @abstractmethod
    def tell(self, what: str) -> str: ...

    @abstractmethod
    def note(self, number: int) -> None: ...


class Teller(TellerHandler):
    def __init__(self) -> None:
        self.noted: list[int] = []
        self.begun, self.go_on = threading.Event(), threading.Event()

    def tell(self, what: str) -> str:
        if what == "wait":
            self.begun.set()
            self.go_on.wait(SOON)
        return f"{self.instance}: {what}"

    def note(self, number: int) -> None:
        self.noted.append(number)


class TellerProxy(Proxy):
    interface = TELLER

    def tell(self, what: str, *, deadline: float | None = None) -> str:
        return self._ask(_QUERY, (what,), deadline)

    def tellAsync(self, what: str, *, deadline: float | None = None) -> Future[str]:
        return self._ask_async(_QUERY, (what,), deadline)

    def note(self, number: int) -> None:
        self._send(_COMMAND, (number,), None)


class NewsPublisher(Proxy):
    interface = NEWS

    def push(self, number: int) -> None:
        self._send(_PUBLICATION, (number,), None)


class House(Worker[None]):
    """Provides both interfaces under the names that a test adds."""

    component = Component(
        "house",
        (
            Port(Verb.IMPLEMENTS, TELLER, each=True),
            Port(Verb.PUBLISHES, NEWS, each=True, proxy=NewsPublisher),
        ),
        period=0.02,
    )
    middleware = "tested"
    teller: NamedHandlers[TellerHandler]
    news: NamedProxies[NewsPublisher]
    at_once: Callable[[House], object] = staticmethod(lambda house: None)

    def __init__(self) -> None:
        self.errands: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        """What `compute` has to do."""

    def initialize(self) -> None:
        self.at_once(self)

    def compute(self) -> None:
        if not self.errands.empty():
            self.errands.get()()


class Visitor:
    """A component that uses one name."""

    def __init__(self, transport: Transport, name: str) -> None:
        self._transport, self._name = transport, name
        self._links: list[Link] = []
        self._monitor = Monitor("visitor")
        self._monitor.open()
        self.heard: queue.Queue[int] = queue.Queue()

    def teller(self, *, wait: bool = True) -> TellerProxy:
        port = Port(Verb.REQUIRES, TELLER, proxy=TellerProxy)
        proxy, links = bind_proxy(port, self._route, self._monitor)
        self._links += links
        for link in links if wait else ():
            assert link.wait_peer(SOON)
        assert isinstance(proxy, TellerProxy)
        return proxy

    def subscribe(self) -> list[Link]:
        links = bind_handlers(Port(Verb.SUBSCRIBES, NEWS), self, self._route, self._monitor)
        self._links += links
        return links

    def News_push(self, number: int) -> None:
        self.heard.put(number)

    def close(self) -> None:
        close_all(self._links)
        self._monitor.close()

    def _route(self, port: Port, operation: Operation[Any]) -> Route:
        channel = f"{self._name}/{port.interface.short}/{operation.name}"
        return Route(self._transport, "tested", channel, port.qos, SOON)


def started_until(ending: ExitStack, running: Running) -> Worker[Any]:
    """The worker of a component, which runs until the end of the test and must not fail."""
    thread = threading.Thread(target=running.run)

    def stop() -> None:
        running.stop()
        thread.join(SOON)
        assert not thread.is_alive()
        assert not running.failed

    thread.start()
    ending.callback(stop)
    wait_until(lambda: running.ready.is_set() or running.is_over)
    return running.worker


class InstancesSuite(ComponentSuite):
    """The base of tests of named instances."""

    running: Running
    """The house that was started last."""

    @pytest.fixture
    def there(self, ending: ExitStack) -> Transport:
        transport = self.open_transport("visitor")
        ending.callback(transport.close)
        return transport

    @pytest.fixture
    def house(self, ending: ExitStack) -> House:
        return self.start(ending)

    @pytest.fixture
    def visit(self, there: Transport, ending: ExitStack) -> Callable[[str], Visitor]:
        def visit(name: str) -> Visitor:
            visitor = Visitor(there, name)
            ending.callback(visitor.close)
            return visitor

        return visit

    def start(
        self,
        ending: ExitStack,
        name: str = "house",
        at_once: Callable[[House], object] | None = None,
        kind: type[House] = House,
        sets: Sequence[str] = (),
    ) -> House:
        """Run a house until the end of the test. `at_once` is its `initialize`, and `sets` its configuration."""
        worker = type("House", (kind,), {"at_once": staticmethod(at_once)}) if at_once else kind
        document = settings.Document()
        for each in sets:
            settings.override(document, each)
        checked = settings.check(House.component, document, name)
        self.running = Running(worker, checked, lambda _: lambda config: self.open_transport(config.owner))
        started = started_until(ending, self.running)
        assert isinstance(started, House)
        return started


class InstancesConformance(InstancesSuite):
    """The tests."""

    def test_two_instances_answer_separately(self, house: House, visit: Callable[[str], Visitor]) -> None:
        front, back = house.teller.add("front", Teller()), house.teller.add("back", Teller())
        to_front, to_back = visit("front").teller(), visit("back").teller()
        assert to_front.tell("hello") == "front: hello"
        assert to_back.tell("hello") == "back: hello"
        to_back.note(7)
        wait_until(lambda: back.noted == [7])  # type: ignore[attr-defined]
        assert front.noted == []  # type: ignore[attr-defined]

    def test_two_instances_publish_separately(self, house: House, visit: Callable[[str], Visitor]) -> None:
        front, back = house.news.add("front"), house.news.add("back")
        at_front, at_back = visit("front"), visit("back")
        for visitor, publisher in ((at_front, front), (at_back, back)):
            (link,) = visitor.subscribe()
            assert link.wait_peer(SOON)
            wait_until(partial(_hears, visitor, publisher))
        front.push(1)
        back.push(2)
        assert (_next(at_front.heard), _next(at_back.heard)) == (1, 2)

    def test_a_subscriber_that_names_no_instance_hears_all(self, house: House, visit: Callable[[str], Visitor]) -> None:
        visitor = visit("*")
        visitor.subscribe()
        for number, name in enumerate(("front", "back")):
            publisher = house.news.add(name)
            wait_until(partial(_hears, visitor, publisher, number))

    def test_an_instance_may_be_added_before_the_component_is_ready(
        self, ending: ExitStack, visit: Callable[[str], Visitor]
    ) -> None:
        self.start(ending, at_once=lambda house: house.teller.add("front", Teller()))
        assert visit("front").teller().tell("hello") == "front: hello"

    def test_a_client_may_wait_for_an_instance(self, house: House, visit: Callable[[str], Visitor]) -> None:
        proxy = visit("front").teller(wait=False)
        with pytest.raises(Unreachable):
            proxy.tell("hello")
        house.errands.put(lambda: house.teller.add("front", Teller()))
        wait_until(lambda: "front" in house.teller)
        wait_until(partial(_answers, proxy))

    def test_an_instance_that_is_removed_is_unreachable(self, house: House, visit: Callable[[str], Visitor]) -> None:
        house.teller.add("front", Teller())
        house.teller.add("back", Teller())
        to_front, to_back = visit("front").teller(), visit("back").teller()
        assert to_front.tell("hello") == "front: hello"
        removed = threading.Event()
        house.errands.put(lambda: house.teller.remove("front"))
        house.errands.put(removed.set)
        assert removed.wait(SOON)
        with pytest.raises(Unreachable):
            to_front.tell("hello")
        assert to_back.tell("hello") == "back: hello"

    def test_a_name_can_be_used_again(self, house: House, visit: Callable[[str], Visitor]) -> None:
        proxy = visit("front").teller(wait=False)
        for _ in range(3):
            house.teller.add("front", Teller())
            wait_until(partial(_answers, proxy))
            house.teller.remove("front")

    def test_a_handler_may_remove_its_own_instance(self, house: House, visit: Callable[[str], Visitor]) -> None:
        class Brief(Teller):
            def tell(self, what: str) -> str:
                house.teller.remove(self.instance)
                return what

        house.teller.add("front", Brief())
        assert _outcome(visit("front").teller(), "bye") in ("bye", Unreachable)  # the reply may be too late
        assert "front" not in house.teller

    def test_remove_waits_for_a_call_that_runs(self, house: House, visit: Callable[[str], Visitor]) -> None:
        teller = Teller()
        house.teller.add("front", teller)
        proxy = visit("front").teller()
        answers: list[object] = []
        asking = threading.Thread(target=lambda: answers.append(_outcome(proxy, "wait")))
        asking.start()
        assert teller.begun.wait(SOON)
        removing = threading.Thread(target=house.teller.remove, args=["front"])
        removing.start()
        teller.go_on.set()
        removing.join(SOON)
        asking.join(SOON)
        assert not removing.is_alive()
        assert answers[0] in ("front: wait", Unreachable)

    def test_calls_while_a_name_comes_and_goes_are_answered_by_it_or_fail(
        self, house: House, visit: Callable[[str], Visitor]
    ) -> None:
        outcomes: queue.SimpleQueue[object] = queue.SimpleQueue()
        is_over = threading.Event()

        def ask(proxy: TellerProxy) -> None:
            try:
                while not is_over.is_set():
                    outcomes.put(_outcome(proxy, "hello"))
            except Exception as exc:
                outcomes.put(exc)

        clients = [threading.Thread(target=ask, args=[visit("front").teller(wait=False)]) for _ in range(2)]
        for each in clients:
            each.start()
        try:
            for _ in range(10):
                house.teller.add("front", Teller())
                while (outcome := outcomes.get(timeout=3 * SOON)) is Unreachable:
                    pass
                assert outcome == "front: hello"
                house.teller.remove("front")
        finally:
            is_over.set()
            for each in clients:
                each.join(SOON)
        assert not any(each.is_alive() for each in clients)
        rest = [outcomes.get() for _ in range(outcomes.qsize())]
        assert {each for each in rest if each is not Unreachable} <= {"front: hello"}

    def test_a_name_that_another_component_serves_is_refused(self, house: House, ending: ExitStack) -> None:
        house.teller.add("front", Teller())
        other = self.start(ending, "other")
        with pytest.raises(AlreadyServed):
            other.teller.add("front", Teller())
        assert list(other.teller) == []
        house.teller.remove("front")
        wait_until(lambda: _adds(other, "front"))

    def test_a_proxy_that_is_removed_is_closed(self, house: House) -> None:
        proxy = house.news.add("front")
        proxy.push(1)
        house.news.remove("front")
        with pytest.raises(Closed):
            proxy.push(2)

    def test_sixteen_instances(self, house: House, visit: Callable[[str], Visitor]) -> None:
        every = [f"sensor{number}" for number in range(16)]
        for name in every:
            house.teller.add(name, Teller())
        assert list(house.teller) == every
        assert [visit(name).teller().tell("here") for name in every] == [f"{name}: here" for name in every]

    def test_no_instance_outlives_its_component(self, there: Transport, visit: Callable[[str], Visitor]) -> None:
        with ExitStack() as life:
            house = self.start(life)
            house.teller.add("front", Teller())
            proxy = visit("front").teller()
            assert proxy.tell("hello") == "front: hello"
        with pytest.raises(Unreachable):
            proxy.tell("hello")
        assert list(house.teller) == []
        with pytest.raises(Closed):
            house.teller.add("front", Teller())


def _hears(visitor: Visitor, publisher: NewsPublisher, number: int = 0) -> bool:
    publisher.push(number)
    try:
        return visitor.heard.get(timeout=0.05) == number
    except queue.Empty:
        return False


def _next(heard: queue.Queue[int]) -> int:
    """The next number after the zeros of `_hears`, some of which may still be on their way."""
    while not (number := heard.get(timeout=SOON)):
        pass
    return number


def _answers(proxy: TellerProxy) -> bool:
    return _outcome(proxy, "hello") == "front: hello"


def _outcome(proxy: TellerProxy, what: str) -> object:
    try:
        return proxy.tell(what)
    except Unreachable:
        return Unreachable


def _adds(house: House, name: str) -> bool:
    try:
        house.teller.add(name, Teller())
    except AlreadyServed:
        return False
    return True
