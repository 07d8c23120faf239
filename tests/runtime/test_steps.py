"""A component is driven step by step: by an executor, on its thread and its clock."""

from __future__ import annotations

import heapq
import itertools
import threading
from collections.abc import Callable
from typing import Any

import pytest

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.qos import QoS
from robocomp_py.runtime import settings
from robocomp_py.runtime.clock import NEVER, SECOND, Real, Virtual, ns
from robocomp_py.runtime.lifecycle import State
from robocomp_py.runtime.run import Running
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import wait_until
from robocomp_py.transports.base import TransportConfig, TransportFactory
from robocomp_py.transports.inproc import InprocTransport

from .components import Calculator, Diary, EverythingPublisher, Pupil
from .running import make as make_real
from .running import running

_buses = itertools.count()


@pytest.fixture
def find() -> Callable[[str], TransportFactory]:
    bus = f"steps-{next(_buses)}"
    return lambda name: lambda config: InprocTransport(TransportConfig({"bus": bus}, config.owner))


def make(worker: type[Worker[Any]], find: Any, clock: Virtual, *sets: str) -> Running:
    document = settings.Document()
    for assignment in sets:
        settings.override(document, assignment)
    return Running(worker, settings.check(worker.component, document), find, lambda _: None, clock)


def drive(clock: Virtual, until: int, *every: Running) -> None:
    """Run components until a time: what is due first comes first, of equal times the first component."""
    agenda = [(each.due(), number) for number, each in enumerate(every)]
    heapq.heapify(agenda)
    while agenda and agenda[0][0] <= until:
        due, number = heapq.heappop(agenda)
        clock.advance(due)
        every[number].beat()
        heapq.heappush(agenda, (every[number].due(), number))
    clock.advance(until)


def test_a_life_in_steps_is_the_life_of_run(find: Any) -> None:
    clock = Virtual()
    made = make(Diary, find, clock)
    worker: Any = made.worker
    assert made.begin()
    assert made.state is State.STARTING
    assert made.beat()
    assert made.state is State.INITIALIZE
    assert made.beat()
    assert worker.entries == ["initialize"]
    assert made.due() == clock.now() == 0
    assert made.beat()
    assert worker.entries == ["initialize", "compute"]
    assert made.due() == ns(0.005)
    assert not made.beat()
    assert worker.entries == ["initialize", "compute"]
    clock.advance(made.due())
    assert made.beat()
    assert worker.entries == ["initialize", "compute", "compute"]
    worker.goToEmergency()
    clock.advance(made.due())
    assert made.beat()
    worker.goToRestore()
    assert made.due() == clock.now()
    assert made.beat()
    assert made.end()
    assert worker.story == ["initialize", "compute", "emergency", "restore", "finish"]
    assert made.due() == NEVER
    assert not made.beat()
    assert made.end()
    assert worker.entries.count("finish") == 1


def test_all_is_called_on_the_thread_of_the_executor(find: Any) -> None:
    class Here(Diary):
        def compute(self) -> None:
            assert threading.current_thread() is here

    here, before = threading.current_thread(), set(threading.enumerate())
    clock = Virtual()
    made = make(Here, find, clock)
    made.begin()
    drive(clock, SECOND, made)
    assert made.computes == 201
    assert made.end()
    assert set(threading.enumerate()) <= before  # others may end


def test_components_begin_before_those_that_they_require(find: Any) -> None:
    clock = Virtual()
    pupil, calculator = make(Pupil, find, clock, "ports.everything.from=calculator"), make(Calculator, find, clock)
    assert pupil.begin()
    assert not pupil.beat()
    assert pupil.state is State.STARTING
    assert calculator.begin()
    assert pupil.beat()
    assert pupil.state is State.INITIALIZE
    for each in (pupil, calculator):
        assert each.end()


