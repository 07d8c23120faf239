"""Ice keeps the contract."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from robocomp_py.testing.actions import ActionsConformance
from robocomp_py.testing.callers import CallersConformance
from robocomp_py.testing.conformance import TransportConformance
from robocomp_py.testing.instances import InstancesConformance
from robocomp_py.transports.base import Transport

from .icestorm import icestorm, open_ice

pytestmark = pytest.mark.tool


@pytest.fixture(autouse=True, scope="module")
def storm() -> Iterator[str]:
    with icestorm() as proxy:
        yield proxy


class TestIce(TransportConformance):
    def open_transport(self) -> Transport:
        return open_ice()


class TestActionsOverIce(ActionsConformance):
    def open_transport(self, owner: str = "test") -> Transport:
        return open_ice()


class TestCallersOverIce(CallersConformance):
    def open_transport(self, owner: str = "test") -> Transport:
        return open_ice(owner)


class TestNamedInstancesOverIce(InstancesConformance):
    def open_transport(self, owner: str = "test") -> Transport:
        return open_ice()
