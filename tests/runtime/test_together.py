"""Several components in one process: who begins and ends when, and what is told of it."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from robocomp_py.runtime.notify import CONTRACT
from robocomp_py.runtime.settings import Settings
from robocomp_py.runtime.together import Together
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing.patience import SOON, wait_until

from .components import Calculator, Diary, Pupil


class Told:
    """The messages to the launcher, and the actions of the components, in order."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.status = ""
        self.contracts: list[str] = []

    def __call__(self, text: str) -> None:
        self.contracts += [line for line in text.split("\n") if line.startswith(CONTRACT)]
        self.lines += [line for line in text.split("\n") if not line.startswith(("STATUS=", CONTRACT))]
        self.status = next((line for line in text.split("\n") if line.startswith("STATUS=")), "")


@pytest.fixture
def told() -> Told:
    return Told()


@contextmanager
def living(together: Together, *, stop: bool = True) -> Iterator[list[bool]]:
    """While the components run; then what `run` returned."""
    outcome: list[bool] = []
    thread = threading.Thread(target=lambda: outcome.append(together.run()))
    thread.start()
    try:
        yield outcome
    finally:
        if stop:
            together.stop()
        thread.join(SOON)
        assert not thread.is_alive()


def settings(instance: str, **more: Any) -> Settings:
    return Settings(instance, period=0.005, transports={"inproc": {"bus": "together"}}, **more)


def diary(story: list[str], *, initialize: Callable[[], object] = lambda: None) -> type[Worker[Any]]:
    """A component that writes into a story that several share."""

    class Told(Diary):
        def initialize(self) -> None:
            story.append(f"{self.log.name} begins")
            initialize()

        def compute(self) -> None: ...

        def finish(self) -> None:
            story.append(f"{self.log.name} ends")

    return Told


def test_the_process_is_ready_once_all_are(told: Told) -> None:
    gate = threading.Event()
    together = Together(told)
    together.add(diary([]), settings("quick"))
    together.add(diary([], initialize=lambda: gate.wait(SOON)), settings("slow"))
    with living(together) as outcome:
        wait_until(lambda: told.status == "STATUS=waiting for slow")
        assert told.lines == []
        gate.set()
        wait_until(lambda: told.lines == ["READY=1"])
    assert outcome == [True]
    assert told.lines == ["READY=1", "STOPPING=1"]


def test_components_that_require_each_other_start_in_any_order(told: Told) -> None:
    together = Together(told)
    pupil = together.add(Pupil, settings("pupil", middleware="inproc"))
    together.add(Calculator, settings("calculator", middleware="inproc"))
    with living(together):
        wait_until(lambda: told.lines == ["READY=1"])
        assert pupil.running.worker.everything_proxy.divide(7, 2) == (3, 1)  # type: ignore[attr-defined]
    named = {line.removeprefix(CONTRACT).split(" ")[0] for line in told.contracts}
    assert named == {"pupil", "calculator"}, "each says with which contracts it has started"


def test_a_dependent_component_starts_when_its_dependency_is_ready(told: Told) -> None:
    story: list[str] = []
    gate = threading.Event()
    together = Together(told)
    together.add(diary(story), settings("late"), ["early"])
    together.add(diary(story, initialize=lambda: gate.wait(SOON)), settings("early"))
    with living(together):
        wait_until(lambda: story == ["early begins"])
        gate.set()
        wait_until(lambda: told.lines == ["READY=1"])
    assert story == ["early begins", "late begins", "early ends", "late ends"]


def test_components_are_stopped_one_after_the_other_the_last_one_first(told: Told) -> None:
    story: list[str] = []
    together = Together(told)
    for name in ("one", "two", "three"):
        together.add(diary(story), settings(name))
    with living(together) as outcome:
        wait_until(lambda: told.lines == ["READY=1"])
    assert story[3:] == ["three ends", "two ends", "one ends"]
    assert outcome == [True]


def test_a_component_that_fails_stops_the_others(told: Told, caplog: pytest.LogCaptureFixture) -> None:
    story: list[str] = []
    gate = threading.Event()

    class Failing(Diary):
        def compute(self) -> None:
            if gate.is_set():
                raise ZeroDivisionError("divided")

    together = Together(told)
    together.add(diary(story), settings("one"))
    together.add(Failing, settings("failing"))
    together.add(diary(story), settings("two"))
    with living(together, stop=False) as outcome:
        wait_until(lambda: told.lines == ["READY=1"])
        gate.set()
    assert story[2:] == ["two ends", "one ends"]
    assert outcome == [False]
    assert "ZeroDivisionError" in caplog.text


