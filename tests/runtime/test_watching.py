"""What a component is told of deadlines and of publishers that were lost, and when."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable
from typing import Any

import pytest

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.qos import Liveliness, QoS
from robocomp_py.errors import ComponentError
from robocomp_py.runtime.run import Running
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SCALE, SOON, wait_until
from robocomp_py.transports.base import TransportConfig, TransportFactory
from robocomp_py.transports.inproc import InprocTransport

from .components import Diary, EverythingProxy, EverythingPublisher, Pupil, Stuck
from .running import make, running

_SHORT = 0.05 * SCALE
_DEADLINE = QoS(deadline=_SHORT)
_MANUAL = QoS(lease=_SHORT, liveliness=Liveliness.MANUAL_BY_TOPIC)
_buses = itertools.count()


@pytest.fixture
def find() -> Callable[[str], TransportFactory]:
    """In-process transports that reach only those of the same test."""
    bus = f"watching-{next(_buses)}"
    return lambda name: lambda config: InprocTransport(TransportConfig({"bus": bus}, config.owner))


def publisher(qos: QoS) -> type[Speaker]:
    class Sonar(Speaker):
        component = Component("sonar", (Port(Verb.PUBLISHES, e.EVERYTHING, proxy=EverythingPublisher, qos=qos),))

    return Sonar


def subscriber(qos: QoS, base: type[Worker[Any]] | None = None) -> type[Any]:
    class Listener(base or Listening):  # type: ignore[misc]  # which of both is no matter
        component = Component("listener", (Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=qos),), period=0.005)

    return Listener


class Speaker(Diary):
    """Says something when told to."""

    everything_proxy: EverythingPublisher

    def __init__(self) -> None:
        super().__init__()
        self.told: list[tuple[Any, ...]] = []
        self.say = threading.Event()

    def compute(self) -> None:
        if self.say.is_set():
            self.say.clear()
            self.everything_proxy.news(1, "")

    def on_deadline_missed(self, port: str, operation: str, instance: str, total: int) -> None:
        self.told.append(("missed", port, operation, instance, total))

    def on_liveliness_lost(self, port: str, operation: str, instance: str, total: int) -> None:
        self.told.append(("lost", port, operation, instance, total))


class Deaf(Diary):
    """Has no opinion on what is missed."""

    def __init__(self) -> None:
        super().__init__()
        self.numbers: list[int] = []

    def Everything_news(self, number: int, text: str) -> None:
        self.numbers.append(number)


class Listening(Deaf):
    def __init__(self) -> None:
        super().__init__()
        self.told: list[tuple[Any, ...]] = []

    on_deadline_missed = Speaker.on_deadline_missed
    on_liveliness_lost = Speaker.on_liveliness_lost


def say(made: Running, *others: Callable[[], object]) -> None:
    """Have a speaker say something, again and again until all others hold."""
    worker: Any = made.worker

    def said() -> bool:
        worker.say.set()
        return all(each() for each in others)

    wait_until(said)


def test_the_hook_of_a_subscriber_gets_port_operation_and_instance(find: Any) -> None:
    sonar, listener = make(publisher(_DEADLINE), find), make(subscriber(_DEADLINE), find)
    with running(listener) as worker, running(sonar):
        say(sonar, lambda: worker.numbers)
        wait_until(lambda: len(worker.told) >= 2)
    assert {each[:4] for each in worker.told} == {("missed", "Everything", "news", "sonar")}
    totals = [total for *_, total in worker.told]
    assert totals == sorted(set(totals))


def test_the_hook_of_a_publisher_gets_missed_deadlines_under_its_own_name(find: Any) -> None:
    sonar = make(publisher(_DEADLINE), find, name="left")
    with running(sonar) as worker:
        say(sonar)
        wait_until(lambda: worker.told)
    assert worker.told[0][:4] == ("missed", "Everything", "news", "left")


def test_a_manual_publisher_is_notified_when_its_lease_ends(find: Any) -> None:
    sonar, listener = make(publisher(_MANUAL), find), make(subscriber(_MANUAL), find)
    with running(listener) as hears, running(sonar) as speaks:
        say(sonar, lambda: hears.numbers)
        wait_until(lambda: hears.told and speaks.told)
    assert hears.told[0][:4] == speaks.told[0][:4] == ("lost", "Everything", "news", "sonar")


def test_a_publisher_that_ends_is_lost(find: Any) -> None:
    qos = QoS(lease=1.0 * SCALE)
    sonar, listener = make(publisher(qos), find), make(subscriber(qos), find)
    with running(listener) as worker:
        with running(sonar):
            wait_until(lambda: listener._watching.all[0].alive())
        wait_until(lambda: worker.told)
    assert worker.told == [("lost", "Everything", "news", "sonar", 1)]


def test_hooks_never_run_concurrent_other_code_of_the_worker(find: Any) -> None:
    inside: list[str] = []

    class Nosy(Listening):
        def compute(self) -> None:
            inside.append("compute")
            threading.Event().wait(0.005)
            inside.remove("compute")

        def on_deadline_missed(self, port: str, operation: str, instance: str, total: int) -> None:
            self.told.append(tuple(inside))

    sonar, listener = make(publisher(_DEADLINE), find), make(subscriber(_DEADLINE, Nosy), find)
    with running(listener) as worker, running(sonar):
        say(sonar, lambda: worker.numbers)
        wait_until(lambda: len(worker.told) >= 5)
    assert set(worker.told) == {()}


def test_a_hook_that_raises_is_logged_and_the_component_continues(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    class Fragile(Listening):
        def on_deadline_missed(self, port: str, operation: str, instance: str, total: int) -> None:
            self.told.append((total,))
            raise ZeroDivisionError("on purpose")

    sonar, listener = make(publisher(_DEADLINE), find), make(subscriber(_DEADLINE, Fragile), find)
    with running(listener) as worker, running(sonar):
        say(sonar, lambda: worker.numbers)
        wait_until(lambda: len(worker.told) >= 2)
    assert worker.outcome
    assert "Fragile.on_deadline_missed raised" in caplog.text
    assert "ZeroDivisionError: on purpose" in caplog.text


def test_a_hook_may_stop_its_component(find: Any) -> None:
    class Careful(Listening):
        def on_deadline_missed(self, port: str, operation: str, instance: str, total: int) -> None:
            self.stop()

    sonar, listener = make(publisher(_DEADLINE), find), make(subscriber(_DEADLINE, Careful), find)
    with running(listener) as worker, running(sonar):
        say(sonar, lambda: worker.numbers)
        wait_until(lambda: worker.story[-1] == "finish")
    assert worker.outcome


def test_an_ending_component_abandons_a_hook_that_waits_for_a_reply(
    find: Any, caplog: pytest.LogCaptureFixture
) -> None:
    class Asking(Listening):
        component = Component("asking", (Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=_DEADLINE), *Pupil.component.ports))
        everything_proxy: EverythingProxy

        def on_deadline_missed(self, port: str, operation: str, instance: str, total: int) -> None:
            self.everything_proxy.work("", deadline=10 * SOON)

    sonar = make(publisher(_DEADLINE), find)
    with running(make(Stuck, find)) as stuck, running(sonar):
        with running(make(Asking, find)) as worker:
            say(sonar, lambda: worker.numbers)
            assert stuck.begun.wait(SOON)
        stuck.released.set()
    assert "still in a handler" not in caplog.text


def test_without_a_hook_a_missed_deadline_is_logged_once(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    sonar, listener = make(publisher(QoS()), find), make(subscriber(_DEADLINE, Deaf), find)
    with running(listener) as worker, running(sonar):
        say(sonar, lambda: worker.numbers)
        wait_until(lambda: listener._watching.all[0].totals()[0] >= 3)
    warnings = [record.message for record in caplog.records if "deadline missed" in record.message]
    assert warnings == ["Everything.news of sonar: deadline missed (further ones are only counted)"]
    assert "deadlines were missed" in caplog.text


@pytest.mark.parametrize("qos", [QoS(), QoS(lifespan=1.0), QoS(liveliness=Liveliness.MANUAL_BY_TOPIC)])
def test_without_a_qos_to_watch_there_is_no_watch_thread(find: Any, qos: QoS) -> None:
    with running(make(subscriber(qos), find)), running(make(publisher(QoS(lease=1.0)), find)):
        assert not [each.name for each in threading.enumerate() if each.name.endswith("-watch")]
    with running(make(subscriber(_DEADLINE), find)):
        assert "listener-watch" in [each.name for each in threading.enumerate()]
    assert "listener-watch" not in [each.name for each in threading.enumerate()]


def test_a_hook_that_takes_something_else_is_shown_what_it_is_given(find: Any) -> None:
    class Wrong(Listening):
        def on_deadline_missed(self, port: str) -> None:  # type: ignore[override]
            raise NotImplementedError

    with pytest.raises(
        ComponentError, match=r"on_deadline_missed must take \(self, port, operation, instance, total\)"
    ):
        make(subscriber(QoS(), Wrong), find)
