"""The protocol between a process and its launcher.

A process reports its status by datagrams to `$NOTIFY_SOCKET`, as systemd's sd_notify(3) defines them.
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
"""Separates the components of one process on its command line."""

ENDED = "X_ROBOCOMP_ENDED="
"""The name of a component that has ended while others of its process go on."""


CONTRACT = "X_ROBOCOMP_CONTRACT="
"""A component, the number of its operations, and some of them as `name=fingerprint`."""

_LONGEST = 4096
"""Maximum length of a datagram. systemd ignores longer ones."""


LIFE = "X_ROBOCOMP_LIFE="
"""The status of a component, sent when it has changed: see `introspection.life`."""


CALLS = "X_ROBOCOMP_CALLS="
"""Operations that the process answers per second, and the duration of the slowest in milliseconds."""


def watchdog_s() -> float:
    """The watchdog interval that the launcher asks for, in seconds; 0 without a watchdog."""
    interval_us, pid = os.environ.get("WATCHDOG_USEC", ""), os.environ.get("WATCHDOG_PID", "")
    if "NOTIFY_SOCKET" not in os.environ or (pid and pid != str(os.getpid())):
        return 0.0
    try:
        seconds = float(interval_us) / 1e6
    except ValueError:
        return 0.0
    return seconds if seconds > 0 and math.isfinite(seconds) else 0.0


READY_FILE = "ROBOCOMP_READY_FILE"
"""Variable with the name of a file that exists while the process is ready: containers check it, without a socket."""


def is_launched() -> bool:
    """Whether rcdeploy, systemd or a container has started this process, and not a user."""
    return "NOTIFY_SOCKET" in os.environ or READY_FILE in os.environ


_SEND_TIMEOUT, _RETRY_TIMEOUT = 1.0, 60.0
"""Seconds to wait for the launcher to receive a message: in the calling thread, and then in the background."""


def notify(*lines: str) -> None:
    """Send `READY=1` and the like. Does nothing if the launcher has asked for no messages."""
    text = "\n".join(lines)
    if path := os.environ.get(READY_FILE):
        _update_ready_file(Path(path), text.split("\n"))
    address = os.environ.get("NOTIFY_SOCKET")
    if not address or not hasattr(socket, "AF_UNIX"):
        return
    left = _send(address, _datagrams(text.split("\n")), _SEND_TIMEOUT)
    if any(each.startswith(_ONCE) for each in left):
        # These are sent only once, so send them in the background. A daemon, because it must not delay the end.
        start_thread(
            threading.Thread(target=_send, args=(address, left, _RETRY_TIMEOUT), name="notifying", daemon=True)
        )


_ONCE = ("READY=1", CONTRACT)


def contract(instance: str, operations: Mapping[str, str]) -> Iterator[str]:
    """The contracts of a component (`Component.fingerprints`), as lines that each fit in a datagram."""
    begin = line = f"{CONTRACT}{instance} {len(operations)}"
    for name, fingerprint in operations.items():
        item = f" {name}={fingerprint}"
        if line != begin and len(line) + len(item) > _LONGEST:
            yield line
            line = begin
        line += item
    if operations:
        yield line


def _datagrams(lines: Iterable[str]) -> list[str]:
    """Join lines into as few datagrams as possible."""
    found: list[str] = []
    for line in lines:
        if found and len(found[-1]) + 1 + len(line) <= _LONGEST:
            found[-1] += f"\n{line}"
        else:
            found.append(line)
    return found


def _send(address: str, datagrams: list[str], within: float) -> list[str]:
    """Send datagrams in order, waiting for each up to `within` seconds. Returns those that could not be sent."""
    return next((datagrams[at:] for at, each in enumerate(datagrams) if not _is_sent(address, each, within)), [])


def _is_sent(address: str, text: str, within: float) -> bool:
    """Send one datagram. True if it was sent, or if the launcher is gone, so that trying again makes no sense."""
    try:
        channel = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    except OSError:  # no descriptor is free just now
        return False
    with channel:
        channel.settimeout(within)
        try:
            # Connected, because only then does `send` wait while the receiver's queue is full.
            channel.connect("\0" + address[1:] if address[0] == "@" else address)
            channel.send(text.encode())
        except TimeoutError:
            return False
        except OSError:
            return True
    return True


def _update_ready_file(path: Path, lines: list[str]) -> None:
    with contextlib.suppress(OSError):  # a component also works without its launcher
        if "READY=1" in lines:
            path.touch()
        elif "STOPPING=1" in lines:
            path.unlink(missing_ok=True)
