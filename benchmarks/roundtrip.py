"""A question and its answer, between two processes: through a generated-style proxy, and through the bare library.

Raw means: the same library, settings and socket kinds, the same encoded bytes, encoded and decoded by
the fastest way a user of that library would take, and no header.
"""

from __future__ import annotations

import multiprocessing
import statistics
import tempfile
import time
from collections.abc import Callable
from multiprocessing.synchronize import Event
from typing import Any, NamedTuple

import msgpack
import numpy as np
import zmq

from robocomp_py.contract.component import Port
from robocomp_py.contract.interface import Interface, Operation, Verb
from robocomp_py.contract.types import UINT8, Field, Sequence
from robocomp_py.runtime import ports
from robocomp_py.runtime.monitor import Monitor
from robocomp_py.transports.base import Transport, TransportConfig, find_transport

SIZES = {64: 4000, 1024: 4000, 65536: 2000, 1_000_000: 400, 6_000_000: 100}
ROUNDS = 5

BYTES = (Field("data", Sequence(UINT8)),)
echo: Operation[Any] = Operation("Benchmark::Echo", "echo", BYTES, (Field("ret", Sequence(UINT8)),))
ECHO = Interface("Benchmark::Echo", (echo,))

Ask = Callable[[Any], object]


class Times(NamedTuple):
    """Of one way at one size, in µs."""

    p50: float
    p99: float


