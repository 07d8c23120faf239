"""What a process and whoever launched it agree on.

It tells how it is by datagrams to `$NOTIFY_SOCKET`, as systemd's sd_notify(3) defines them.
"""

from __future__ import annotations

import contextlib
import math
import os
import socket
import threading
from pathlib import Path

BETWEEN = "+"
"""What stands between the components of one process on its command line."""

ENDED = "X_ROBOCOMP_ENDED="
"""What a process says of a component of its own that has ended, while others go on."""


CALLS = "X_ROBOCOMP_CALLS="
"""How many operations a process answers per second, and how many milliseconds the slowest took, of a short while."""


def watchdog_s() -> float:
    """Within how many seconds whoever launched us wants to hear that we live; 0 if that is nobody's wish."""
    told, whose = os.environ.get("WATCHDOG_USEC", ""), os.environ.get("WATCHDOG_PID", "")
    if "NOTIFY_SOCKET" not in os.environ or (whose and whose != str(os.getpid())):
        return 0.0
    try:
        seconds = float(told) / 1e6
    except ValueError:
        return 0.0
    return seconds if seconds > 0 and math.isfinite(seconds) else 0.0


READY_FILE = "ROBOCOMP_READY_FILE"
"""Names a file that is there while a process is ready: launchers of containers look, and do not listen."""


_SOON, _LATE = 1.0, 60.0
"""Seconds in which a launcher takes what it is told; and in which it does so that was stopped, and goes on."""


def notify(*lines: str) -> None:
    """Send `READY=1` and the like. Without a launcher that listens or looks, nothing happens."""
    told = "\n".join(lines)
    if path := os.environ.get(READY_FILE):
        _show(Path(path), told.split("\n"))
    address = os.environ.get("NOTIFY_SOCKET")
    if not address or not hasattr(socket, "AF_UNIX"):
        return
    if not _taken(address, told, _SOON) and "READY=1" in told.split("\n"):
        # That is said only once. Nobody need wait for it in the end: of one who ends, it is no news any more.
        threading.Thread(target=_taken, args=(address, told, _LATE), name="notifying", daemon=True).start()


def _taken(address: str, told: str, within: float) -> bool:
    """Whether this was taken, or nobody is there to take it; we end when we are told to."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.settimeout(within)
        try:
            # Connected: else it could not be waited for until a launcher that is stopped takes it, only tried for.
            channel.connect("\0" + address[1:] if address[0] == "@" else address)
            channel.send(told.encode())
        except TimeoutError:
            return False
        except OSError:
            return True
    return True


def _show(path: Path, lines: list[str]) -> None:
    with contextlib.suppress(OSError):  # as without a launcher
        if "READY=1" in lines:
            path.touch()
        elif "STOPPING=1" in lines:
            path.unlink(missing_ok=True)
