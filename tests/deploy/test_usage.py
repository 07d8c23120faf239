"""What processes use: how often that is looked at, and whose figures are whose."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable
from pathlib import Path

from robocomp_py.deploy.launcher.usage import Meter
from robocomp_py.testing.patience import wait_until

from ..leftovers import killed_on_failure

ME = {"me": (os.getpid(), None)}


def slow(step_s: float) -> Callable[[], float]:
    """A clock by which so much time passes from one look at it to the next."""
    times = itertools.count(0.0, step_s)
    return lambda: next(times)


def looks(meter: Meter, times: int) -> list[float]:
    """When what is known was looked at, asked so often."""
    return [meter.read(ME)["me"].at for _ in range(times)]


def test_processes_are_looked_at_now_and_then_only_however_often_it_is_asked() -> None:
    seen = looks(Meter(slow(0.01)), 300)
    assert 1 < len(set(seen)) < 5


def test_slow_measurements_are_made_less_often() -> None:
    seen = looks(Meter(slow(0.1)), 300)
    assert seen[0] < 1.0
    assert {at for at in seen if at < 19.0} == {seen[0]}
    assert seen[-1] > 19.0


def test_measurements_are_at_most_half_a_minute_apart() -> None:
    seen = looks(Meter(slow(1000.0)), 3)
    assert len(set(seen)) == 3


def test_the_usage_of_a_process_is_not_attributed_to_its_successor() -> None:
    meter = Meter(slow(0.01))
    assert meter.read(ME)["me"].memory > 0
    assert meter.read({"me": (os.getppid(), None)}) == {}


def test_one_of_many_that_was_started_again_has_the_memory_of_the_new_process() -> None:
    many = {f"n{number}": ME["me"] for number in range(100)}  # more than are measured in a few looks
    meter = Meter(slow(1000.0))
    before = meter.read({"it": ME["me"], **many})["it"].memory
    with killed_on_failure(["sleep", "600"]) as small:
        wait_until(lambda: Path(f"/proc/{small.pid}/comm").read_text() == "sleep\n")
        after = meter.read({"it": (small.pid, None), **many})["it"].memory
        small.kill()
    assert 0 < after < before / 2
