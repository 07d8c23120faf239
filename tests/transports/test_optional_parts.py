"""The optional parts of the contract: found by protocol, and offered by our transports as their classes say."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.contract.interface import Pattern
from robocomp_py.transports import base
from robocomp_py.transports.base import OPTIONAL_PARTS, Channel, TransportConfig, TypeRef, find_transport

TOPIC = Channel("a/b/c", Pattern.PUBLISH, TypeRef("T", 1))


class _Gathers:
    def __init__(self) -> None:
        self.gathered: list[str] = []

    @contextlib.contextmanager
    def gathering(self) -> Iterator[None]:
        self.gathered.append("begin")
        yield
        self.gathered.append("end")


def test_a_transport_that_gathers_learns_where_gathering_begins_and_ends() -> None:
    transport = _Gathers()
    with base.gathering(transport):  # type: ignore[arg-type]  # nothing else of a transport is used
        assert transport.gathered == ["begin"]
    assert transport.gathered == ["begin", "end"]


def test_a_link_without_the_part_counts_as_connected() -> None:
    outlet = _Gathers()
    assert not isinstance(outlet, base.SupportsConnected)
    assert base.wait_connected(outlet, 0.0)  # type: ignore[arg-type]  # nothing else of a link is used


def test_every_optional_part_states_its_provider_and_the_loss_without_it() -> None:
    assert [part.protocol.__name__ for part in OPTIONAL_PARTS] == [
        name for name in vars(base) if name.startswith("Supports")
    ]
    assert all(part.offered_by and part.without for part in OPTIONAL_PARTS)


@pytest.mark.parametrize("name", ["shm", "zeromq", "dds", "zenoh", "inproc"])
def test_a_transport_with_liveliness_tells_its_sources(name: str) -> None:
    factory = find_transport(name)
    assert base.Capability.LIVELINESS in factory.capabilities  # type: ignore[attr-defined]  # of the class
    with contextlib.closing(factory(TransportConfig())) as transport:
        assert isinstance(transport.inlet(TOPIC, lambda payload: None), base.SupportsSources)


def test_the_guide_lists_the_parts_as_the_table_does() -> None:
    guide = (Path(__file__).parents[2] / "docs" / "guides" / "transports.md").read_text()
    rows = [f"| `{part.protocol.__name__}` | {part.offered_by} | {part.without} |" for part in OPTIONAL_PARTS]
    assert "\n".join(rows) in guide
