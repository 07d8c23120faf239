"""Ports of 127.0.0.1 at which nothing listens, for the tests' own servers."""

from __future__ import annotations

import itertools
import secrets
import socket

_OURS = range(20_000, 32_000)
"""Outside the range for outgoing connections: such a port might be taken before it is used."""


def free_port() -> int:
    [port] = free_ports(1)
    return port


def free_ports(count: int) -> list[int]:
    """So many different ones."""
    free = filter(_is_free, secrets.SystemRandom().sample(_OURS, len(_OURS)))
    return list(itertools.islice(free, count))


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
        return True
