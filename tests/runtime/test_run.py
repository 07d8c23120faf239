"""From a worker class to a running component, and to its end."""

from __future__ import annotations

import functools
import itertools
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import pytest

from robocomp_py import __version__
from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.errors import Closed, ComponentError, ConfigurationError, RemoteFailure, Timeout, Unreachable
from robocomp_py.runtime import ports
from robocomp_py.runtime.commonbehavior import MOST_CHANGES
from robocomp_py.runtime.lifecycle import State
from robocomp_py.runtime.monitor import Monitor
from robocomp_py.runtime.RoboCompCommonBehavior import COMMONBEHAVIOR_INTERFACE, Status
from robocomp_py.runtime.RoboCompCommonBehavior import Parameter as Told_
from robocomp_py.runtime.RoboCompCommonBehavior import State as Told
from robocomp_py.runtime.route import Route
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Transport, TransportConfig, TransportFactory
from robocomp_py.transports.inproc import InprocTransport

from .components import Calculator, Diary, EverythingProxy, EverythingPublisher, Pupil, Stuck, Tuned
from .running import make, running

_buses = itertools.count()


@pytest.fixture
def find() -> Callable[[str], TransportFactory]:
    """In-process transports that reach only those of the same test."""
    bus = f"run-{next(_buses)}"
    return lambda name: lambda config: InprocTransport(TransportConfig({"bus": bus}, config.owner))


async def _async_hook(self: object) -> None: ...


def test_a_life_without_incidents(find: Any) -> None:
    with running(make(Diary, find)) as worker:
        wait_until(lambda: worker.entries.count("compute") >= 3)
    assert worker.story == ["initialize", "compute", "finish"]
    assert worker.outcome


def test_an_emergency_replaces_compute_until_it_is_over(find: Any) -> None:
    with running(make(Diary, find)) as worker:
        wait_until(lambda: "compute" in worker.entries)
        worker.goToEmergency()
        wait_until(lambda: worker.entries.count("emergency") >= 2)
        worker.goToRestore()
        wait_until(lambda: worker.entries[-1] == "compute")
    assert worker.story == ["initialize", "compute", "emergency", "restore", "compute", "finish"]


def test_a_worker_can_end_its_component(find: Any) -> None:
    class Brief(Diary):
        def compute(self) -> None:
            super().compute()
            self.stop()

    made = make(Brief, find)
    assert made.run()
    assert made.worker.entries == ["initialize", "compute", "finish"]  # type: ignore[attr-defined]
    assert made.state is State.ENDED


def test_the_period_can_be_changed_while_it_runs(find: Any) -> None:
    made = make(Diary, find, "component.period=1000")
    with running(made) as worker:
        wait_until(lambda: made.computes == 1)
        worker.period = 0.002
        wait_until(lambda: made.computes > 5)
        with pytest.raises(ValueError, match="positive"):
            worker.period = 0


def test_overruns_are_counted(find: Any) -> None:
    class Slow(Diary):
        def compute(self) -> None:
            super().compute()
            threading.Event().wait(0.02)

    made = make(Slow, find)
    with running(made):
        wait_until(lambda: made.overruns > 5)


