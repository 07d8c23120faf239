"""What the transport does to connections that Zenoh has opened and offers no way to close.

what                   written for                  if the probe fails
shut_down              Linux, eclipse-zenoh 1.10    nothing is shut down, and the caller says what to restart
shut_down_connections  the same                     nothing is shut down, and what was not heard stays so
"""

from __future__ import annotations

import contextlib
import os
import socket
import stat
from collections.abc import Collection, Iterator
from pathlib import Path

_DESCRIPTORS = Path("/proc/self/fd")


def shut_down(locators: Collection[str]) -> int:
    """Shut down the connections of this process to these addresses, in Zenoh's form; returns their number."""
    addresses = {locator.partition("/")[2].partition("?")[0] for locator in locators}
    count = 0
    for each in _sockets():
        with contextlib.suppress(OSError), each:  # not connected, or closed meanwhile
            if _address(each) in addresses:
                each.shutdown(socket.SHUT_RDWR)
                count += 1
    return count


def shut_down_connections(connections: Collection[tuple[int, int]]) -> None:
    """Shut down the TCP connections of this process with these ports: ours, and that of the other side."""
    for each in _sockets():
        with contextlib.suppress(OSError), each:  # not connected, or closed meanwhile
            if _ports(each) in connections:
                each.shutdown(socket.SHUT_RDWR)


def _ports(each: socket.socket) -> tuple[int, int] | None:
    """None for other sockets than connected ones of TCP. Raises OSError."""
    if each.family not in (socket.AF_INET, socket.AF_INET6) or each.type != socket.SOCK_STREAM:
        return None
    return each.getsockname()[1], each.getpeername()[1]


def _sockets() -> Iterator[socket.socket]:
    """Duplicates of all sockets of this process; the caller closes them."""
    for name in os.listdir(_DESCRIPTORS) if _DESCRIPTORS.is_dir() else ():
        with contextlib.suppress(OSError):  # closed meanwhile
            duplicate = os.dup(int(name))
            if stat.S_ISSOCK(os.fstat(duplicate).st_mode):
                yield socket.socket(fileno=duplicate)
            else:
                os.close(duplicate)


def _address(connected: socket.socket) -> str:
    """The address of the other side, as Zenoh writes it. Raises OSError."""
    peer = connected.getpeername()
    if connected.family == socket.AF_UNIX:
        return str(peer)
    host, port = peer[:2]
    return f"[{host}]:{port}" if connected.family == socket.AF_INET6 else f"{host}:{port}"
