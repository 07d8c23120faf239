"""Components in virtual time: what they say and when depends on nothing but themselves."""

from __future__ import annotations

import contextlib
import inspect
import json
import logging
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import replace

import pytest

from robocomp_py.contract.component import Component, PeriodicTimer, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.errors import ComponentError, ConfigurationError, EncodeError, RobocompError, Timeout
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON
from robocomp_py.virtual.simulation import MOST_ERRORS, Simulation

from ..runtime.components import Calculator, Diary, EverythingProxy, EverythingPublisher, Pupil
from .parts import part


@pytest.fixture(autouse=True)
def no_threads_are_left() -> Iterator[None]:
    before = set(threading.enumerate())
    yield
    for each in set(threading.enumerate()) - before:
        each.join(SOON * 3)  # it may have been told to end, and not have ended yet
    assert set(threading.enumerate()) <= before


class Asking(Pupil):
    """Calls the calculator in each compute, and notes the time before and after."""

    def __init__(self) -> None:
        super().__init__()
        self.times: list[tuple[float, float]] = []

    def compute(self) -> None:
        before = self.now()
        self.everything_proxy.work("a")
        self.times.append((before / 1e9, self.now() / 1e9))


class Sleeping(Calculator):
    """Takes 12 ms for each piece of work."""

    def Everything_work(self, task: str) -> str:
        self.sleep(0.012)
        return super().Everything_work(task)


def test_time_passes_only_between_events() -> None:
    with Simulation([part(Calculator), part(Asking)]) as sim:
        assert sim.run(0.02)
        assert sim.time == 0.02
        assert sim["pupil"].worker.times == [(0.0, 0.0), (0.005, 0.005), (0.01, 0.01), (0.015, 0.015), (0.02, 0.02)]
        assert sim["calculator"].worker.story == ["initialize", "compute", *["work a", "compute"] * 4, "work a"]
    assert sim["pupil"].worker.story[-1] == "finish"
    assert not sim.failed


class Broken(Calculator):
    """Fails in its handlers."""

    component = replace(Calculator.component, period=1.0)

    def Everything_work(self, task: str) -> str:
        raise KeyError(task)

    def Everything_divide(self, dividend: int, divisor: int) -> tuple[int, int]:
        if divisor:
            return "wrong"  # type: ignore[return-value]  # the mistake that is to be listed
        return super().Everything_divide(dividend, divisor)

    def Everything_poke(self, number: int) -> None:
        if number == 3:
            raise ConfigurationError("three is too many")
        raise ValueError(number)


def test_exceptions_of_handlers_are_errors_though_the_component_goes_on() -> None:
    class Asker(Pupil):
        def compute(self) -> None:
            for call in (
                lambda: self.everything_proxy.work("a"),
                lambda: self.everything_proxy.divide(1, 1),
                lambda: self.everything_proxy.divide(1, 0),
                lambda: self.everything_proxy.poke(3),
                lambda: self.everything_proxy.poke(4),
            ):
                with contextlib.suppress(RobocompError):
                    call()

    with Simulation([part(Broken), part(Asker)]) as sim:
        sim.run(0.001)
        assert not sim.failed
        assert {each.instance for each in sim.errors} == {"calculator"}
        told = [(each.time, each.method.rpartition(".")[2], type(each.exception)) for each in sim.errors]
        assert told == [
            (0.0, "Everything_work", KeyError),
            (0.0, "Everything_divide", EncodeError),
            (0.0, "Everything_poke", ValueError),
        ]


