"""What a process and whoever launched it agree on.

It tells how it is by datagrams to `$NOTIFY_SOCKET`, as systemd's sd_notify(3) defines them.
"""

from __future__ import annotations

import contextlib
import math
import os
import socket
import threading
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from ..threads import start_thread

BETWEEN = "+"
"""What stands between the components of one process on its command line."""

ENDED = "X_ROBOCOMP_ENDED="
"""What a process says of a component of its own that has ended, while others go on."""


CONTRACT = "X_ROBOCOMP_CONTRACT="
"""A component, how many operations it has in all, and some of them as `name=fingerprint`."""

_LONGEST = 4096
"""Characters of a datagram. systemd reads none that are longer."""


LIFE = "X_ROBOCOMP_LIFE="
"""How a component of a process is, when that has changed: what `introspection.life` says."""


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
    left = _send(address, _datagrams(told.split("\n")), _SOON)
    if any(each.startswith(_ONCE) for each in left):
        # These are sent only once. At the end there is no need to wait for it: the process is ending anyway.
        start_thread(threading.Thread(target=_send, args=(address, left, _LATE), name="notifying", daemon=True))


_ONCE = ("READY=1", CONTRACT)


def contract(instance: str, operations: Mapping[str, str]) -> Iterator[str]:
    """What a component says of its contracts (`Component.fingerprints`): lines that have room in a datagram each."""
    begin = line = f"{CONTRACT}{instance} {len(operations)}"
    for name, fingerprint in operations.items():
        told = f" {name}={fingerprint}"
        if line != begin and len(line) + len(told) > _LONGEST:
            yield line
            line = begin
        line += told
    if operations:
        yield line


def _datagrams(lines: Iterable[str]) -> list[str]:
    """Lines together, as far as a datagram has room for them."""
    found: list[str] = []
    for line in lines:
        if found and len(found[-1]) + 1 + len(line) <= _LONGEST:
            found[-1] += f"\n{line}"
        else:
            found.append(line)
    return found


def _send(address: str, datagrams: list[str], within: float) -> list[str]:
    """Send each of them within some seconds. Returns those that were not taken in time, and all behind them."""
    return next((datagrams[at:] for at, each in enumerate(datagrams) if not _taken(address, each, within)), [])


def _taken(address: str, told: str, within: float) -> bool:
    """Whether this was taken, or nobody is there to take it; we end when we are told to."""
    try:
        channel = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    except OSError:  # no descriptor is free just now
        return False
    with channel:
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
