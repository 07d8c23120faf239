"""Several hosts within one process, with and without keys."""

from __future__ import annotations

import contextlib
import socket as plain
import threading
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.contract.interface import Pattern, Verb
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON
from robocomp_py.transports.base import Channel, Reply, Status, Transport, TransportConfig, TypeRef
from robocomp_py.transports.zeromq.transport import ZeroMQTransport
from tests.freeports import free_port

from ...deploy.security_network import network, way
from .outsider import Outsider

DIVIDE = Channel("robot/camera/Everything/divide", Pattern.QUERY, TypeRef("", e.divide.fingerprint, e.divide.text))
MOVE = Channel("robot/camera/Everything/move", Pattern.COMMAND, TypeRef("", 7, "move"))
NEWS = Channel("robot/camera/Everything/news", Pattern.PUBLISH, TypeRef("", e.news.fingerprint, e.news.text))
GRAPH = network(
    way("viewer", "camera", "divide"),
    way("viewer", "camera", "move"),
    way("viewer", "camera", "news", Verb.SUBSCRIBES),
    way("other", "camera", "count"),
    names=("camera", "viewer", "other", "stranger"),
)
"""`viewer` may do all of the above, `other` something else, and `stranger` nothing."""


class Hosts:
    """Transports of one process as if each ran on a host of its own, with its own run-time folder."""

    def __init__(self, folder: Path, keys: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self._folder, self.keys, self._monkeypatch = folder, keys, monkeypatch
        self.outsider = Outsider()
        self.address = f"tcp://127.0.0.1:{free_port()}"
        self._open: list[ZeroMQTransport] = []

    def open(self, name: str, *, with_keys: bool = True, **options: Any) -> ZeroMQTransport:
        runtime = self._folder / f"h{len(self._open)}"
        runtime.mkdir(mode=0o700)
        self._monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(runtime))
        given = options | ({"keys": str(self.keys / name)} if with_keys else {})
        opened = ZeroMQTransport(TransportConfig(given, name))
        self._open.append(opened)
        return opened

    def camera(self, **options: Any) -> ZeroMQTransport:
        return self.open("camera", **({"bind": self.address} | options))

    def user(self, name: str, address: str = "", **options: Any) -> ZeroMQTransport:
        return self.open(name, connect={"camera": address or self.address}, **options)

    def close(self) -> None:
        for each in reversed(self._open):
            each.close()
        self.outsider.close()


def divide(transport: Transport, executed: list[object] | None = None) -> Any:
    decode, encode = transport.codec.decoder(e.divide.request), transport.codec.encoder(e.divide.response)

    def service(payload: Any, _: float) -> Reply:
        dividend, divisor = decode(payload)
        if executed is not None:
            executed.append((dividend, divisor))
        return Reply(Status.OK, encode(divmod(dividend, divisor)))

    return transport.server(DIVIDE, service)


def quotient(transport: Transport, *numbers: int) -> object:
    caller = transport.caller(DIVIDE)
    try:
        assert caller.wait_peer(SOON)
        payload = transport.codec.encoder(e.divide.request)(numbers)
        return transport.codec.decoder(e.divide.response)(caller.ask(payload, SOON).payload)
    finally:
        caller.close()


def news(transport: ZeroMQTransport, *values: object) -> Any:
    return transport.codec.encoder(e.news.request)(values)


class Tap:
    """Passes on what two sides say to each other, and keeps what the one that connects has said."""

    def __init__(self, port: int) -> None:
        self._listening = plain.create_server(("127.0.0.1", 0))
        self.address = f"tcp://127.0.0.1:{self._listening.getsockname()[1]}"
        self.said: list[bytearray] = []
        self._port, self._ends = port, [self._listening]
        self._threads = [threading.Thread(target=self._accept, name="tap")]
        self._threads[0].start()

    def close(self) -> None:
        for end in list(self._ends):
            with contextlib.suppress(OSError):
                end.shutdown(plain.SHUT_RDWR)
            end.close()
        for thread in list(self._threads):
            thread.join()
        for end in self._ends:
            end.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._listening.accept()
                far = plain.create_connection(("127.0.0.1", self._port))
                self._ends += [near, far]
                self.said.append(bytearray())
                for arguments in ((near, far, self.said[-1]), (far, near, None)):
                    self._threads.append(threading.Thread(target=self._pass_on, args=arguments, name="tap"))
                    self._threads[-1].start()

    def _pass_on(self, source: plain.socket, sink: plain.socket, kept: bytearray | None) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                if kept is not None:
                    kept += data
                sink.sendall(data)
            sink.shutdown(plain.SHUT_WR)