def test_every_run_of_a_virtual_time_is_the_same(find: Any) -> None:
    stories = []
    for _ in range(3):
        clock = Virtual()
        said: list[tuple[int, str]] = []

        def named(name: str, period: float, clock: Virtual = clock, said: Any = said) -> type[Worker[Any]]:
            class One(Diary):
                component = Component(name, period=period)

                def compute(self) -> None:
                    said.append((clock.now(), name))

            return One

        every = [make(named("slow", 0.05), find, clock), make(named("fast", 0.02), find, clock)]
        for each in every:
            each.begin()
        drive(clock, ns(0.1), *every)
        for each in every:
            each.end()
        stories.append(said)
    assert stories[0] == stories[1] == stories[2]
    assert [(now // 1_000_000, name) for now, name in stories[0]] == [
        *((0, "slow"), (0, "fast"), (20, "fast"), (40, "fast"), (50, "slow"), (60, "fast"), (80, "fast")),
        *((100, "slow"), (100, "fast")),
    ]


def test_what_its_code_raises_ends_it(find: Any) -> None:
    class Broken(Diary):
        def compute(self) -> None:
            raise ValueError("broken")

    clock = Virtual()
    made = make(Broken, find, clock)
    made.begin()
    drive(clock, SECOND, made)
    assert made.is_over
    assert made.worker.story == ["initialize", "finish"]  # type: ignore[attr-defined]
    assert not made.end()


def test_a_port_that_cannot_be_opened_is_reported_by_begin(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    clock = Virtual()
    first, second = make(Calculator, find, clock), make(Calculator, find, clock)
    assert first.begin()
    assert not second.begin()
    assert not second.end()
    assert first.end()
    assert "an instance `calculator` is already running" in caplog.text


def test_ended_before_its_peers_are_there_it_does_not_finish(find: Any) -> None:
    made = make(Pupil, find, Virtual())
    made.begin()
    assert made.end()
    assert made.worker.entries == []  # type: ignore[attr-defined]


def test_a_step_is_not_taken_inside_another(find: Any) -> None:
    class Nested(Diary):
        def compute(self) -> None:
            super().compute()
            self.seen = (made.due(), made.beat())

    made = make(Nested, find, Virtual())
    made.begin()
    for _ in range(3):
        made.beat()
    assert made.worker.seen == (NEVER, False)  # type: ignore[attr-defined]
    assert made.end()


def test_a_worker_reads_the_clock_and_sleeps_on_it(find: Any) -> None:
    class Sleeper(Diary):
        def compute(self) -> None:
            self.entries.append(f"{self.now()} {self.sleep(2.5)} {self.now()}")

    clock = Virtual()
    made = make(Sleeper, find, clock, "component.period=1")
    made.begin()
    drive(clock, SECOND, made)
    made.end()
    assert made.worker.entries[1] == "0 True 2500000000"  # type: ignore[attr-defined]


def test_an_executor_lets_others_run_while_one_sleeps(find: Any) -> None:
    class Sleeper(Diary):
        component = Component("sleeper", period=10.0)

        def compute(self) -> None:
            self.sleep(1.0)

    def others(wake: threading.Event, until: int) -> None:
        drive(clock, until, *every)

    clock = Virtual(waiting=others)
    every = [make(Sleeper, find, clock), make(Diary, find, clock, "component.period=0.25")]
    for each in every:
        each.begin()
    drive(clock, SECOND // 2, *every)
    assert clock.now() == SECOND
    assert (every[0].computes, every[1].computes) == (1, 5)
    for each in every:
        each.end()


def test_a_sleep_ends_when_the_component_is_stopped(find: Any) -> None:
    class Sleeper(Diary):
        def compute(self) -> None:
            self.entries.append(str(self.sleep(1000.0)))

        def finish(self) -> None:
            self.entries.append(str(self.sleep(0.001)))

    made = make_real(Sleeper, find)
    with running(made) as worker:
        wait_until(lambda: made.monitor.load == (0, 1))
    assert worker.entries == ["initialize", "False", "True"]


def test_handlers_may_run_while_a_component_sleeps(find: Any) -> None:
    class Sleeper(Calculator):
        def compute(self) -> None:
            super().compute()
            self.sleep(1000.0)

    made = make_real(Sleeper, find)
    with running(made) as worker, running(make_real(Pupil, find)) as pupil:
        wait_until(lambda: made.monitor.load == (0, 1))
        assert pupil.everything_proxy.divide(7, 2) == (3, 1)
    assert worker.entries == ["initialize", "compute", "finish"]


@pytest.mark.parametrize("seconds", [-1.0, float("nan"), float("inf"), 1e9])
def test_a_sleep_has_a_length(find: Any, seconds: float) -> None:
    made = make(Diary, find, Virtual())
    with pytest.raises(ValueError, match="sleeps for 0 to 1e"):
        made.worker.sleep(seconds)


def test_missed_deadlines_follow_the_clock(find: Any) -> None:
    port = Port(Verb.PUBLISHES, e.EVERYTHING, proxy=EverythingPublisher, qos=QoS(deadline=0.5))

    class Speaker(Diary):
        component = Component("speaker", (port,), period=0.5)
        everything_proxy: EverythingPublisher

        def compute(self) -> None:
            if self.now() <= SECOND or self.now() == 3 * SECOND:
                self.everything_proxy.news(1, "")

        def on_deadline_missed(self, port: str, operation: str, instance: str, total: int) -> None:
            self.entries.append(f"{self.now() / SECOND:g} s: {total}")

    clock = Virtual()
    made = make(Speaker, find, clock)
    made.begin()
    drive(clock, ns(3.9), made)
    made.end()
    assert made.worker.entries[1:-1] == ["1.5 s: 1", "2 s: 2", "2.5 s: 3", "3.5 s: 4"]  # type: ignore[attr-defined]


def test_with_a_virtual_clock_run_takes_no_time(find: Any) -> None:
    class Long(Diary):
        component = Component("long", period=100.0)

        def compute(self) -> None:
            super().compute()
            if len(self.entries) > 1000:
                self.stop()

    clock = Virtual()
    assert make(Long, find, clock).run()
    assert clock.now() == 999 * 100 * SECOND


def test_the_clock_of_the_machine_is_monotonic_and_counts_from_1970() -> None:
    clock = Real()
    begun = clock.now()
    assert begun > 1_700_000_000 * SECOND
    assert clock.now() >= begun


def test_waiting_ends_at_an_event() -> None:
    wake = threading.Event()
    wake.set()
    assert Real().wait(wake, NEVER)
    assert Virtual().wait(wake, NEVER)
    assert not Real().wait(threading.Event(), 0)


def test_waiting_for_nothing_is_an_error_of_virtual_time() -> None:
    with pytest.raises(RuntimeError, match="nothing is due"):
        Virtual().wait(threading.Event(), NEVER)
