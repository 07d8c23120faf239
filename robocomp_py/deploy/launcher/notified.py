"""The socket that receives a process's notifications, with the sender of each."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
from collections.abc import Callable
from pathlib import Path

from .notes import MAX, Note, read

_CREDENTIALS = struct.Struct("iii")
_AT_ONCE = 16
"""Datagrams that are read in one turn of the event loop."""


class Notified:
    """`take(note, pid)` is called for each datagram, with the id of the process that the kernel says it is from."""

    def __init__(self, path: Path, take: Callable[[Note, int], None]) -> None:
        """Raises OSError."""
        self._path, self.take = path, take
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
            self._socket.bind(str(path))
            path.chmod(0o600)
        except OSError:
            self._socket.close()
            raise
        asyncio.get_running_loop().add_reader(self._socket, self.read)

    def read(self) -> None:
        """Handle all notifications that have arrived."""
        for _ in range(_AT_ONCE):
            try:
                # Descriptors that come along (FDSTORE, BARRIER) are closed by the kernel: there is no room for them.
                told, ancillary, _, _ = self._socket.recvmsg(MAX, socket.CMSG_SPACE(_CREDENTIALS.size))
            except OSError:
                return
            for level, kind, content in ancillary:
                if (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS):
                    self.take(read(told), _CREDENTIALS.unpack(content[: _CREDENTIALS.size])[0])

    def close(self) -> None:
        """May be called twice."""
        if self._socket.fileno() >= 0:
            asyncio.get_running_loop().remove_reader(self._socket)
            self._socket.close()
            with contextlib.suppress(OSError):
                self._path.unlink()
