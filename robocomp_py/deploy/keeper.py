"""Cleans up behind a deployer that was killed. Run as a script, with the standard library only.

It reads lines from the deployer: `+ID` for a process group that was started, `-ID` for one that
has ended. When the pipe closes, whatever groups are left get SIGTERM and, after a grace, SIGKILL; then the deployer's
folder is removed, which is its argument.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
import time

GRACE = 3.0


def main() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends when its deployer does
    groups: set[int] = set()
    for line in sys.stdin:
        group = int(line[1:])
        (groups.add if line[0] == "+" else groups.discard)(group)
    groups = {group for group in groups if send(group, signal.SIGTERM)}
    end = time.monotonic() + GRACE
    while groups and time.monotonic() < end:
        time.sleep(0.05)
        groups = {group for group in groups if send(group, 0)}
    for group in groups:
        send(group, signal.SIGKILL)
    shutil.rmtree(sys.argv[1], ignore_errors=True)


def send(group: int, number: int) -> bool:
    """Whether there was somebody to send it to."""
    try:
        os.killpg(group, number)
    except (ProcessLookupError, PermissionError):
        return False
    return True


if __name__ == "__main__":
    main()
