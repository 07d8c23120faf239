"""A transport that is closed lets go of everything, also if one of its links cannot be closed."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from robocomp_py.errors import Closed
from robocomp_py.testing.conformance import blob, command, query
from robocomp_py.testing.patience import wait_until
from robocomp_py.transports.base import TransportConfig, find_transport


class Broken(Exception):
    """What no transport knows."""


def broken() -> None:
    raise Broken


@pytest.mark.parametrize(
    "name", ["inproc", "shm", "zeromq", "dds", "zenoh", pytest.param("ice", marks=pytest.mark.tool)]
)
@pytest.mark.parametrize("part", ["close", "release"])
def test_a_link_that_cannot_be_closed_keeps_nothing_else_open(
    name: str, part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(tmp_path))
    tmp_path.chmod(0o700)
    before = set(threading.enumerate())
    transport = find_transport(name)(TransportConfig())
    first, failing, last = (transport.outlet(command(f"a/b/{each}")) for each in ("first", "failing", "last"))
    caller = transport.caller(query("a/b/called"))
    if part == "release" and not hasattr(failing, "release"):
        part = "close"
    closing: Callable[[], None] = getattr(failing, part)
    setattr(failing, part, broken)
    with pytest.raises(Broken):
        transport.close()
    for outlet in (first, last):
        with pytest.raises(Closed):
            outlet.send(blob(transport, b"x"))
    with pytest.raises(Closed):
        caller.ask(blob(transport, b"x"), 1.0)
    wait_until(lambda: not [each for each in set(threading.enumerate()) - before if not each.daemon])
    closing()  # now it can: nothing of this test is left
