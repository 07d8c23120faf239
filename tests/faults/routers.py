"""A row about the routers of two hosts, between which a relay passes on what they send."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from typing import Self

from tests.freeports import free_port

from .laboratory import Laboratory, until
from .rows import Figure, Result, Row, Run
from .topics import last_heard

_TOPIC = "faults/Conformance/topic"

_APART = 0.13
"""Seconds from a new connection to its reset: a router that has just computed its routes does so again after 0.1 s."""

_CALM = 1.0
"""Seconds until the routers are idle again."""


class _Relay:
    """Takes connections at a port of this machine, and passes on what they send to another port."""

    def __init__(self, target: int) -> None:
        self._target = target
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.connections = 0
        self._is_over = False
        self._open: list[socket.socket] = []
        self._passing: list[threading.Thread] = []
        self._accepting = threading.Thread(target=self._accept, name="relay")
        self._accepting.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over = True
        self._listener.shutdown(socket.SHUT_RDWR)
        self._accepting.join()
        self.reset()
        for each in self._passing:
            each.join()

    def reset(self) -> None:
        """Reset all connections, at both ends."""
        while self._open:
            with contextlib.suppress(OSError):  # it has ended
                each = self._open.pop()
                each.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                each.shutdown(socket.SHUT_RD)  # wakes its thread, which closes it: only that sends the reset

    def _accept(self) -> None:
        with self._listener:
            while True:
                try:
                    client = self._listener.accept()[0]
                except OSError:
                    if self._is_over:
                        return
                    raise
                try:
                    router = socket.create_connection(("127.0.0.1", self._target))
                except ConnectionError:  # nothing listens there yet: the other end tries again
                    client.close()
                    continue
                self._open += [client, router]
                self.connections += 1
                for ends in ((client, router), (router, client)):
                    self._passing.append(threading.Thread(target=_pass_on, args=ends, name="relay of a connection"))
                    self._passing[-1].start()


def _pass_on(source: socket.socket, target: socket.socket) -> None:
    with source, contextlib.suppress(OSError):  # either has ended
        while octets := source.recv(65536):
            target.sendall(octets)


def _reset(run: Run) -> Result:
    """The connection is reset, and once more as soon as it is there again."""
    from robocomp_py.transports.zenoh.session import named_router

    healed = []
    with contextlib.ExitStack() as everything:
        laboratory = everything.enter_context(Laboratory(run.transport, {"connect": "-"}))
        port = free_port()
        relay = everything.enter_context(_Relay(port))
        everything.enter_context(named_router("base", {"listen/endpoints": [f"tcp/127.0.0.1:{port}"]}))
        everything.enter_context(named_router("onboard", {"connect/endpoints": [f"tcp/127.0.0.1:{relay.port}"]}))
        publisher = laboratory.start("p", options={"connect": "here/base"})
        subscriber = laboratory.start("s", options={"connect": "here/onboard"})
        subscriber.subscribe(channel=_TOPIC, depth=1000)
        publisher.publish(channel=_TOPIC, count=10**9, pace=0.01)
        until(lambda: subscriber.written() > 0, 30.0, "the topic is heard")
        for number in range(run.rounds(10, 2)):
            time.sleep(_CALM)
            before = relay.connections
            relay.reset()
            until(lambda before=before: relay.connections > before, 30.0, "the routers connect")
            time.sleep(_APART)
            relay.reset()
            begun, sent = time.monotonic(), publisher.sent()
            until(lambda sent=sent: last_heard(laboratory, subscriber) > sent, 60.0, "it is heard again")
            healed.append(time.monotonic() - begun)
            run.tell(f"{number + 1}: heard again after {healed[-1]:.1f} s")
        publisher.stop(channel=_TOPIC)
        history = laboratory.end()
    return Result([Figure("heard again after", max(healed), "s", 5, timed=True)], run.check(history))


ROWS = [
    Row(
        "reset",
        "connection between the routers of two hosts reset twice, ten times",
        "what the other host publishes is heard again ≤ 5 s",
        ("zenoh",),
        50,
        _reset,
    ),
]
