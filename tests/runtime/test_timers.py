"""When timers are called, what is counted, and what stops them. On a virtual clock, unless a test says otherwise."""

from __future__ import annotations

import itertools
import re
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from robocomp_py.contract.component import Component, PeriodicTimer
from robocomp_py.errors import ComponentError, ConfigurationError, Unreachable
from robocomp_py.runtime import settings
from robocomp_py.runtime.clock import SECOND, Virtual, ns
from robocomp_py.runtime.effective import as_toml, effective
from robocomp_py.runtime.RoboCompCommonBehavior import TimerStatus
from robocomp_py.runtime.timers import MAX_PENDING
from robocomp_py.testing.patience import wait_until
from robocomp_py.transports.base import TransportConfig, TransportFactory
from robocomp_py.transports.inproc import InprocTransport

from .components import Diary
from .running import make as make_real
from .running import running
from .test_steps import drive, make

_buses = itertools.count()


@pytest.fixture
def find() -> Callable[[str], TransportFactory]:
    bus = f"timers-{next(_buses)}"
    return lambda name: lambda config: InprocTransport(TransportConfig({"bus": bus}, config.owner))


class Polling(Diary):
    component = Component("polling", period=1.0, timers=(PeriodicTimer("poll", 0.2), PeriodicTimer("report", 0.5)))

    def note(self, what: str) -> None:
        self.entries.append(f"{what} {self.now() / SECOND:g}")

    def compute(self) -> None:
        self.note("compute")

    def timer_poll(self) -> None:
        self.note("poll")

    def timer_report(self) -> None:
        self.note("report")


def lived(worker: type[Diary], find: Any, seconds: float, *sets: str) -> Any:
    """The worker after that time."""
    clock = Virtual()
    made = make(worker, find, clock, *sets)
    made.begin()
    drive(clock, ns(seconds), made)
    assert made.end()
    made.worker.made = made  # type: ignore[attr-defined]
    return made.worker


def test_a_peer_that_is_away_is_told_once_although_other_methods_complete(
    find: Any, caplog: pytest.LogCaptureFixture
) -> None:
    class Alone(Polling):
        def timer_report(self) -> None:
            if 2 <= self.now() / SECOND <= 2.5:
                return
            raise Unreachable("no server")

    lived(Alone, find, 4.0)
    told = [each.getMessage() for each in caplog.records if "did not complete" in each.getMessage()]
    assert len(told) == 2, told  # it was back at 2 s


def test_each_timer_has_its_period_and_of_equal_times_the_first_declared_comes_first(find: Any) -> None:
    worker = lived(Polling, find, 1.0)
    assert worker.entries[1:-1] == [
        *("compute 0", "poll 0", "report 0", "poll 0.2", "poll 0.4", "report 0.5", "poll 0.6", "poll 0.8"),
        *("compute 1", "poll 1", "report 1"),
    ]
    assert [(each.name, each.calls, each.overruns) for each in worker.timers] == [("poll", 6, 0), ("report", 3, 0)]


def test_timers_do_not_drift(find: Any) -> None:
    assert lived(Polling, find, 1000.0).entries.count("poll 999.8") == 1


def test_a_call_that_takes_long_skips_periods_and_counts_them(find: Any) -> None:
    class Slow(Polling):
        def timer_poll(self) -> None:
            super().timer_poll()
            if self.now() < SECOND:
                self.sleep(0.5)

    worker = lived(Slow, find, 1.0)
    assert [each for each in worker.entries if "poll" in each] == ["poll 0", "poll 0.6"]
    assert worker.timers.poll.overruns == 4
    assert worker.made.overruns == 0


def test_the_period_of_a_timer_is_changed_at_run_time_and_by_configuration(find: Any) -> None:
    class Changing(Polling):
        def timer_poll(self) -> None:
            super().timer_poll()
            self.timers.poll.period = 0.4

    worker = lived(Changing, find, 1.0, "timers.poll=0.1", "timers.report=0.9")
    assert [each for each in worker.entries if "poll" in each] == ["poll 0", "poll 0.4", "poll 0.8"]
    assert [each for each in worker.entries if "report" in each] == ["report 0", "report 0.9"]
    for wrong in (0, -1, float("nan"), 1e9):
        with pytest.raises(ValueError, match="positive"):
            worker.timers.poll.period = wrong


def test_wrong_timers_in_a_configuration_are_told(find: Any) -> None:
    with pytest.raises(ConfigurationError, match=r"unknown timer `pol`; did you mean `poll`\?"):
        make(Polling, find, Virtual(), "timers.pol=1")
    with pytest.raises(ConfigurationError, match=r"timers\.poll"):
        make(Polling, find, Virtual(), "timers.poll=0")


def test_the_environment_sets_a_period_and_the_effective_configuration_tells_it(find: Any) -> None:
    document = settings.Document()
    settings.environment(document, Polling.component, {"ROBOCOMP__TIMERS__POLL": "0.1"})
    chosen = settings.check(Polling.component, document)
    assert chosen.timers == {"poll": 0.1, "report": 0.5}
    told = as_toml(effective(Polling.component, chosen, document, "inproc"))
    assert re.search(
        r"\[timers\]\npoll = 0.1 +# environment variable ROBOCOMP__TIMERS__POLL\nreport = 0.5 +# its .cdsl", told
    )


def test_the_status_of_a_component_has_its_timers(find: Any) -> None:
    class Slow(Polling):
        def timer_poll(self) -> None:
            self.sleep(0.35)

    made = lived(Slow, find, 1.0).made
    assert made._status().timers == [TimerStatus("poll", 0.2, 3, 3), TimerStatus("report", 0.5, 2, 0)]
    assert made.life.split()[:3] == ["polling", "ended", "3"]
    assert made.overruns == 0


