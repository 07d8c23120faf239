"""Actions over each transport; Ice has its own file, because it needs IceStorm."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from robocomp_py.testing.actions import ActionsConformance
from robocomp_py.transports.base import Transport, TransportConfig, find_transport
from robocomp_py.transports.inproc import InprocTransport
from tests.transports.domains import DOMAIN

_buses = itertools.count()


@pytest.fixture(autouse=True)
def alone(own_runtime_folder: Path) -> None:
    """No test meets the components of another one."""


class TestInproc(ActionsConformance):
    @pytest.fixture(autouse=True)
    def bus(self) -> None:
        self.bus_name = f"actions-{next(_buses)}"

    def open_transport(self, owner: str = "test") -> Transport:
        return InprocTransport(TransportConfig({"bus": self.bus_name}, owner))


class TestShm(ActionsConformance):
    def open_transport(self, owner: str = "test") -> Transport:
        return find_transport("shm")(TransportConfig(owner=owner))


class TestZeroMQ(ActionsConformance):
    def open_transport(self, owner: str = "test") -> Transport:
        return find_transport("zeromq")(TransportConfig(owner=owner))


class TestDDS(ActionsConformance):
    def open_transport(self, owner: str = "test") -> Transport:
        return find_transport("dds")(TransportConfig({"domain": DOMAIN}, owner))


class TestZenoh(ActionsConformance):
    def open_transport(self, owner: str = "test") -> Transport:
        return find_transport("zenoh")(TransportConfig(owner=owner))
