"""What a process and whoever launched it agree on.

It tells how it is by datagrams to `$NOTIFY_SOCKET`, as systemd's sd_notify(3) defines them.
"""

from __future__ import annotations

import os
import socket

BETWEEN = "+"
"""What stands between the components of one process on its command line."""

ENDED = "X_ROBOCOMP_ENDED="
"""What a process says of a component of its own that has ended, while others go on."""


CALLS = "X_ROBOCOMP_CALLS="
"""How many operations a process answers per second, and how many milliseconds the slowest took, of a short while."""


def notify(*lines: str) -> None:
    """Send `READY=1` and the like. Without a launcher that listens, nothing happens."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address or not hasattr(socket, "AF_UNIX"):
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.settimeout(1.0)
        try:
            channel.sendto("\n".join(lines).encode(), "\0" + address[1:] if address[0] == "@" else address)
        except OSError:
            return  # the launcher has gone; that is its business, and we end when we are told to