def test_an_unknown_timer_is_reported(find: Any) -> None:
    worker = make(Polling, find, Virtual()).worker
    with pytest.raises(AttributeError, match=r"unknown timer `pol`; did you mean `poll`\?"):
        _ = worker.timers.pol
    with pytest.raises(AttributeError, match=r"self.timers.poll.period"):
        worker.timers.poll = 0.5  # type: ignore[assignment]
    assert dir(worker.timers) == ["poll", "report"]
    assert repr(worker.timers.poll) == "<timer poll: every 0.2 s, 0 calls, 0 overruns>"


def test_a_timer_needs_its_method(find: Any) -> None:
    class Without(Diary):
        component = Polling.component

    with pytest.raises(ComponentError, match="Without lacks the method timer_poll"):
        make(Without, find, Virtual())


def test_timers_rest_during_an_emergency_and_begin_anew_after_it(find: Any) -> None:
    class Alarmed(Polling):
        def initialize(self) -> None:
            self.after(0.7, self.goToEmergency)
            self.after(0.9, partial(self.note, "later"))

        def emergency(self) -> None:
            self.note("emergency")
            self.goToRestore()

        def timer_report(self) -> None: ...

    worker = lived(Alarmed, find, 1.3)
    assert worker.entries[:-1] == [
        *("compute 0", "poll 0", "poll 0.2", "poll 0.4", "poll 0.6", "emergency 1", "restore"),
        *("later 1", "poll 1", "poll 1.2"),
    ]
    assert worker.timers.poll.overruns == 0


def test_a_function_is_called_once_when_its_time_has_come(find: Any) -> None:
    class Later(Polling):
        component = Component("later", period=10.0)

        def initialize(self) -> None:
            for seconds in (0.3, 0.1, 0.3):
                self.after(seconds, partial(self.note, f"{seconds}"))

        def compute(self) -> None:
            cancelled = self.after(0.2, partial(self.note, "cancelled"))
            assert cancelled.pending
            assert cancelled.cancel()
            assert not cancelled.cancel()
            self.after(0, self.again)

        def again(self) -> None:
            self.note("again")
            self.handle = self.after(0.25, self.again)

    worker = lived(Later, find, 0.6)
    assert worker.entries == ["again 0", "0.1 0.1", "again 0.25", "0.3 0.3", "0.3 0.3", "again 0.5", "finish"]
    assert not worker.handle.pending
    assert not worker.after(1.0, worker.again).pending


def test_what_a_timer_or_a_function_raises_stops_the_component(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    class Broken(Diary):
        def initialize(self) -> None:
            self.after(0.5, self.fail)

        def fail(self) -> None:
            raise ValueError("broken")

    clock = Virtual()
    made = make(Broken, find, clock)
    made.begin()
    drive(clock, SECOND, made)
    assert made.is_over
    assert not made.end()
    assert "Broken.fail raised ValueError" in caplog.text


def test_the_number_of_waiting_functions_is_bounded(find: Any) -> None:
    worker = make(Diary, find, Virtual()).worker
    handles = [worker.after(1.0, worker.compute) for _ in range(MAX_PENDING)]
    with pytest.raises(ComponentError, match="1000 functions wait for their time"):
        worker.after(1.0, worker.compute)
    handles[7].cancel()
    assert worker.after(1.0, worker.compute).pending


def test_wrong_functions_are_told_at_once(find: Any) -> None:
    async def later() -> None: ...

    worker = make(Diary, find, Virtual()).worker
    for wrong in (later, 7):
        with pytest.raises(TypeError, match="function without arguments"):
            worker.after(1.0, wrong)  # type: ignore[arg-type]
    for seconds in (-1.0, float("nan"), 1e9):
        with pytest.raises(ValueError, match="called after 0 to"):
            worker.after(seconds, worker.compute)


def test_timers_run_while_compute_waits(find: Any) -> None:
    """In real time."""

    class Waiting(Diary):
        component = Component("waiting", timers=(PeriodicTimer("poll", 0.001),))

        def compute(self) -> None:
            self.sleep(1000.0)

        def timer_poll(self) -> None:
            assert made.monitor.is_inside
            self.entries.append("poll")

    made = make_real(Waiting, find)
    with running(made) as worker:
        wait_until(lambda: worker.timers.poll.calls > 20)
        worker.after(0, partial(worker.entries.append, "later"))
        wait_until(lambda: "later" in worker.entries)
    assert worker.outcome


def test_a_component_without_timers_has_no_thread_for_them_until_after_is_called(find: Any) -> None:
    """In real time."""
    made = make_real(Diary, find)
    with running(made) as worker:
        assert not [each for each in threading.enumerate() if each.name == "diary-timers"]
        worker.after(0.001, partial(worker.entries.append, "later"))
        wait_until(lambda: "later" in worker.entries)
        assert [each for each in threading.enumerate() if each.name == "diary-timers"]
    assert not [each for each in threading.enumerate() if each.name == "diary-timers"]


def test_a_timer_that_is_too_slow_says_so_once(find: Any, caplog: pytest.LogCaptureFixture) -> None:
    class Slow(Polling):
        def timer_poll(self) -> None:
            self.sleep(0.5)

    lived(Slow, find, 100.0)
    said = [line for line in caplog.messages if "periods were skipped" in line]
    assert len(said) == 1
    assert "Slow.timer_poll took 0.5 s, longer than the period of 0.2 s" in said[0]
