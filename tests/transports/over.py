"""How suites with components open each transport; Ice has its own files, because it needs IceStorm."""

from __future__ import annotations

import uuid

import pytest

from robocomp_py.transports.base import Transport, TransportConfig, find_transport
from robocomp_py.transports.inproc import InprocTransport

from .dds.domains import DOMAIN


class OverInproc:
    @pytest.fixture(autouse=True)
    def bus(self) -> None:
        self.bus_name = uuid.uuid4().hex

    def open_transport(self, owner: str = "test") -> Transport:
        return InprocTransport(TransportConfig({"bus": self.bus_name}, owner))


class OverShm:
    def open_transport(self, owner: str = "test") -> Transport:
        return find_transport("shm")(TransportConfig(owner=owner))


class OverZeroMQ:
    def open_transport(self, owner: str = "test") -> Transport:
        return find_transport("zeromq")(TransportConfig(owner=owner))


class OverDDS:
    def open_transport(self, owner: str = "test") -> Transport:
        return find_transport("dds")(TransportConfig({"domain": DOMAIN}, owner))


class OverZenoh:
    def open_transport(self, owner: str = "test") -> Transport:
        return find_transport("zenoh")(TransportConfig(owner=owner))
