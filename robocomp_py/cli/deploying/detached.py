"""Runs a network independently of the terminal from which it was started.

The process at the terminal forks before it imports anything that could start threads. Its child, in a new session,
runs the network; the parent only waits until everything is ready. Processes that the child starts inherit neither the
terminal nor a pipe that is read to its end: only the child's own `sys.stdout` and `sys.stderr` lead there, until it
releases them.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import signal
import sys
from collections.abc import Callable
from pathlib import Path

from ..common import INTERRUPTED, complain

_GOES_ON = b"+"
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_LISTEN_S = 0.5
"""Seconds of one wait: a signal that arrives just before an endless wait would not end it."""


class Parent:
    """The process that waits at the terminal, as seen by its child."""

    def __init__(self, pipe: int) -> None:
        self._pipe = pipe

    @property
    def waits(self) -> bool:
        """Whether it has not been released."""
        return self._pipe >= 0

    def leave(self, complaints: Path) -> None:
        """Release the parent and the terminal; later messages of Python itself go into a file."""
        with contextlib.suppress(OSError):
            sys.stdout.flush()
            sys.stderr.flush()
        nowhere = os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
        try:
            complaints.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            file = os.open(complaints, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)
        except OSError:  # a full disk is no reason to stop
            file = os.dup(nowhere)
        for number, target in ((sys.stdout.fileno(), nowhere), (sys.stderr.fileno(), file)):
            os.dup2(target, number, inheritable=False)
        os.dup2(file, 2)
        os.close(file)
        os.close(nowhere)
        with contextlib.suppress(OSError):  # it has gone already
            os.write(self._pipe, _GOES_ON)
        os.close(self._pipe)
        self._pipe = -1


def detached(work: Callable[[Parent], int]) -> int:
    """Run the work in a child. Returns 0 once the child is detached, or the exit code if it ended before.

    Ctrl-C, and any other end of this process before that, ends the child, too.
    """
    reading, writing = os.pipe()
    signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)  # until there is a child to receive them
    child = os.fork()
    if child == 0:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)
        os.close(reading)
        os.setsid()
        _keep_to_ourselves()
        return work(Parent(writing))
    os.close(writing)
    try:
        return _wait(child, reading)
    finally:
        os.close(reading)


def _keep_to_ourselves() -> None:
    """Keep the standard streams private; processes started from here inherit /dev/null."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        stream.flush()
        copy = fcntl.fcntl(stream.fileno(), fcntl.F_DUPFD_CLOEXEC, 3)
        setattr(sys, name, os.fdopen(copy, "w", buffering=1, encoding=stream.encoding, errors=stream.errors))
    nowhere = os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
    for number in range(3):
        os.dup2(nowhere, number)
    os.close(nowhere)


def _wait(child: int, reading: int) -> int:
    while True:
        try:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)
            while not select.select([reading], [], [], _LISTEN_S)[0]:
                pass
            if os.read(reading, 1) == _GOES_ON:
                return 0
            return _code(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
        except KeyboardInterrupt:
            os.kill(child, signal.SIGINT)
        except SystemExit as exc:  # a signal came: see `common.command`
            os.kill(child, signal.SIGTERM)
            os.waitpid(child, 0)
            raise exc


def _code(code: int) -> int:
    """The exit code for a child that ended early. A killed child could print nothing, so its end is reported here."""
    if code >= 0:
        return code
    if code == -signal.SIGINT:  # when it was about to end anyway
        return INTERRUPTED
    return complain(
        f"rcdeploy: the process that runs the network was killed ({_name(-code)}) before everything was ready"
    )


def _name(number: int) -> str:
    with contextlib.suppress(ValueError):
        return signal.Signals(number).name
    return f"signal {number}"
