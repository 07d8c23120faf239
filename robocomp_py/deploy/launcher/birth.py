"""What a new process does to itself before it becomes its program. Standard library only, and ready before a fork."""

from __future__ import annotations

import contextlib
import fcntl
import os
import resource
import signal
from dataclasses import dataclass

from . import cgroups, unsafe

_F_SETSIG = 10

PADDING = "-" * 4096
"""An argument of the fork server: room for the command line that a component shows."""


@dataclass(frozen=True, slots=True)
class Birth:
    """The settings of a new process, which ends with the process `parent`."""

    parent: int
    lifeline: int
    """A pipe's end, opened for this process alone. Its other end closes with launcher and keeper; -1 for none."""
    cgroup: str = ""
    files: tuple[int, int] | None = None
    """The limits of open files as they were before the launcher raised its own."""

    def prepare(self) -> None:
        """Called in the new process: give it a session and a group, and let it end with its launcher."""
        os.setsid()
        unsafe.prctl(unsafe.PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != self.parent:  # it has ended already
            os._exit(1)
        if self.lifeline >= 0:
            self._die_with_lifeline()
        if self.cgroup:
            with contextlib.suppress(OSError):  # it was removed; session and mark identify the process, too
                cgroups.enter(self.cgroup)
        if self.files:
            with contextlib.suppress(ValueError, OSError):
                resource.setrlimit(resource.RLIMIT_NOFILE, self.files)

    def _die_with_lifeline(self) -> None:
        """Let the kernel end this process group when the last of the other ends is closed.

        Nothing is written to the pipe, so closing is its only event; and no code of ours has to run.
        """
        with contextlib.suppress(OSError):
            os.set_inheritable(self.lifeline, True)
            fcntl.fcntl(self.lifeline, fcntl.F_SETOWN, -os.getpid())
            fcntl.fcntl(self.lifeline, _F_SETSIG, signal.SIGKILL)
            fcntl.fcntl(self.lifeline, fcntl.F_SETFL, fcntl.fcntl(self.lifeline, fcntl.F_GETFL) | os.O_ASYNC)


def lifeline_of_its_own(shared: int) -> int:
    """Open a pipe's end once more: the kernel keeps the process to signal for each open file, not each descriptor."""
    try:
        return os.open(f"/proc/self/fd/{shared}", os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:  # no /proc
        return -1


def adopt_orphans(on: bool) -> None:
    """Set whether orphans become children of this process, rather than of the init process."""
    unsafe.prctl(unsafe.PR_SET_CHILD_SUBREAPER, int(on))
