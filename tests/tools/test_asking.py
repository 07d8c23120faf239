"""Components are asked what they are and what they have counted, and those that do not tell are left out."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from robocomp_py import __version__
from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Interface, Operation, Verb
from robocomp_py.contract.types import INT32, STRING, Field, Struct
from robocomp_py.errors import RemoteFailure
from robocomp_py.runtime.introspecting import INTERFACE, NAME
from robocomp_py.runtime.RoboCompIntrospection import INTROSPECTION_INTERFACE, Description, Measures
from robocomp_py.testing.everything import Failed
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools import asking
from robocomp_py.tools.access import Access
from robocomp_py.tools.census import take_census
from robocomp_py.tools.network import Network
from robocomp_py.transports.base import TransportConfig, find_transport

from ..runtime.components import Calculator, Diary, Pupil, Stuck, Tuned
from ..runtime.running import make, running
from .commands import TELLERS, complained, said
from .terse import serve

OVER = "middleware=shm"


@pytest.fixture
def access() -> Iterator[Access]:
    with Access() as made:
        yield made


def there(*instances: str, over: str = "shm") -> Network:
    """The network, once these tell what they are."""
    wait_until(lambda: set(instances) <= set(asking.components(take_census([over]))))
    return take_census([over])


def described(access: Access, instance: str) -> Description:
    found = asking.describe(access, there(instance), instance)
    assert found
    return found


def measured(access: Access, instance: str, over: str = "shm") -> Measures:
    found = asking.measure(access, there(instance, over=over), instance)
    assert found
    return found


def test_the_port_announces_what_the_generated_interface_has() -> None:
    ours = {each.name: each.text for each in INTERFACE.operations}
    assert ours == {each.name: each.text for each in INTROSPECTION_INTERFACE.operations}
    assert [each.idempotent for each in INTERFACE.operations] == [
        each.idempotent for each in INTROSPECTION_INTERFACE.operations
    ]


@pytest.mark.parametrize("over", TELLERS)
def test_a_component_tells_over_every_middleware(over: str, access: Access) -> None:
    with running(make(Calculator, find_transport, f"middleware={over}", "namespace=robot1")):
        network = there("robot1/calculator", over=over)
        found, counted = (ask(access, network, "robot1/calculator") for ask in (asking.describe, asking.measure))
    assert isinstance(found, Description)
    assert isinstance(counted, Measures)
    assert (found.instance, found.component, found.pid) == ("robot1/calculator", "calculator", os.getpid())
    assert (found.version, found.clock, counted.state) == (__version__, "", "compute")
    assert {each.middleware for each in found.ends} == {over}


def test_the_threads_that_ask_stay_until_the_tool_ends() -> None:
    def asking_now() -> set[int | None]:
        return {each.ident for each in threading.enumerate() if each.name.startswith("asking")}

    with running(make(Calculator, find_transport, OVER)), Access() as access:
        network = there("calculator")
        assert asking.measure_all(access, network, ["calculator"], SOON).keys() == {"calculator"}
        threads = asking_now()
        assert asking.measure_all(access, network, ["calculator"], SOON).keys() == {"calculator"}
        assert asking_now() == threads != set()
    assert not asking_now()


def test_a_component_tells_its_ends(access: Access) -> None:
    with running(make(Calculator, find_transport, OVER)), running(make(Pupil, find_transport, OVER)):
        ends = {each.operation: each for each in described(access, "pupil").ends}
    divide = ends["divide"]
    assert (divide.port, divide.verb, divide.pattern, divide.deadline) == ("Everything", "requires", "query", 5.0)
    assert divide.channel == "*/Everything/divide"
    assert divide.definition.startswith("operation ")


def test_a_component_tells_its_parameters(access: Access) -> None:
    with running(make(Tuned, find_transport, OVER, "params.device=here")):
        settings = {each.name: each for each in described(access, "tuned").settings}
    speed = settings["max_speed"]
    assert (speed.type, speed.value, speed.initial) == ("float", "0.5", "0.5")
    assert (speed.minimum, speed.maximum, speed.editable) == ("0.0", "2.0", True)
    assert settings["device"].value == "here"


def test_both_ends_of_a_query_are_counted(access: Access) -> None:
    class Asking(Pupil):
        def compute(self) -> None:
            if len(self.entries) < 4:
                super().compute()
                assert self.everything_proxy.divide(7, 2) == (3, 1)

    with (
        running(make(Calculator, find_transport, OVER)),
        running(make(Asking, find_transport, OVER, name="pupil")) as pupil,
    ):
        wait_until(lambda: len(pupil.entries) == 4)
        both = "pupil", "calculator"  # a server counts a call after it has answered
        wait_until(lambda: all(counts(measured(access, each), "divide")[:2] == (3, 0) for each in both))
        asked, served = measured(access, "pupil"), measured(access, "calculator")
    assert counts(asked, "divide") == (3, 0, 3, 0)
    assert counts(served, "divide") == (3, 0, 3, 3)
    (round_trips,) = (each.latest for each in asked.operations if each.operation == "divide")
    (runs,) = (each.latest for each in served.operations if each.operation == "divide")
    assert 0 < runs.min() < round_trips.max()


def test_durations_are_those_of_the_handler_and_of_the_whole_call(access: Access) -> None:
    """Each lies within the next one: a wait of 10 ms, the handler, the call as it is counted, and as it is seen."""
    seen: list[float] = []

    class Waiting(Calculator):
        def Everything_divide(self, dividend: int, divisor: int) -> tuple[int, int]:
            with self.condition:
                self.condition.wait(0.01)
            return super().Everything_divide(dividend, divisor)

        condition = threading.Condition()

    class Asking(Pupil):
        def compute(self) -> None:
            if len(seen) < 3:
                begun = time.perf_counter()
                self.everything_proxy.divide(7, 2)
                seen.append(time.perf_counter() - begun)

    with (
        running(make(Waiting, find_transport, OVER, name="calculator")),
        running(make(Asking, find_transport, OVER, name="pupil")),
    ):
        wait_until(lambda: len(seen) == 3)
        wait_until(lambda: [counts(measured(access, each), "divide")[0] for each in ("pupil", "calculator")] == [3, 3])
        asked, served = measured(access, "pupil"), measured(access, "calculator")
    (round_trips,) = (each.latest for each in asked.operations if each.operation == "divide")
    (runs,) = (each.latest for each in served.operations if each.operation == "divide")
    rounded = 1e-6  # they are sent as float
    for run, round_trip, whole in zip(runs, round_trips, seen, strict=True):
        assert 0.01 <= run + rounded <= round_trip + 2 * rounded <= whole + 3 * rounded


def counts(told: Measures, operation: str) -> tuple[int, int, int, int]:
    (one,) = [each for each in told.operations if each.operation == operation and each.verb != "publishes"]
    return one.count, one.failed, len(one.latest), len(one.waited)


@pytest.mark.parametrize("waits", [True, False])
def test_a_declared_exception_is_an_answer_and_another_one_a_failure(access: Access, waits: bool) -> None:
    class Broken(Calculator):
        def Everything_work(self, task: str) -> str:
            raise ValueError(task)

    class Asking(Pupil):
        def compute(self) -> None:
            if self.has_asked:
                return
            self.has_asked = True
            for operation, arguments in ((_DIVIDE, (1, 0)), (_DIVIDE, (1, 0)), (_WORK, ("it",))):
                if waits:
                    with pytest.raises((Failed, RemoteFailure)):
                        self.everything_proxy._ask(operation, arguments, None)
                else:
                    assert self.everything_proxy._ask_async(operation, arguments, None).exception()

        has_asked = False

    with (
        running(make(Broken, find_transport, OVER, name="calculator")),
        running(make(Asking, find_transport, OVER, name="pupil")),
    ):
        both = "calculator", "pupil"
        wait_until(lambda: all(counts(measured(access, each), "work")[:2] == (1, 1) for each in both))
        assert [counts(measured(access, each), "divide")[:2] for each in both] == [(2, 0)] * 2


_WORK = next(each for each in Calculator.component.ports[0].interface.operations if each.name == "work")
_DIVIDE = next(each for each in Calculator.component.ports[0].interface.operations if each.name == "divide")


def test_what_waits_at_a_busy_component_is_told(access: Access) -> None:
    class Asking(Pupil):
        def compute(self) -> None:
            if "compute" not in self.entries:
                super().compute()
                self.everything_proxy.work("long")
            self.stop()

    with running(make(Stuck, find_transport, OVER, name="stuck")) as stuck:
        with (
            running(make(Asking, find_transport, OVER, name="first")),
            running(make(Asking, find_transport, OVER, name="second")),
        ):
            stuck.begun.wait()
            wait_until(lambda: measured(access, "stuck").queued >= 1)
            assert measured(access, "first").suspended + measured(access, "second").suspended == 2
            stuck.released.set()
            wait_until(lambda: counts(measured(access, "stuck"), "work")[0] == 2)
        (work,) = [each for each in measured(access, "stuck").operations if each.operation == "work"]
    assert work.waited.max() > 0


def test_a_level_of_logging_lasts_as_long_as_the_component(access: Access) -> None:
    logger = logging.getLogger("robocomp.test-level")
    with running(make(Diary, find_transport, OVER)) as worker:
        channel = next(
            each for each in there("diary").stock("Introspection") if each.name == "diary/Introspection/setLogLevel"
        )
        access.ask(channel, ("robocomp.test-level", "debug"), 5.0)
        assert logger.level == logging.DEBUG
        with pytest.raises(RemoteFailure, match="unknown level `loud`"):
            access.ask(channel, ("robocomp.test-level", "loud"), 5.0)
    assert worker.outcome
    assert logger.level == logging.NOTSET


def test_a_component_that_has_ended_has_no_answer(access: Access) -> None:
    with running(make(Diary, find_transport, OVER)):
        network = there("diary")
    assert asking.describe(access, network, "diary", 0.2) is None
    assert asking.measure(access, network, "nobody") is None


def test_a_program_that_announces_only_fingerprints_is_asked(access: Access) -> None:
    operation = next(each for each in INTROSPECTION_INTERFACE.operations if each.name == "measure")
    transport = find_transport("shm")(TransportConfig(owner="terse"))
    with contextlib.closing(transport):
        serve(transport, operation, lambda: (Measures(computes=7),))
        assert measured(access, "terse").computes == 7


class Odd(Diary):
    """Implements an Introspection of its own."""

    kind = Struct("RoboCompIntrospection::Description", (Field("instance", STRING), Field("colour", STRING)))
    answer: Any = ("odd\x1b[2J", "red")

    def Introspection_describe(self) -> Any:
        return self.answer


def odd(kind: Any) -> Component:
    operation: Operation[Any] = Operation(NAME, "describe", outputs=(Field("ret", kind),))
    return Component("odd", (Port(Verb.IMPLEMENTS, Interface(NAME, (operation,))),), period=0.005)


def test_another_version_is_understood_as_far_as_it_is_the_same(access: Access) -> None:
    class Newer(Odd):
        component = odd(Odd.kind)

    with running(make(Newer, find_transport, OVER, name="odd")):
        found = described(access, "odd")
    assert (found.instance, found.component, found.ends) == ("odd\ufffd[2J", "", [])


@pytest.mark.parametrize(
    ("kind", "answer"),
    [(STRING, "nothing"), (Struct("Other", (Field("pid", STRING),)), ("1",)), (INT32, 7)],
)
def test_an_answer_of_another_form_is_none(kind: Any, answer: Any, access: Access) -> None:
    class Nonsense(Odd):
        component = odd(kind)

    Nonsense.answer = answer
    with running(make(Nonsense, find_transport, OVER, name="odd")):
        assert asking.describe(access, there("odd"), "odd") is None


def test_a_component_that_does_not_answer_in_time_has_no_answer(access: Access) -> None:
    released = threading.Event()

    class Silent(Odd):
        component = odd(Odd.kind)

        def Introspection_describe(self) -> Any:
            released.wait()
            return self.answer

    with running(make(Silent, find_transport, OVER, name="odd")):
        try:
            assert asking.describe(access, there("odd"), "odd", 0.1) is None
        finally:
            released.set()


CONFIRMED = Interface(
    "Home::Lamp",
    (
        Operation("Home::Lamp", "remove", confirm=True, doc="Unscrew the bulb."),
        Operation("Home::Lamp", "dim", (Field("to", INT32, doc="in percent"),), confirm=True),
        Operation("Home::Lamp", "shine"),
    ),
)


class Lamp(Diary):
    component = Component("lamp", (Port(Verb.IMPLEMENTS, CONFIRMED),), period=0.005)

    def Lamp_remove(self) -> None:
        self.entries.append("removed")

    def Lamp_dim(self, to: int) -> None:
        self.entries.append(f"dimmed to {to}")

    def Lamp_shine(self) -> None:
        self.entries.append("shone")


@pytest.fixture
def lamp() -> Iterator[Lamp]:
    with running(make(Lamp, find_transport, OVER, name="lamp")) as worker:
        there("lamp")
        yield worker


def test_what_stops_or_moves_something_needs_a_yes(lamp: Lamp, capsys: pytest.CaptureFixture[str]) -> None:
    said_ = complained(capsys, "call", "lamp/Lamp/remove", code=2)
    assert said_ == "rc call: lamp/Lamp/remove stops or moves something; confirm it with --yes\n"
    assert "removed" not in lamp.entries
    said(capsys, "call", "lamp/Lamp/remove", "--yes")
    assert "removed" in lamp.entries
    said(capsys, "call", "lamp/Lamp/shine")
    complained(capsys, "call", "lamp/CommonBehavior/killYourSelf", code=2)


@pytest.mark.parametrize(("answer", "code"), [("y\n", 0), ("\n", 1), ("no\n", 1), ("", 1)])
def test_on_a_terminal_a_person_is_asked(
    answer: str, code: int, lamp: Lamp, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Typed(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr("sys.stdin", Typed(answer))
    asked = complained(capsys, "call", "lamp/Lamp/dim", "to=5", code=code)
    assert asked.startswith("lamp/Lamp/dim stops or moves something. Go on? [y/N] ")
    assert ("dimmed to 5" in lamp.entries) == (code == 0)


def test_comments_stand_beside_the_template(lamp: Lamp, capsys: pytest.CaptureFixture[str]) -> None:
    assert complained(capsys, "call", "lamp/Lamp/dim", code=2).splitlines() == [
        "lamp/Lamp/dim takes arguments; fill in:",
        "  to: in percent",
    ]