def test_exceptions_of_subscribers_are_kept_up_to_a_limit() -> None:
    class Talker(Diary):
        component = Component("talker", (Port(Verb.PUBLISHES, e.EVERYTHING, proxy=EverythingPublisher),), period=0.001)
        everything_proxy: EverythingPublisher

        def compute(self) -> None:
            self.everything_proxy.news(self.now() // 10**6, "")

    class Listener(Diary):
        component = Component("listener", (Port(Verb.SUBSCRIBES, e.EVERYTHING),), period=1.0)

        def Everything_news(self, number: int, text: str) -> None:
            raise ValueError(number)

    with Simulation([part(Listener), part(Talker)]) as sim:
        assert sim.run(0.2)
        assert not sim.failed
        numbers = [each.exception.args[0] for each in sim.errors]
        assert numbers == list(range(numbers[0], numbers[0] + MOST_ERRORS))


def test_the_exception_that_ended_a_component_is_an_error() -> None:
    class Fragile(Diary):
        def compute(self) -> None:
            raise ZeroDivisionError("late")

    with Simulation([part(Fragile)]) as sim:
        sim.run(1.0)
        [failure] = sim.errors
        assert sim.failed == [failure.instance] == ["diary"]
        assert failure.method.endswith("Fragile.compute")
        assert isinstance(failure.exception, ZeroDivisionError)


def test_timers_and_functions_run_while_compute_sleeps() -> None:
    class Busy(Diary):
        component = Component("busy", period=1.0, timers=(PeriodicTimer("poll", 0.2),))

        def initialize(self) -> None:
            self.after(0.3, lambda: self.note("later"))

        def note(self, what: str) -> None:
            self.entries.append(f"{what} {self.now() / 1e9:g}")

        def compute(self) -> None:
            self.sleep(0.5)
            self.note("compute")

        def timer_poll(self) -> None:
            self.note("poll")
            self.sleep(0.05)

    with Simulation([part(Busy)]) as sim:
        sim.run(0.7)
        story = ["poll 0", "poll 0.2", "later 0.3", "poll 0.4", "compute 0.5", "poll 0.6"]
        assert sim["busy"].worker.entries == story


def test_a_handler_that_sleeps_lets_its_caller_wait_and_all_others_go_on() -> None:
    with Simulation([part(Sleeping), part(Asking)]) as sim:
        sim.run(0.03)
        assert sim["pupil"].worker.times == [(0.0, 0.012), (0.015, 0.027)]
        assert sim["calculator"].computes == 7
    assert not sim.failed


def test_a_call_of_a_handler_that_sleeps_past_its_deadline_fails_when_the_handler_ends() -> None:
    class Impatient(Pupil):
        def compute(self) -> None:
            try:
                self.everything_proxy.work("b", deadline=0.002)
            except Timeout as exc:
                self.entries.append(f"{self.now() // 10**6} ms: {exc}")
                self.stop()

    with Simulation([part(Sleeping), part(Impatient)]) as sim:
        assert sim.run(until=lambda: sim["pupil"].state == "ended", at_most=1.0)
        assert sim["pupil"].worker.entries[1].startswith("12 ms: ")
        assert sim["pupil"].worker.entries[1].endswith("no answer in 0.002 s")


def test_replies_of_asynchronous_calls_come_before_the_next_event() -> None:
    class Eager(Pupil):
        def compute(self) -> None:
            first = self.everything_proxy._ask_async(e.work, ("x",), None)
            first.add_done_callback(self.got)
            self.entries.append("asked")

        def got(self, answer: Future[str]) -> None:
            self.entries.append(f"got {answer.result()} at {self.now()}")

    with Simulation([part(Calculator), part(Eager)]) as sim:
        sim.run(0.007)
        assert sim["pupil"].worker.entries == ["initialize", *("asked", "got x at 0"), *("asked", "got x at 5000000")]


def test_waiting_for_an_asynchronous_call_lets_others_go_on() -> None:
    class Waiting(Pupil):
        def compute(self) -> None:
            answer = self.everything_proxy._ask_async(e.work, ("y",), None)
            with pytest.raises(TimeoutError):
                answer.result(timeout=0.001)
            self.entries.append(f"{self.now() // 10**6} ms")
            self.entries.append(answer.result() + f" at {self.now() // 10**6} ms")
            self.stop()

    with Simulation([part(Sleeping), part(Waiting)]) as sim:
        sim.run(1.0)
        assert sim["pupil"].worker.entries[1:] == ["1 ms", "y at 12 ms", "finish"]


class Town(Diary):
    """Publishes its count."""

    component = Component("town", (Port(Verb.PUBLISHES, e.EVERYTHING, proxy=EverythingPublisher),), period=0.01)
    everything_proxy: EverythingPublisher

    def compute(self) -> None:
        self.entries.append("compute")
        self.everything_proxy.news(len(self.entries), "first")
        self.everything_proxy.news(len(self.entries), "second")


class Reader(Diary):
    component = Component("reader", (Port(Verb.SUBSCRIBES, e.EVERYTHING),), period=0.01)

    def Everything_news(self, number: int, text: str) -> None:
        self.entries.append(f"{text} {number} at {self.now() // 10**6} ms")

    def compute(self) -> None:
        self.entries.append("compute")


def test_publications_arrive_before_the_next_event_and_in_order() -> None:
    with Simulation([part(Town), part(Reader, ports__Everything__from='"town"')]) as sim:
        sim.run(0.011)
        assert sim["reader"].worker.entries == [
            *("initialize", "first 2 at 0 ms", "second 2 at 0 ms", "compute"),
            *("first 3 at 10 ms", "second 3 at 10 ms", "compute"),
        ]


def test_a_component_may_be_stopped_while_it_sleeps() -> None:
    class Sleeper(Diary):
        def compute(self) -> None:
            self.entries.append(f"slept {self.sleep(100.0)} until {self.now() // 10**6} ms")

    with Simulation([part(Sleeper)]) as sim:
        sim.run(0.05)
    assert sim["diary"].worker.entries == ["initialize", "slept False until 50 ms", "finish"]


def test_a_component_that_fails_ends_the_run_with_its_name() -> None:
    class Failing(Diary):
        def compute(self) -> None:
            raise ValueError("broken")

    with Simulation([part(Calculator), part(Failing)]) as sim:
        assert not sim.run(10.0)
        assert (sim.failed, sim.time) == (["diary"], 0.0)


def test_a_missing_server_is_an_error_at_once() -> None:
    with (
        pytest.raises(ComponentError, match=r"pupil requires Everything \(.*\), which no component"),
        Simulation([part(Pupil)]) as sim,
    ):
        sim.run(1.0)


def test_random_numbers_depend_on_the_seed_and_the_instance() -> None:
    class Player(Diary):
        def compute(self) -> None:
            self.entries.append(str(self.random.integers(1_000_000)))

    def numbers(seed: int) -> list[list[str]]:
        with Simulation([part(Player, "anna"), part(Player, "ben")], seed) as sim:
            sim.run(0.05)
            return [sim[name].worker.entries for name in ("anna", "ben")]

    assert numbers(1) == numbers(1)
    assert numbers(1) != numbers(2)
    assert numbers(1)[0] != numbers(1)[1]


def test_a_worker_knows_its_instance() -> None:
    with Simulation([part(Diary, "anna"), part(Diary, "ben")]) as sim:
        assert [sim[name].worker.instance for name in ("anna", "ben")] == ["anna", "ben"]


def test_the_hash_tells_runs_apart_and_the_lines_tell_why() -> None:
    def said(task: str) -> tuple[str, list[str]]:
        class Caller(Pupil):
            def compute(self) -> None:
                self.everything_proxy.work(task if self.now() else "same")

        lines: list[str] = []
        with Simulation([part(Calculator), part(Caller)], write=lines.append) as sim:
            sim.run(0.005)
            return sim.hash, lines

    (first, lines), (again, _), (other, others) = said("this"), said("this"), said("that")
    assert first == again != other
    assert lines[:2] == others[:2]
    assert [json.loads(each) for each in lines[2:]] == [
        {
            "ns": 5_000_000,
            "from": "pupil",
            "to": "calculator/Everything/work",
            "kind": "query",
            "values": {"task": "this"},
        },
        {"ns": 5_000_000, "to": "calculator/Everything/work", "kind": "ok", "values": {"ret": "this"}},
    ]


def test_threads_of_components_are_named() -> None:
    class Threaded(Diary):
        def initialize(self) -> None:
            self.done = threading.Event()
            threading.Thread(target=self.done.wait, name="camera reader").start()

        def finish(self) -> None:
            self.done.set()

    with Simulation([part(Threaded)]) as sim:
        sim.run(0.02)
        assert sim.foreign_threads() == ["camera reader"]


def test_two_components_of_one_name_are_refused() -> None:
    with pytest.raises(ComponentError, match="two components are called calculator"):
        Simulation([part(Calculator, "calculator"), part(Calculator, "calculator")])


def test_an_instance_that_is_not_there_is_named_with_the_most_similar_one() -> None:
    with Simulation([part(Diary)]) as sim, pytest.raises(KeyError, match="diary"):
        sim["dairy"]


def test_a_command_to_a_component_that_starts_later_waits_until_that_has_begun() -> None:
    class Hasty(Pupil):
        def initialize(self) -> None:
            self.everything_proxy.poke(7)

    with Simulation([part(Hasty), part(Calculator)]) as sim:
        sim.run(0.0)
        assert sim["calculator"].worker.entries[:2] == ["initialize", "poke 7"]


def test_components_that_call_each_other_in_initialize_do_not_wait_for_ever() -> None:
    class First(Calculator):
        component = Component(
            "first",
            (Port(Verb.IMPLEMENTS, e.EVERYTHING), Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy)),
            period=0.005,
        )
        everything_proxy: EverythingProxy

        def initialize(self) -> None:
            try:
                self.everything_proxy.work("hello", deadline=0.5)
            except Timeout:
                self.entries.append(f"no answer until {self.now() // 10**6} ms")

    class Second(First):
        component = Component("second", First.component.ports, period=0.005)

    first = part(First, ports__everything__from='"second"')
    with Simulation([first, part(Second, ports__everything__from='"first"')]) as sim:
        sim.run(1.0)
        assert "work hello" in sim["second"].worker.entries
        assert not sim.failed