def test_a_component_that_is_too_slow_for_its_period_says_so_once(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    class Slow(Diary):
        def compute(self) -> None:
            super().compute()
            threading.Event().wait(0.025)

    made = make(Slow, find)
    with running(made):
        wait_until(lambda: made.overruns > 50)
    said = [line for line in caplog.messages if "periods were skipped" in line]
    assert len(said) == 1
    told = re.match(r"\S+Slow.compute took ([\d.]+) s, longer than the period of 0.005 s: \d+ periods", said[0])
    assert told
    assert float(told[1]) >= 0.025


def test_a_compute_that_waits_for_a_slow_handler_names_the_handler(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    class Blocked(Calculator):
        def Everything_work(self, task: str) -> str:
            threading.Event().wait(0.1)
            return task

    made = make(Blocked, find, "component.period=1000")
    with running(made) as worker, asking(find) as ask:
        work = partial(ask, "calculator/Everything", e.EVERYTHING, e.work, "")
        work()
        wait_until(lambda: made.monitor.tallies.slowest_handler()[0] > 0)  # noted after the answer
        worker.period = 0.005
        while made.overruns <= made.computes:
            work()
        wait_until(lambda: any("periods were skipped" in line for line in caplog.messages))
    (said,) = (line for line in caplog.messages if "periods were skipped" in line)
    cause = r"Everything_work took [\d.]+ s, the period is 0.005 s"
    assert re.search(rf"compute waited for other code of this component \({cause}\): \d+ periods", said)


def test_a_component_tells_what_it_is_busy_with(find: Any) -> None:
    class Waiting(Diary):
        def __init__(self) -> None:
            super().__init__()
            self.begun, self.released = threading.Event(), threading.Event()

        def compute(self) -> None:
            self.begun.set()
            self.released.wait(SOON)

    component = make(Waiting, find)
    with running(component) as worker:
        assert worker.begun.wait(SOON)
        busy = component.busy
        worker.released.set()
    assert re.fullmatch(rf"diary is busy with \S*\.Waiting\.compute at {re.escape(__file__)}:\d+", busy)
    assert component.busy == ""


def test_a_component_tells_its_state_counts_ports_and_peers(find: Any) -> None:
    operations = {operation.name: operation for operation in COMMONBEHAVIOR_INTERFACE.operations}

    def status(of: str) -> Status:
        told: Status = ask(f"{of}/CommonBehavior", COMMONBEHAVIOR_INTERFACE, operations["getStatus"])
        return told

    server, client = make(Calculator, find), make(Pupil, find, "ports.everything.from=calculator")
    with running(server) as calculator, running(client), asking(find) as ask:
        port, other = status("pupil").ports[0], status("calculator").ports[0]
        assert (port.name, port.verb, port.type, port.middleware) == ("Everything", "requires", "Everything", "inproc")
        assert (port.peers, port.connected, other.verb, other.peers) == (["calculator"], True, "implements", [])
        calculator.goToEmergency()
        wait_until(lambda: server.state is State.EMERGENCY)
        told = status("calculator")
        assert (told.instance, told.component, told.state) == ("calculator", "calculator", "emergency")
        assert (told.version, told.computes) == (__version__, server.computes)
        assert re.fullmatch(rf"calculator emergency \d+ 0 0 {re.escape(__version__)}", server.life)
        server.stop()
        wait_until(lambda: server.is_over)
        wait_until(lambda: not status("pupil").ports[0].connected)


def test_an_exception_in_compute_ends_it_after_finish(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    class Broken(Diary):
        def compute(self) -> None:
            super().compute()
            raise ZeroDivisionError("in compute")

    made = make(Broken, find)
    assert not made.run()
    assert made.worker.entries == ["initialize", "compute", "finish"]  # type: ignore[attr-defined]
    assert "ZeroDivisionError: in compute" in caplog.text


def test_an_exception_in_initialize_ends_it_before_it_is_ready(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    class Broken(Diary):
        def initialize(self) -> None:
            super().initialize()
            raise ZeroDivisionError("in initialize")

    made = make(Broken, find)
    assert not made.run()
    assert not made.ready.is_set()
    assert made.worker.entries == ["initialize", "finish"]  # type: ignore[attr-defined]


def test_a_server_that_goes_away_only_cuts_a_compute_short(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    class Asker(Pupil):
        def compute(self) -> None:
            self.entries.append(f"7 / 2 = {self.everything_proxy.divide(7, 2)}")

    made = make(Asker, find, "ports.everything.deadline=0.2")  # for so long an idempotent call waits for its server
    with running(made, ready=False) as asker:
        for _ in range(2):
            with running(make(Calculator, find)):
                seen = len(asker.entries)
                wait_until(lambda n=seen: asker.entries[n:].count("7 / 2 = (3, 1)") >= 2)  # type: ignore[misc]
        computes = made.computes
        wait_until(lambda: made.computes > computes + 5)
    assert asker.outcome
    assert sum("did not complete" in record.message for record in caplog.records) <= 4


def test_a_component_waits_for_what_it_requires_and_says_so(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    made = make(Pupil, find)
    with running(made, ready=False) as pupil:
        wait_until(lambda: "waiting for a component that implements Everything (any instance)" in caplog.text)
        assert pupil.entries == []
        with running(make(Calculator, find)):
            wait_until(lambda: "compute" in pupil.entries)  # ready does not mean that it has computed
    assert pupil.story == ["initialize", "compute", "finish"]


def test_its_patience_has_an_end(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    made = make(Pupil, find, "component.startup_timeout=0.05")
    assert not made.run()
    assert "no component implements Everything (waited 0.05 s for any instance)" in caplog.text
    assert "set ports.everything.from" in caplog.text


def test_an_operation_that_the_server_lacks_is_named(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    operations = tuple(each for each in e.EVERYTHING.operations if each.name != "divide")
    older = Port(Verb.IMPLEMENTS, replace(e.EVERYTHING, operations=operations))

    class Older(Calculator):
        component = Component("older", (older,), period=0.005)

    with running(make(Older, find)):
        assert not make(Pupil, find, "component.startup_timeout=0.05").run()
    assert "a component implements Everything without `divide`: it was generated from another def" in caplog.text
    assert "no component implements" not in caplog.text


def test_stopped_while_it_waits_it_ends_without_finish(find: Any) -> None:
    made = make(Pupil, find)
    with running(made, ready=False) as pupil:
        wait_until(lambda: made._connections.bound)
    assert pupil.entries == []
    assert pupil.outcome


def test_stopped_while_its_middleware_is_waited_for_it_ends_at_once_and_well(caplog: pytest.LogCaptureFixture) -> None:
    waits = threading.Event()

    def open_late(config: TransportConfig) -> Transport:
        waits.set()
        wait_until(lambda: not config.wanted())
        raise Closed("asked to end")

    with running(make(Pupil, lambda _: open_late), ready=False) as pupil:
        assert waits.wait(SOON)
    assert pupil.entries == []
    assert pupil.outcome
    assert not caplog.text


def test_a_middleware_that_closes_by_itself_is_a_failure(caplog: pytest.LogCaptureFixture) -> None:
    def close(config: TransportConfig) -> Transport:
        raise Closed("the transport is closed")

    assert not make(Pupil, lambda _: close).run()
    assert "the transport is closed" in caplog.text


def test_components_that_require_each_other_start(find: Any) -> None:
    class Partner(Calculator):
        component = Component(
            "partner",
            (Port(Verb.IMPLEMENTS, e.EVERYTHING), Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy)),
            period=0.005,
        )
        everything_proxy: EverythingProxy

        def compute(self) -> None:
            self.entries.append(self.everything_proxy.work("for my partner"))

    left = make(Partner, find, "ports.everything.from=right", name="left")
    right = make(Partner, find, "ports.everything.from=left", name="right")
    with running(left, ready=False) as one, running(right, ready=False) as other:
        for worker in (one, other):
            wait_until(lambda w=worker: "for my partner" in w.entries and "work for my partner" in w.entries)  # type: ignore[misc]


def test_handlers_are_let_in_only_after_initialize(find: Any) -> None:
    entered, release = threading.Event(), threading.Event()

    class Late(Calculator):
        def initialize(self) -> None:
            entered.set()
            release.wait(SOON)
            super().initialize()

    with running(make(Late, find), ready=False) as late, asking(find) as ask:
        assert entered.wait(SOON)
        answer = ask("*/Everything", e.EVERYTHING, e.work, "early", wait=False)
        assert late.entries == []
        release.set()
        assert answer.result(SOON) == "early"
    assert late.entries[0] == "initialize"


@contextmanager
def asking(find: Any) -> Iterator[Callable[..., Any]]:
    """Ask any operation of what runs."""
    monitor = Monitor("asking")
    monitor.open()
    transport = find("inproc")(TransportConfig())
    opened: list[Any] = []

    def ask(port: str, interface: Any, operation: Any, *arguments: Any, wait: bool = True) -> Any:
        use = Port(Verb.REQUIRES, interface, proxy=EverythingProxy)
        proxy, links = ports.bind_proxy(
            use, lambda _, o: Route(transport, "inproc", f"{port}/{o.name}", use.qos, SOON), monitor
        )
        opened.extend(links)
        for link in links:
            assert link.wait_peer(SOON)
        return proxy._ask(operation, arguments, None) if wait else proxy._ask_async(operation, arguments, None)

    yield ask
    ports.close_all(opened)
    transport.close()
    monitor.close()


def test_every_component_answers_common_behavior(find: Any) -> None:
    made = make(Tuned, find, "params.device=/dev/laser", "component.period=0.05")
    operations = {operation.name: operation for operation in COMMONBEHAVIOR_INTERFACE.operations}
    with running(made) as worker, asking(find) as ask:

        def common(name: str, *arguments: Any) -> Any:
            return ask("tuned/CommonBehavior", COMMONBEHAVIOR_INTERFACE, operations[name], *arguments)

        assert common("getState") is Told.Running
        assert common("getPeriod") == 50
        common("setPeriod", 20)
        assert worker.period == 0.02
        assert common("timeAwake") >= 0
        assert common("getParameterList")["device"].value == "/dev/laser"
        with pytest.raises(Exception, match="cannot reload its configuration"):
            common("reloadConfig")
        common("killYourSelf")
        wait_until(lambda: worker.entries[-1:] == ["finish"])


class Changing(Tuned):
    """Writes down which parameters were changed, and objects to standing still."""

    def paramsChanged(self, changed: frozenset[str]) -> None:
        self.entries.append(f"{sorted(changed)}: {self.params.max_speed} {self.params.verbose}")
        if self.params.max_speed == 0:
            raise ValueError("it has to move")


@contextmanager
def changing(find: Any, worker: type[Worker[Any]] = Changing) -> Iterator[tuple[Any, Callable[..., Any]]]:
    """A component whose parameters may be changed, and how: `change(max_speed="1")`."""
    operations = {operation.name: operation for operation in COMMONBEHAVIOR_INTERFACE.operations}

    with running(make(worker, find, "params.device=/dev/laser")) as made, asking(find) as ask:

        def change(wait: bool = True, **values: str) -> Any:
            given = {name: Told_(False, value, "") for name, value in values.items()}
            operation = operations["setParameterList"]
            return ask("tuned/CommonBehavior", COMMONBEHAVIOR_INTERFACE, operation, given, wait=wait)

        change.told = lambda: ask(  # type: ignore[attr-defined]
            "tuned/CommonBehavior", COMMONBEHAVIOR_INTERFACE, operations["getParameterList"]
        )
        yield made, change


def test_dynamic_parameters_change_together_and_the_component_is_notified(find: Any) -> None:
    with changing(find) as (worker, change):
        before = worker.params
        change(max_speed="1.5", verbose="true")
        assert "['max_speed', 'verbose']: 1.5 True" in worker.entries
        assert (worker.params.max_speed, worker.params.verbose, worker.params.device) == (1.5, True, "/dev/laser")
        assert (before.max_speed, before.verbose) == (0.5, False)


def test_dynamic_parameters_are_listed_with_their_values(find: Any) -> None:
    with changing(find) as (_, change):
        change(max_speed="1.5")
        told = {name: (each.value, each.type, each.editable) for name, each in change.told().items()}
    assert told == {
        "max_speed": ("1.5", "float", True),
        "device": ("/dev/laser", "str", False),
        "verbose": ("False", "bool", True),
    }


def test_a_list_of_parameters_can_be_given_back_as_it_was_told(find: Any) -> None:
    with changing(find) as (worker, change):
        change(**{name: each.value for name, each in change.told().items()})
        assert not [entry for entry in worker.entries if "max_speed" in entry]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"max_speed": "3"}, r"max_speed: `max_speed` is 3\.0; allowed: float, 0\.0 to 2\.0"),
        ({"max_speed": "fast"}, "max_speed: `max_speed` is 'fast'; allowed: float"),
        ({"max_sped": "1"}, "max_sped: unknown parameter `max_sped`; did you mean `max_speed`"),
        ({"device": "/dev/other"}, "device: `device` is not dynamic: it keeps its value"),
        ({"max_speed": "0"}, "ValueError: it has to move"),
    ],
)
def test_if_one_change_is_wrong_nothing_is_changed(find: Any, wrong: dict[str, str], message: str) -> None:
    with changing(find) as (worker, change):
        before = worker.params
        with pytest.raises(RemoteFailure, match=message):
            change(verbose="true", **wrong)
        assert worker.params is before
        assert change.told()["verbose"].value == "False"
        change(verbose="true")
        assert worker.params.verbose


def test_a_wrong_change_is_reported_in_one_line(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    with changing(find) as (_, change), pytest.raises(RemoteFailure):
        change(max_speed="3")
    [said] = [record for record in caplog.records if "max_speed" in record.message]
    assert said.levelname == "WARNING"
    assert said.message.endswith("max_speed: `max_speed` is 3.0; allowed: float, 0.0 to 2.0")


def test_parameters_do_not_change_while_the_component_computes(find: Any) -> None:
    entered, release = threading.Event(), threading.Event()

    class Computing(Changing):
        def compute(self) -> None:
            entered.set()
            release.wait(SOON)
            self.entries.append(f"computed at {self.params.max_speed}")

    with changing(find, Computing) as (worker, change):
        assert entered.wait(SOON)
        answer = change(wait=False, max_speed="1.5")
        assert change.told()["max_speed"].value == "0.5"  # which is answered while it computes
        assert not answer.done()
        release.set()
        answer.result(SOON)
        told = worker.entries.index("['max_speed']: 1.5 False")
        assert set(worker.entries[:told]) == {"initialize", "computed at 0.5"}
        wait_until(lambda: "computed at 1.5" in worker.entries)


def test_changes_that_wait_keep_nothing_else_of_common_behavior_from_being_answered(find: Any) -> None:
    entered, release = threading.Event(), threading.Event()

    class Computing(Changing):
        def compute(self) -> None:
            entered.set()
            release.wait(SOON)

    with changing(find, Computing) as (_, change):
        try:
            assert entered.wait(SOON)
            answers = [change(wait=False, max_speed="1.5") for _ in range(40)]
            assert change.told()["max_speed"].value == "0.5"
        finally:
            release.set()
        refused = [answer.exception(SOON) for answer in answers]
        assert refused.count(None) == MOST_CHANGES
        assert all("changes of parameters are already waiting" in str(each) for each in refused if each)


def test_a_change_is_refused_while_the_component_waits_for_an_answer_about_another_one(find: Any) -> None:
    entered, release = threading.Event(), threading.Event()

    class Asking(Changing):
        component = replace(Changing.component, ports=(Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),))
        everything_proxy: EverythingProxy

        def paramsChanged(self, changed: frozenset[str]) -> None:
            self.everything_proxy.work("how fast may I go")

    class Slow(Calculator):
        def Everything_work(self, task: str) -> str:
            entered.set()
            release.wait(SOON)
            return task

    with running(make(Slow, find)), changing(find, Asking) as (worker, change):
        try:
            answer = change(wait=False, max_speed="1.5")
            assert entered.wait(SOON)
            with pytest.raises(RemoteFailure, match="another change of parameters is in progress"):
                change(verbose="true")
        finally:
            release.set()
        answer.result(SOON)
        assert change.told()["max_speed"].value == "1.5"
        change(verbose="true")
        assert (worker.params.max_speed, worker.params.verbose) == (1.5, True)


def test_parameters_cannot_be_assigned(find: Any) -> None:
    with running(make(Tuned, find, "params.device=x")) as worker, pytest.raises(AttributeError, match="params"):
        worker.params = None


def test_common_behavior_is_answered_while_compute_is_stuck(find: Any) -> None:
    entered, release = threading.Event(), threading.Event()

    class Stuck(Diary):
        def compute(self) -> None:
            entered.set()
            release.wait(SOON)

    get_state = next(o for o in COMMONBEHAVIOR_INTERFACE.operations if o.name == "getState")
    with running(make(Stuck, find)), asking(find) as ask:
        assert entered.wait(SOON)
        assert ask("diary/CommonBehavior", COMMONBEHAVIOR_INTERFACE, get_state) is Told.Running
        release.set()


def test_an_interface_required_twice_gives_two_proxies(find: Any) -> None:
    class Signed(Calculator):
        def Everything_work(self, task: str) -> str:
            return f"{task} by {self.log.name}"

    class Foreman(Diary):
        component = Component(
            "foreman",
            (
                Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),
                Port(Verb.REQUIRES, e.EVERYTHING, "1", proxy=EverythingProxy),
            ),
        )
        everything_proxy: EverythingProxy
        everything1_proxy: EverythingProxy

        def initialize(self) -> None:
            self.entries += [self.everything_proxy.work("a wall"), self.everything1_proxy.work("a roof")]

    foreman = make(Foreman, find, "ports.everything.from=mason", "ports.everything1.from=carpenter")
    with (
        running(make(Signed, find, name="mason")),
        running(make(Signed, find, name="carpenter")),
        running(foreman) as worker,
    ):
        assert worker.entries[:2] == ["a wall by mason", "a roof by carpenter"]


def test_a_deadline_can_be_set_per_port_per_operation_and_per_call(find: Any) -> None:
    release = threading.Event()

    class Slow(Calculator):
        def Everything_work(self, task: str) -> str:
            release.wait(SOON)
            return task

    class Impatient(Pupil):
        def initialize(self) -> None:
            for deadline in (None, 0.02):
                try:
                    self.everything_proxy.work("x", deadline=deadline)
                except Timeout as exc:
                    self.entries.append(str(exc))

    made = make(Impatient, find, "ports.everything.deadline=60", "ports.everything.work.deadline=0.01")
    with running(make(Slow, find)), running(made) as worker:
        release.set()
    late = "the deadline passed before the server could execute the call"  # on a machine that is busy with other things
    for entry, told in zip(worker.entries, ("no answer in 0.01 s", "no answer in 0.02 s"), strict=False):
        assert entry.endswith((told, late))


def test_a_missing_handler_is_named_with_the_method_to_add(find: Any) -> None:
    class Lazy(Worker[None]):
        component = Calculator.component
        middleware = "inproc"

    with pytest.raises(ComponentError, match="Lazy lacks the method Everything_echo_nested; add:"):
        make(Lazy, find)


def test_a_misspelt_handler_is_named_with_the_one_that_is_missing(find: Any) -> None:
    class Misspelt(Worker[None]):
        component = Calculator.component
        middleware = "inproc"

        def Everything_echo_nestd(self, value: e.Nested) -> e.Nested:
            return value

    told = "lacks the method Everything_echo_nested, and has Everything_echo_nestd: rename it, add:"
    with pytest.raises(ComponentError, match=told):
        make(Misspelt, find)


def test_a_handler_with_other_arguments_is_named(find: Any) -> None:
    class Wrong(Calculator):
        def Everything_divide(self, dividend: int) -> tuple[int, int]:  # type: ignore[override]
            return 0, 0

    with pytest.raises(ComponentError, match=r"Everything_divide must take \(self, dividend, divisor\)"):
        make(Wrong, find)


def test_an_asynchronous_handler_is_refused(find: Any) -> None:
    class Modern(Calculator):
        async def Everything_poke(self, number: int) -> None:  # type: ignore[override]
            ...

    with pytest.raises(ComponentError, match="the framework calls plain methods"):
        make(Modern, find)


HOOKS: list[tuple[Any, str]] = [
    (5, "Odd.compute must be a method, because the framework calls it, not 5"),
    (_async_hook, "Odd.compute is `async def`"),
    (lambda self, dt: None, "Odd.compute must take (self); write:"),
]


@pytest.mark.parametrize(("hook", "said"), HOOKS, ids=["value", "async", "arguments"])
def test_what_is_no_hook_is_refused(find: Any, hook: Any, said: str) -> None:
    with pytest.raises(ComponentError, match=re.escape(said)):
        make(type("Odd", (Calculator,), {"compute": hook}), find)


@functools.wraps(Calculator.compute)
def _wrapper(*arguments: Any, **named: Any) -> None: ...


@pytest.mark.parametrize(
    "hook",
    [lambda self: None, lambda self, times=1: None, lambda *every: None, lambda self, *, times=1: None, _wrapper],
    ids=["plain", "default", "any", "by name", "decorated"],
)
def test_what_can_be_called_as_a_hook_is_one(find: Any, hook: Any) -> None:
    make(type("Fine", (Calculator,), {"compute": hook}), find)


@pytest.mark.parametrize("hook", [lambda self, *, times: None, lambda: None], ids=["by name", "without self"])
def test_what_cannot_is_refused(find: Any, hook: Any) -> None:
    with pytest.raises(ComponentError, match=r"Odd.compute must take \(self\)"):
        make(type("Odd", (Calculator,), {"compute": hook}), find)


def test_a_proxy_is_missing_when_init_runs_and_the_remedy_is_reported(find: Any) -> None:
    class Hasty(Pupil):
        def __init__(self) -> None:
            super().__init__()
            self.everything_proxy.work("now")

    with pytest.raises(ComponentError, match=r"in __init__\n(.*\n)+proxies exist from `initialize` on: move") as caught:
        make(Hasty, find)
    assert "runtime/run.py" not in str(caught.value)


def test_exiting_in_compute_ends_it_after_finish(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    for code, fine in ((0, True), (3, False)):

        class Leaving(Diary):
            leave_with = code

            def compute(self) -> None:
                raise SystemExit(self.leave_with)

        made = make(Leaving, find)
        assert made.run() is fine
        assert made.worker.entries[-1] == "finish"
    assert "compute called sys.exit(3)" in caplog.text


def test_exiting_in_a_handler_fails_its_call_and_nothing_else(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    class Leaving(Calculator):
        def Everything_work(self, task: str) -> str:
            raise SystemExit(task)

        def Everything_poke(self, number: int) -> None:
            raise SystemExit(number)

    with running(make(Leaving, find)), running(make(Pupil, find)) as pupil:
        with pytest.raises(RemoteFailure, match="SystemExit: bye"):
            pupil.everything_proxy.work("bye")
        pupil.everything_proxy.poke(1)
        assert pupil.everything_proxy.divide(4, 2) == (2, 0)
    assert caplog.text.count("called sys.exit(): call self.stop() to stop the component") == 2


def test_the_authors_of_handlers_see_only_their_own_lines(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    class Careless(Calculator):
        def Everything_work(self, task: str) -> Any:
            return {}[task] if task else 5

    with running(make(Careless, find)), running(make(Pupil, find)) as pupil:
        with pytest.raises(RemoteFailure, match="KeyError: 'x'") as caught:
            pupil.everything_proxy.work("x")
        with pytest.raises(RemoteFailure, match="ret must be a str"):
            pupil.everything_proxy.work("")
    assert "return {}[task]" in caught.value.trace
    assert "runtime/calls.py" not in caught.value.trace + caplog.text
    assert "Everything_work returned a value that its interface does not allow: " in caplog.text


def test_a_stopping_component_does_not_wait_for_queued_handlers(find: Any) -> None:
    begun, release = threading.Event(), threading.Event()

    class Slow(Calculator):
        def Everything_work(self, task: str) -> str:
            begun.set()
            release.wait(SOON)
            return super().Everything_work(task)

        def Everything_poke(self, number: int) -> None:
            super().Everything_poke(number)

    made = make(Slow, find)
    with running(made) as slow, running(make(Pupil, find)) as pupil:
        asking = [pupil.everything_proxy._ask_async(e.work, (str(n),), SOON) for n in range(3)]
        pupil.everything_proxy.poke(1)
        assert begun.wait(SOON)
        made.stop()
        release.set()
        wait_until(lambda: made.state is State.ENDED)
        assert slow.story[-1] == "finish"
        assert len([entry for entry in slow.entries if entry.startswith("work")]) == 1
        for waiting in asking[1:]:
            with pytest.raises(Unreachable, match="its server left"):
                waiting.result(SOON)


def test_an_ending_component_does_not_wait_for_a_server_to_return(find: Any) -> None:
    class Asker(Pupil):
        def compute(self) -> None:
            super().compute()
            self.everything_proxy.divide(7, 2, deadline=10 * SOON)

    served, made = make(Calculator, find), make(Asker, find)
    with running(served), running(made) as asker:
        wait_until(lambda: asker.entries.count("compute") > 1)
        served.stop()
        wait_until(lambda: served.state is State.ENDED and made.monitor._suspended)
    assert asker.outcome
    assert asker.story == ["initialize", "compute", "finish"]


def test_an_ending_component_abandons_a_handler_that_waits_for_a_reply(
    find: Any, caplog: pytest.LogCaptureFixture
) -> None:
    class Between(Pupil):
        component = Component("between", (*Pupil.component.ports, Port(Verb.SUBSCRIBES, e.EVERYTHING)), period=0.005)

        def Everything_news(self, number: int, text: str) -> None:
            self.everything_proxy.work(text, deadline=10 * SOON)

    class Speaker(Diary):
        component = Component("speaker", (Port(Verb.PUBLISHES, e.EVERYTHING, proxy=EverythingPublisher),), period=0.005)
        everything_proxy: EverythingPublisher

    with running(make(Stuck, find)) as stuck, running(make(Speaker, find)) as speaker:
        with running(make(Between, find)):
            wait_until(lambda: speaker.everything_proxy.news(1, "go") or stuck.begun.is_set())
        stuck.released.set()
    assert "still in a handler" not in caplog.text


def test_queued_requests_are_answered_before_the_component_finishes(find: Any) -> None:
    begun, release = threading.Event(), threading.Event()

    class Slow(Calculator):
        def Everything_work(self, task: str) -> str:
            begun.set()
            release.wait(SOON)
            return task

        def finish(self) -> None:
            release.wait(SOON)
            super().finish()

    made = make(Slow, find)
    with running(made), running(make(Pupil, find)) as pupil:
        first, second = (pupil.everything_proxy._ask_async(e.work, (str(n),), 10 * SOON) for n in range(2))
        assert begun.wait(SOON)
        wait_until(lambda: len(made.monitor._queue) > 1)  # with compute
        made.stop()
        with pytest.raises(Unreachable, match="its server left"):
            second.result(SOON)
        assert not first.done()
        release.set()


def test_stopped_before_it_opened_it_ends_although_messages_arrive(find: Any) -> None:
    class Listener(Diary):
        component = Component("listener", (Port(Verb.SUBSCRIBES, e.EVERYTHING),), period=0.005)
        initializing, release = threading.Event(), threading.Event()

        def initialize(self) -> None:
            self.initializing.set()
            self.release.wait(SOON)

        def Everything_news(self, number: int, text: str) -> None:
            self.entries.append("news")

    class Speaker(Diary):
        component = Component("speaker", (Port(Verb.PUBLISHES, e.EVERYTHING, proxy=EverythingPublisher),), period=0.005)
        everything_proxy: EverythingPublisher

    listener = make(Listener, find)
    with running(make(Speaker, find)) as speaker, running(listener, ready=False) as worker:
        assert worker.initializing.wait(SOON)
        speaker.everything_proxy.news(1, "early")
        listener.stop()
        worker.release.set()
        wait_until(lambda: listener.state is State.ENDED)
        assert "news" not in worker.entries


def test_a_workers_own_init_may_set_its_period(find: Any) -> None:
    class Quick(Diary):
        def __init__(self) -> None:
            super().__init__()
            self.period = 0.002

    with running(make(Quick, find)) as worker:
        assert worker.period == 0.002


def test_an_instance_that_runs_already_is_named(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    with running(make(Calculator, find, name="left")):
        second = make(Calculator, find, name="left")
        assert second.run() is False
    assert "an instance `left` is already running; stop it, or give this one another name" in caplog.text


def test_a_filter_neither_asks_nor_hears_itself(find: Any) -> None:
    class Filter(Calculator):
        component = Component(
            "filter",
            (
                Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),
                Port(Verb.IMPLEMENTS, e.EVERYTHING),
            ),
            period=0.005,
        )
        everything_proxy: EverythingProxy

        def Everything_work(self, task: str) -> str:
            return self.everything_proxy.work(f"{task} filtered")

    with (
        running(make(Calculator, find)) as calculator,
        running(make(Filter, find)),
        running(make(Pupil, find, "ports.everything.from=filter")) as pupil,
    ):
        assert pupil.everything_proxy.work("task") == "task filtered"
        assert "work task filtered" in calculator.entries


def test_a_wrong_configuration_is_refused_before_anything_is_opened() -> None:
    opened: list[str] = []

    def find(name: str) -> TransportFactory:
        opened.append(name)
        raise AssertionError("opened too early")

    with pytest.raises(ConfigurationError, match="max_speed"):
        make(Tuned, find, "params.max_speed=99", "params.device=x")
    assert opened == []


def test_parameters_are_there_before_a_workers_own_init_runs(find: Any) -> None:
    class Eager(Tuned):
        def __init__(self) -> None:
            super().__init__()
            self.entries.append(f"{self.params.device} {self.params.max_speed}")  # type: ignore[attr-defined]

    made = make(Eager, find, "params.device=/dev/laser")
    assert made.worker.entries == ["/dev/laser 0.5"]  # type: ignore[attr-defined]
    with running(made):
        pass


def test_a_call_without_a_server_ends_as_unreachable(find: Any) -> None:
    caught: list[type] = []

    class Abandoned(Pupil):
        def compute(self) -> None:
            try:
                self.everything_proxy.work("x")
            except Unreachable as exc:
                caught.append(type(exc))

    made = make(Abandoned, find)
    with running(made, ready=False):
        with running(make(Calculator, find)):
            wait_until(made.ready.is_set)
        wait_until(lambda: caught)
