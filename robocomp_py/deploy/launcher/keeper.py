"""Cleans up after a launcher that was killed. Run as a program: `… keeper NETWORK FOLDER LIFELINE`.

It reads lines from its launcher: first the launch, `=MARK BOOT CGROUP`; then `+PID STARTED` for a process that was
started, `-PID` for one that has ended. When the pipe closes, whatever is left of them and of what they started gets
SIGTERM and, after a grace, SIGKILL; then what they and the launch left in the run-time folder is removed. As long as
it lives it holds the lifeline: without it and without the launcher, the kernel ends them at once.
"""

from __future__ import annotations

import contextlib
import signal
import sys
from pathlib import Path

from ...errors import DeploymentError
from ..place import Place
from .clearing import clear_up
from .leftovers import Leftovers


def main() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends when its launcher does
    network, folder = sys.argv[1:3]
    left = Leftovers()
    for line in sys.stdin:
        take(left, line.rstrip("\n"))
    if not left.launch:
        return  # the launcher ended before it could start anything
    left.end()
    place = Place(network, Path(folder).parent)
    with contextlib.suppress(DeploymentError):  # the network has been started again already
        place.clear()
    left.until_waited_for()
    clear_up()


def take(left: Leftovers, line: str) -> None:
    """The lines of the launcher."""
    kind, rest = line[:1], line[1:]
    if kind == "=":
        left.launch, left.boot, left.cgroup = rest.split(" ", 2)
    elif kind == "+":
        pid, started = rest.split()
        left.processes[int(pid)] = int(started)
    elif kind == "-":
        left.processes.pop(int(rest), None)


if __name__ == "__main__":
    main()
