"""JSON that strangers send is short enough not to become large, whatever it holds."""

from __future__ import annotations

import json
import tracemalloc
from collections.abc import Callable

import pytest

from robocomp_py.deploy.control import LINE, read_request
from robocomp_py.errors import DecodeError, DeploymentError
from robocomp_py.transports.keyfiles import Rights
from robocomp_py.transports.members import Member
from robocomp_py.transports.zeromq import remote

ENTRY = json.dumps({"role": "calls", "channel": "c", "fingerprint": 1, "text": ""})
MIB = 2**20


def record(data: bytes) -> object:
    """What a component takes for the introduction of a member on another host."""
    return remote.read_record(data, "tcp", at="", rights=Rights())


def filled(size: int, begin: str, repeated: str, end: str) -> bytes:
    """JSON of at most so many octets."""
    return (begin + ",".join([repeated] * ((size - 200) // (len(repeated) + 1))) + end).encode()


DOORS = [(record, remote._LONGEST, 40 * MIB), (read_request, LINE, 4 * MIB)]
BOMBS = [("[", "[]", "]"), ("[", "{}", "]"), ('{"id":"x","owner":"o","pid":1,"entries":[', ENTRY, "]}")]


@pytest.mark.parametrize(("door", "longest", "most"), DOORS, ids=["introduction", "control socket"])
@pytest.mark.parametrize("bomb", [*BOMBS, ("", "[" * 1000, ""), ("", "1" * 4000, "")], ids=range(5))
def test_what_is_received_takes_little_memory(
    door: Callable[[bytes], object], longest: int, most: int, bomb: tuple[str, str, str]
) -> None:
    tracemalloc.start()
    try:
        told = door(filled(longest, *bomb))
        assert isinstance(told, Member)
    except (DecodeError, DeploymentError):
        pass  # it is refused, as most of these are
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < most