def measure(ask: Ask, size: int, count: int) -> Times:
    data = np.zeros(size, np.uint8)
    for _ in range(max(20, count // 10)):
        ask(data)
    taken = []
    for _ in range(count):
        begun = time.perf_counter()
        ask(data)
        taken.append(time.perf_counter() - begun)
    taken.sort()
    return Times(taken[count // 2] * 1e6, taken[int(count * 0.99)] * 1e6)


# Ours.


class Echo:
    def Echo_echo(self, data: Any) -> Any:
        return data


def _route(transport: Transport) -> ports.Router:
    return lambda port, operation: ports.Route(transport, "", f"echo/Echo/{operation.name}", port.qos, 5.0)


def serve(name: str, ready: Event, stop: Event) -> None:
    transport, monitor = find_transport(name)(TransportConfig()), Monitor()
    monitor.open()
    links = ports.bind_handlers(Port(Verb.IMPLEMENTS, ECHO), Echo(), _route(transport), monitor)
    ready.set()
    stop.wait()
    ports.close_all(links)
    monitor.close()
    transport.close()


class Framework:
    """Our proxy, with a server in another process (in this one, for a transport that reaches no other)."""

    def __init__(self, name: str) -> None:
        self._ready, self._stop = multiprocessing.Event(), multiprocessing.Event()
        kind: Any = multiprocessing.Process
        if name == "inproc":
            import threading

            kind = threading.Thread
        self._server = kind(target=serve, args=(name, self._ready, self._stop))
        self._server.start()
        self._ready.wait()
        self._transport, self._monitor = find_transport(name)(TransportConfig()), Monitor()
        self._monitor.open()
        port = Port(Verb.REQUIRES, ECHO, proxy=ports.Proxy)
        self._proxy, self._links = ports.bind_proxy(port, _route(self._transport), self._monitor)
        assert self._links[0].wait_peer(10)

    def ask(self, data: Any) -> object:
        return self._proxy._ask(echo, (data,), None)

    def close(self) -> None:
        ports.close_all(self._links)
        self._transport.close()
        self._monitor.close()
        self._stop.set()
        self._server.join()


# Raw.


def _zeromq_server(address: str, ready: Event) -> None:
    with zmq.Context() as context, context.socket(zmq.ROUTER) as socket:
        socket.bind(address)
        ready.set()
        while True:
            identity, *parts = socket.recv_multipart()
            if parts == [b"stop"]:
                return
            (data,) = _unpack(parts)
            socket.send_multipart([identity, *_pack(data)])


def _pack(data: Any) -> list[Any]:
    """Small arrays in the message, large ones beside it."""
    return [msgpack.packb([data.tobytes()])] if data.nbytes < 65536 else [msgpack.packb([None]), data.data]


def _unpack(parts: list[Any]) -> tuple[Any]:
    (data,) = msgpack.unpackb(parts[0])
    return (np.frombuffer(parts[1] if data is None else data, np.uint8),)


class RawZeroMQ:
    def __init__(self, name: str) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="rc-bench-")
        address, ready = f"ipc://{self._folder.name}/raw", multiprocessing.Event()
        self._server = multiprocessing.Process(target=_zeromq_server, args=(address, ready))
        self._server.start()
        ready.wait()
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.DEALER)
        self._socket.setsockopt(zmq.RCVTIMEO, 5000)
        self._socket.connect(address)

    def ask(self, data: Any) -> object:
        self._socket.send_multipart(_pack(data))
        return _unpack(self._socket.recv_multipart())[0]

    def close(self) -> None:
        self._socket.send(b"stop")
        self._server.join()
        self._socket.close()
        self._context.term()
        self._folder.cleanup()


def _zenoh_server(endpoint: str, ready: Event, stop: Event) -> None:
    """As with ours, the serving process runs the router as well."""
    from robocomp_py.transports.zenoh_session import open_client, open_router

    router, session = open_router(endpoint), open_client(endpoint)

    def answer(query: Any) -> None:
        query.reply(query.key_expr, _to_cdr(_of_cdr(query.payload.to_bytes())))

    session.declare_queryable("raw/echo", answer, complete=True)
    ready.set()
    stop.wait()
    session.close()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it
    router.close()  # type: ignore[no-untyped-call]


def _to_cdr(data: Any) -> bytes:
    return b"".join((b"\0\1\0\0", data.size.to_bytes(4, "little"), data.data))


def _of_cdr(payload: bytes) -> Any:
    return np.frombuffer(payload, np.uint8, offset=8)


class RawZenoh:
    def __init__(self, name: str) -> None:
        import zenoh

        from robocomp_py.transports.zenoh_session import open_client

        self._folder = tempfile.TemporaryDirectory(prefix="rc-bench-")
        endpoint = f"unixsock-stream/{self._folder.name}/raw"
        spawn = multiprocessing.get_context("spawn")  # Zenoh's threads, once used, do not survive a fork
        ready, self._stop = spawn.Event(), spawn.Event()
        self._server = spawn.Process(target=_zenoh_server, args=(endpoint, ready, self._stop))
        self._server.start()
        ready.wait()
        self._session = open_client(endpoint)
        self._querier = self._session.declare_querier(
            "raw/echo", consolidation=zenoh.ConsolidationMode.NONE, timeout=5.0, express=True
        )
        while not self._querier.matching_status.matching:  # type: ignore[attr-defined]  # its stub says bool
            time.sleep(0.01)

    def ask(self, data: Any) -> object:
        sample = self._querier.get(payload=_to_cdr(data)).recv().ok
        assert sample is not None
        return _of_cdr(sample.payload.to_bytes())

    def close(self) -> None:
        self._stop.set()
        self._server.join()
        self._session.close()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it
        self._folder.cleanup()


RAW: dict[str, Any] = {"zeromq": RawZeroMQ, "zenoh": RawZenoh}


def run(names: list[str]) -> None:
    print(f"{'':>10} {'bytes':>9} {'ours p50':>10} {'p99':>9} {'raw p50':>10} {'p99':>9} {'ratio':>7} {'extra':>9}")
    for name in names:
        ours, raw = Framework(name), RAW[name](name) if name in RAW else None
        for size, count in SIZES.items():
            _row(name, size, ours, raw, count // ROUNDS)
        ours.close()
        if raw:
            raw.close()


def _row(name: str, size: int, ours: Any, raw: Any, count: int) -> None:
    pairs = [(measure(ours.ask, size, count), measure(raw.ask, size, count) if raw else None) for _ in range(ROUNDS)]
    mine = Times(*(statistics.median(column) for column in zip(*(pair[0] for pair in pairs), strict=True)))
    if not raw:
        print(f"{name:>10} {size:>9} {mine.p50:>7.1f} µs {mine.p99:>6.0f} µs")
        return
    its = Times(*(statistics.median(column) for column in zip(*(pair[1] for pair in pairs if pair[1]), strict=True)))
    ratios = [one.p50 / other.p50 for one, other in pairs if other]
    print(
        f"{name:>10} {size:>9} {mine.p50:>7.1f} µs {mine.p99:>6.0f} µs {its.p50:>7.1f} µs {its.p99:>6.0f} µs "
        f"{statistics.median(ratios):>7.2f} {mine.p50 - its.p50:>6.1f} µs"
    )
