"""At which number a host is reached, and this one from there."""

from __future__ import annotations

import socket
from collections.abc import Mapping

from ..wiring import addresses_of


def found(hosts: Mapping[str, str]) -> Mapping[str, str]:
    """By name, from addresses as they are written; "" is this host. Raises OSError, naming the address."""
    return addresses_of(hosts, resolve, towards)


def resolve(address: str) -> str:
    """The number of a name; IPv4 is preferred. Raises OSError if nobody knows it."""
    try:
        known = socket.getaddrinfo(address, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as exc:
        raise OSError(f"{address} is not known: {getattr(exc, 'strerror', None) or exc}") from exc
    known.sort(key=lambda each: each[0] != socket.AF_INET)
    return str(known[0][4][0])


def towards(address: str) -> str:
    """Our own number on the way to that one; nothing is sent. Raises OSError if there is no way."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as asking:
            asking.connect((address, 9))
            return str(asking.getsockname()[0])
    except OSError as exc:
        raise OSError(f"there is no way to {address}: {exc.strerror}") from exc
