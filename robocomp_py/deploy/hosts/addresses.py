"""At which number a host is reached, and this one from there."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Mapping
from ipaddress import ip_address

from ..wiring import addresses_of


def found(hosts: Mapping[str, str]) -> Mapping[str, str]:
    """By name, from addresses as they are written; "" is this host. Raises OSError, naming the address."""
    return addresses_of(hosts, resolve, towards)


def is_here(address: str) -> bool:
    """Whether a number or a name is this machine's. Other names are looked up, which may take a while."""
    if is_own(address):
        return True
    with contextlib.suppress(OSError):
        return is_own(resolve(address))
    return False


def is_own(address: str) -> bool:
    """Whether it is a number of this machine's, or the name that it has itself; nothing is looked up."""
    name = socket.gethostname().lower()
    short = name.partition(".")[0]
    if address.lower().rstrip(".") in (name, short, f"{short}.local"):
        return True
    try:
        number = ip_address(address)
        return number.is_loopback or ip_address(towards(address)) == number
    except (ValueError, OSError):  # another name, or no way there
        return False


def resolve(address: str) -> str:
    """The number of a name; IPv4 is preferred. Raises OSError if it is unknown."""
    try:
        known = socket.getaddrinfo(address, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as exc:
        raise OSError(f"{address} is not known: {getattr(exc, 'strerror', None) or exc}") from exc
    known.sort(key=lambda each: each[0] != socket.AF_INET)
    return str(known[0][4][0])


def towards(address: str) -> str:
    """This machine's number on the route to that one; nothing is sent. Raises OSError without a route."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as asking:
            asking.connect((address, 9))
            return str(asking.getsockname()[0])
    except OSError as exc:
        raise OSError(f"no route to {address}: {exc.strerror}") from exc
