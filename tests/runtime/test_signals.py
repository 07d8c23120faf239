"""Signals as calls."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from robocomp_py.runtime.signals import Signals
from robocomp_py.testing.patience import SOON, wait_until


@pytest.fixture
def received() -> Iterator[list[int]]:
    numbers: list[int] = []
    with Signals(numbers.append):
        yield numbers


def test_a_signal_calls_the_function_once(received: list[int]) -> None:
    os.kill(os.getpid(), signal.SIGTERM)
    wait_until(lambda: received == [signal.SIGTERM])
    os.kill(os.getpid(), signal.SIGHUP)
    wait_until(lambda: len(received) > 1)
    assert received == [signal.SIGTERM, signal.SIGHUP]


def test_other_threads_learn_of_a_signal_at_once(received: list[int]) -> None:
    """Python's own handler tells nothing here, as if the main thread waited without end."""
    heard = threading.Event()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Signals, "_received", lambda *_: None)
        with Signals(lambda _: heard.set()):
            os.kill(os.getpid(), signal.SIGTERM)
            assert heard.wait(SOON)


def test_a_signal_is_reported_although_another_wakeup_fd_is_set(received: list[int]) -> None:
    before = signal.set_wakeup_fd(-1)
    os.kill(os.getpid(), signal.SIGTERM)
    signal.set_wakeup_fd(before)
    wait_until(lambda: received)
    assert received == [signal.SIGTERM]


def test_a_second_ctrl_c_has_its_usual_effect(received: list[int]) -> None:
    os.kill(os.getpid(), signal.SIGINT)
    wait_until(lambda: received)
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def fork() -> int:
    """A process that waits for a signal; its id, once it does as a forked one has to."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.write(writing, b"!")
        signal.pause()
        os._exit(0)
    os.read(reading, 1)
    os.close(reading)
    os.close(writing)
    return pid


def test_a_process_that_is_forked_meanwhile_takes_signals_as_before(received: list[int]) -> None:
    pid = fork()
    os.kill(pid, signal.SIGTERM)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == -signal.SIGTERM
    assert received == []


def test_signal_handling_ends_while_a_forked_process_lives_on() -> None:
    with Signals(lambda _: None):
        pid = fork()
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)


def test_a_forked_process_can_exit_the_context_too() -> None:
    pid = 0
    try:
        with Signals(lambda _: None):
            pid = os.fork()
    except BaseException:  # whatever it is: the forked process must not go on as pytest
        if pid:
            raise
        os._exit(1)
    if pid == 0:
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0


def test_a_signal_that_would_raise_something_while_it_is_entered_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    received: list[int] = []
    signals = Signals(received.append)
    start = signals._thread.start

    def interrupted() -> None:
        start()
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(signals._thread, "start", interrupted)
    with signals:
        wait_until(lambda: received)
    assert received == [signal.SIGINT]


def test_afterwards_all_is_as_before() -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    with Signals(lambda _: None):
        pass
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == before
    assert signal.set_wakeup_fd(-1) == -1
    assert "signals" not in [thread.name for thread in threading.enumerate()]


REENTERED = """
import signal, sys
from robocomp_py.runtime.ending import end_after, settle
signal.signal(signal.SIGTERM, lambda *_: end_after(60.0))

def interrupt(frame, event, argument):
    if event == "c_return":  # such as that of taking a lock
        signal.raise_signal(signal.SIGTERM)

sys.setprofile(interrupt)
end_after(60.0)
sys.setprofile(None)
settle()
"""


def test_a_signal_while_another_one_schedules_the_end_is_no_deadlock() -> None:
    done = subprocess.run([sys.executable, "-c", REENTERED], timeout=SOON * 3, check=False)
    assert done.returncode == 0
