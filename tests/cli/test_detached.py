"""What goes on without the terminal it was started from."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.testing.patience import SOON, wait_until

from .losing import UNHEARD
from .programs import alive

WORK = """
import os, signal, subprocess, sys, time
from pathlib import Path
from robocomp_py.cli.common import command
from robocomp_py.cli.deploying.detached import detached

def work(parent):
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGUSR1])
    helper = subprocess.Popen(["sleep", "600"])
    try:
        print("works", os.getpid(), helper.pid, os.getsid(0), flush=True)
        STEPS
        while True:
            time.sleep(0.1)  # an endless wait would miss a signal that comes just before it begins
    except KeyboardInterrupt:
        return 130
    finally:
        print("cleans up", flush=True)
        helper.kill()

@command
def main(arguments=None):
    return detached(work)

sys.exit(main())
"""


@contextlib.contextmanager
def started(steps: str = "pass", before: str = "") -> Iterator[subprocess.Popen[str]]:
    code = before + WORK.replace("STEPS", steps)
    with subprocess.Popen(
        [sys.executable, "-c", code], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as waiting:
        try:
            yield waiting
        finally:
            waiting.kill()


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_before_it_detaches_it_ends_with_its_waiting_parent(number: int, code: int) -> None:
    with started() as waiting:
        assert waiting.stdout is not None
        worker = int(waiting.stdout.readline().split()[1])
        waiting.send_signal(number)
        assert waiting.stdout.read() == "cleans up\n"
        assert waiting.wait(SOON) == code
        assert not alive(worker)


def test_an_interrupt_just_before_it_is_waited_for_ends_it_all_the_same() -> None:
    with started(before=UNHEARD) as waiting:
        assert waiting.stdout is not None
        waiting.stdout.readline()
        try:
            assert waiting.communicate("\n", SOON) == ("cleans up\n", None)
        finally:
            waiting.terminate()
    assert waiting.returncode == 130


def test_its_waiting_parent_ends_with_its_exit_code() -> None:
    with started("return 3") as waiting:
        assert waiting.stdout is not None
        assert waiting.stdout.read().endswith("cleans up\n")
        assert waiting.wait(SOON) == 3


def test_that_it_was_killed_is_a_failure_and_is_said() -> None:
    with started("helper.kill(); os.kill(os.getpid(), signal.SIGKILL)") as waiting:
        assert waiting.stdout is not None
        waiting.stdout.readline()
        said = "rcdeploy: the process that runs the network was killed (SIGKILL) before everything was ready\n"
        assert waiting.stdout.read() == said
        assert waiting.wait(SOON) == 1


def test_that_it_was_interrupted_needs_no_saying() -> None:
    """Python ends so when Ctrl-C comes while it is about to end."""
    end = "helper.kill(); signal.signal(signal.SIGINT, signal.SIG_DFL); signal.raise_signal(signal.SIGINT)"
    with started(end) as waiting:
        assert waiting.stdout is not None
        waiting.stdout.readline()
        assert waiting.stdout.read() == ""
        assert waiting.wait(SOON) == 130


def test_it_goes_on_and_neither_it_nor_what_it_started_holds_the_output(tmp_path: Path) -> None:
    complaints = tmp_path / "folder" / "complaints"
    with started(f"parent.leave(Path({str(complaints)!r})); print('more'); print('oh', file=sys.stderr)") as waiting:
        assert waiting.stdout is not None
        _, worker, helper, session = waiting.stdout.readline().split()
        assert waiting.stdout.read() == "", "it can be read to its end, though both go on"
        assert waiting.wait(SOON) == 0
        try:
            assert session == worker
            assert alive(int(worker))
            assert alive(int(helper))
            wait_until(lambda: complaints.read_text() == "oh\n")
        finally:
            os.kill(int(worker), signal.SIGTERM)
        wait_until(lambda: not alive(int(worker)))
        wait_until(lambda: not alive(int(helper)))


def test_it_continues_when_its_waiting_parent_is_killed(tmp_path: Path) -> None:
    with started(
        f"sys.stdout.flush(); signal.sigwait([signal.SIGUSR1]); parent.leave(Path({str(tmp_path / 'x')!r}))"
    ) as waiting:
        assert waiting.stdout is not None
        worker = int(waiting.stdout.readline().split()[1])
        waiting.kill()
        waiting.wait()
        os.kill(worker, signal.SIGUSR1)
        assert waiting.stdout.read() == ""
        assert alive(worker)
        os.kill(worker, signal.SIGTERM)
        wait_until(lambda: not alive(worker))