def test_a_component_that_ends_normally_does_not_stop_the_others(told: Told) -> None:
    together = Together(told)
    brief = together.add(diary([]), settings("brief"))
    other = together.add(diary([]), settings("other"))
    with living(together, stop=False) as outcome:
        wait_until(lambda: told.lines == ["READY=1"])
        brief.running.worker.stop()
        wait_until(lambda: told.lines[1:] == ["X_ROBOCOMP_ENDED=brief"])
        assert other.running.ready.is_set()
        assert outcome == []
        other.running.worker.stop()
    assert told.lines == ["READY=1", "X_ROBOCOMP_ENDED=brief", "STOPPING=1"]
    assert outcome == [True]


def test_a_component_that_ends_before_the_others_are_ready_does_not_hold_them_up(told: Told) -> None:
    class Brief(Diary):
        def initialize(self) -> None:
            self.stop()

    together = Together(told)
    together.add(Brief, settings("brief"))
    together.add(diary([]), settings("other"))
    with living(together) as outcome:
        wait_until(lambda: sorted(told.lines) == ["READY=1", "X_ROBOCOMP_ENDED=brief"])
    assert outcome == [True]


def test_a_dependency_that_ended_before_it_was_ready_is_not_waited_for(
    told: Told, caplog: pytest.LogCaptureFixture
) -> None:
    class Brief(Diary):
        def initialize(self) -> None:
            self.stop()

    story: list[str] = []
    together = Together(told)
    together.add(Brief, settings("brief"))
    together.add(diary(story), settings("late"), ["brief"])
    with living(together, stop=False) as outcome:
        pass
    assert outcome == [False]
    assert story == []
    assert "brief ended before it was ready, so late does not start" in caplog.text


def test_a_component_that_waits_for_its_dependency_can_be_stopped(told: Told) -> None:
    story: list[str] = []
    gate = threading.Event()
    together = Together(told)
    slow = together.add(diary(story, initialize=lambda: gate.wait(SOON)), settings("slow"))
    together.add(diary(story), settings("late"), ["slow"])
    with living(together) as outcome:
        wait_until(lambda: story == ["slow begins"])
        together.stop()
        wait_until(lambda: told.lines == ["STOPPING=1"])
        wait_until(lambda: slow.running.state == "finish")
        gate.set()
    assert outcome == [True]
    assert story == ["slow begins", "slow ends"]


def test_the_status_of_a_ready_component_is_passed_on_with_its_name(told: Told) -> None:
    class Speaking(Diary):
        running: Any = None

        def initialize(self) -> None:
            self.running._tell("STATUS=has no laser")

    together = Together(told)
    Speaking.running = together.add(Speaking, settings("left")).running
    with living(together):
        wait_until(lambda: told.status == "STATUS=left has no laser")
        Speaking.running._tell("STATUS=")
        wait_until(lambda: told.status == "STATUS=")


def test_log_messages_carry_the_name_of_their_component(told: Told) -> None:
    spoken: list[tuple[str, str]] = []
    together = Together(told)

    class Listening(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            member = together.speaking(record)
            spoken.append((record.getMessage(), member.name if member else ""))

    class Talking(Calculator):
        def initialize(self) -> None:
            logging.getLogger("a library").info("in a hook")

        def Everything_work(self, task: str) -> str:
            logging.getLogger("a library").info("in a handler")
            threading.Thread(target=self.log.info, args=("by its own name",)).start()
            threading.Thread(target=logging.getLogger("a library").info, args=("from nowhere",)).start()
            return task

    pupil = together.add(Pupil, settings("pupil", middleware="inproc"))
    together.add(Talking, settings("talking", middleware="inproc"))
    listening, root = Listening(), logging.getLogger()
    before = root.level
    root.addHandler(listening)
    root.setLevel(logging.INFO)
    try:
        with living(together):
            wait_until(lambda: told.lines == ["READY=1"])
            pupil.running.worker.everything_proxy.work("task")  # type: ignore[attr-defined]
            wait_until(lambda: "from nowhere" in dict(spoken) and "by its own name" in dict(spoken))
    finally:
        root.removeHandler(listening)
        root.setLevel(before)
    whose = {
        "in a hook": "talking",
        "in a handler": "talking",
        "by its own name": "talking",
        "from nowhere": "",
    }
    assert {text: name for text, name in spoken if text in whose} == whose  # a busy machine may have more to say
    assert sorted(name for text, name in spoken if text == "ready") == ["pupil", "talking"]
