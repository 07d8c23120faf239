"""Ice for tests: transports whose topics go through an IceStorm of the tests' own, on a port that is free."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robocomp_py.transports.base import Transport, TransportConfig, find_transport, hosting
from robocomp_py.transports.iceoptions import IceOptions
from tests.freeports import free_port

if TYPE_CHECKING:
    from robocomp_py.transports.ice.storm import Place

_WHERE = "ROBOCOMP_TEST_STORM"
"""Environment: also the processes that a test starts are to find it."""


@contextmanager
def icestorm() -> Iterator[str]:
    """While this is entered there is one, and `open_ice` uses it: the proxy of its TopicManager."""
    os.environ[_WHERE] = storm = free_storm()
    with hosting("ice", TransportConfig({"storm": storm}, "test")):
        yield storm
    del os.environ[_WHERE]


def free_storm() -> str:
    """Where none is yet."""
    return f"IceStorm/TopicManager:tcp -h 127.0.0.1 -p {free_port()}"


def open_ice(owner: str = "test", **options: Any) -> Transport:
    return find_transport("ice")(TransportConfig({"storm": os.environ.get(_WHERE, ""), **options}, owner))


def place_of(storm: str) -> Place:
    """Where it is, or would be. Looked for when it is needed: collecting tests needs no Ice."""
    from robocomp_py.transports.ice.storm import Place

    return Place.of(IceOptions(storm=storm))


def process_of(storm: str) -> int:
    """The id of the process that has IceStorm."""
    at = storm.split()[-1].encode()
    for process in Path("/proc").iterdir():
        if process.name.isdecimal():
            with suppress(OSError):
                words = (process / "cmdline").read_bytes()
                if words.startswith((b"icebox", b"/")) and b"icebox" in words.split(b"\0")[0] and b"-p " + at in words:
                    return int(process.name)
    raise LookupError(f"nobody runs {storm}")
