"""What happens around components on a machine: its clock is set, and other users have components, too."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from robocomp_py.errors import Timeout
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import find_transport

from .components import Calculator, Pupil
from .running import make, running

DAY = 24 * 3600 * 10**9


@pytest.mark.parametrize("days", [1, -1])
def test_periods_and_calls_go_on_when_the_clock_is_set(days: int, monkeypatch: pytest.MonkeyPatch) -> None:
    over = threading.Event()

    class Slow(Calculator):
        def Everything_work(self, task: str) -> str:
            over.wait(SOON)
            return task

    options = ("transports.inproc.bus=clock", "middleware=inproc")
    server, client = make(Slow, find_transport, *options), make(Pupil, find_transport, *options)
    with running(server), running(client) as pupil:
        true = time.time_ns
        monkeypatch.setattr(time, "time_ns", lambda: true() + days * DAY)
        monkeypatch.setattr(time, "time", lambda: (true() + days * DAY) / 1e9)
        before = server.computes, client.computes, server.overruns
        wait_until(lambda: server.computes > before[0] + 3 and client.computes > before[1] + 3)
        assert server.overruns - before[2] < 100_000, "a day has 17 million periods"
        assert pupil.everything_proxy.divide(7, 2, deadline=SOON) == (3, 1)
        begun = time.monotonic()
        with pytest.raises(Timeout):
            pupil.everything_proxy.work("long", deadline=0.2)
        assert time.monotonic() - begun >= 0.19
        over.set()


@pytest.fixture
def homes() -> Iterator[tuple[str, str]]:
    """The run-time folders of two users."""
    with ExitStack() as both:
        folders = (both.enter_context(tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp")) for _ in range(2))
        yield next(folders), next(folders)


@pytest.mark.parametrize("middleware", ["zeromq", "zenoh", "shm"])
def test_users_of_one_machine_have_components_of_the_same_name(
    middleware: str, homes: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    calculators: list[Calculator] = []
    pupils: list[Pupil] = []
    with ExitStack() as everybody:
        for home in homes:
            monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", home)
            option = f"middleware={middleware}"
            calculators.append(everybody.enter_context(running(make(Calculator, find_transport, option))))
            pupils.append(everybody.enter_context(running(make(Pupil, find_transport, option))))
        for number, (calculator, pupil) in enumerate(zip(calculators, pupils, strict=True)):
            assert pupil.everything_proxy.work(f"of {number}") == f"of {number}"
            assert [entry for entry in calculator.entries if entry.startswith("work")] == [f"work of {number}"]