class Waiting(Calculator):
    """Waits for the machine in its second compute, until that is told."""

    def initialize(self) -> None:
        self.told = threading.Event()

    def compute(self) -> None:
        if self.now():
            self.wait_for_the_machine()

    def wait_for_the_machine(self) -> None:
        self.told.wait(60.0)


class Telling(logging.Handler):
    """Calls a function with each warning."""

    def __init__(self, tell: Callable[[str], object]) -> None:
        super().__init__(logging.WARNING)
        self.tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        self.tell(record.getMessage())


@contextlib.contextmanager
def warnings_of(instance: str, tell: Callable[[str], object]) -> Iterator[None]:
    handler = Telling(tell)
    logging.getLogger(instance).addHandler(handler)
    try:
        yield
    finally:
        logging.getLogger(instance).removeHandler(handler)


def test_code_that_waits_for_the_machine_is_told_with_its_line_and_the_remedy():
    told: list[str] = []
    with Simulation([part(Waiting)]) as sim:
        sim.run(0.0)
        waiting = sim["calculator"].worker

        def tell(text: str) -> None:
            told.append(text)
            waiting.told.set()

        with warnings_of("calculator", tell):
            sim.run(1.0)
    line = inspect.getsourcelines(Waiting.wait_for_the_machine)[1] + 1
    assert len(told) == 1
    assert told[0].startswith(f"{__file__}:{line} waits while virtual time stands still")
    assert "`self.told.wait(60.0)`" in told[0]
    assert "self.sleep" in told[0]


class Waited(Waiting):
    """Waits for the machine in a handler."""

    def compute(self) -> None: ...

    def Everything_work(self, task: str) -> str:
        self.wait_for_the_machine()
        return super().Everything_work(task)


def test_a_handler_that_waits_for_the_machine_is_told_as_its_own_component():
    told: list[str] = []
    with Simulation([part(Waited), part(Asking)]) as sim:

        def tell(text: str) -> None:
            told.append(text)
            sim["calculator"].worker.told.set()

        with warnings_of("calculator", tell):
            sim.run(0.1)
    assert len(told) == 1


class Computing(Calculator):
    """Computes for a tenth of a second of processor time in its first compute."""

    def compute(self) -> None:
        end = time.thread_time() + 0.1
        while not self.now() and time.thread_time() < end:
            pass


def test_code_that_computes_long_is_not_told_to_wait():
    told: list[str] = []
    with warnings_of("calculator", told.append), Simulation([part(Computing), part(Sleeping, "sleeping")]) as sim:
        sim.run(0.1)
    assert told == []
