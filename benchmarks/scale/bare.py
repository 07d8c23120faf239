"""The ends of the bare libraries, as in `raw_zeromq` and its siblings, but many of them.

With cyclonedds and iceoryx2, replies to many clients would need a protocol of their own, so there are no clients; and
iceoryx2 has no subscribers here, since each would need a listener and a thread that notifies it.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

from ..parties import PATIENCE, TAKES, Act, Array, Hear, Place

IDLE = ("zeromq", "dds", "zenoh", "shm")
CLIENTS = ("zeromq", "zenoh")
TOPICS = ("zeromq", "dds", "zenoh")

_SLICE_MS = 100

_THREADS = 8
"""Those of a pool."""


@contextlib.contextmanager
def publications(middleware: str, place: Place, number: int) -> Iterator[list[Act]]:
    with contextlib.ExitStack() as opened:
        yield _PUBLISHERS[middleware](opened, place, number)


@contextlib.contextmanager
def subscriptions(middleware: str, place: Place, hears: list[Hear]) -> Iterator[None]:
    with contextlib.ExitStack() as opened:
        _SUBSCRIBERS[middleware](opened, place, hears)
        yield


@contextlib.contextmanager
def server(middleware: str, place: Place) -> Iterator[None]:
    with contextlib.ExitStack() as opened:
        _SERVERS[middleware](opened, place)
        yield


@contextlib.contextmanager
def client(middleware: str, place: Place, number: int) -> Iterator[Act]:
    with contextlib.ExitStack() as opened:
        yield _CLIENTS[middleware](opened, place)


@contextlib.contextmanager
def mixed_server(middleware: str, place: Place) -> Iterator[None]:
    """A server with a pool of threads. What begins with a one takes as long as the slow handler of ours."""
    with contextlib.ExitStack() as opened:
        _POOLS[middleware](opened, place)
        yield


def mixed_client(middleware: str, place: Place, is_slow: bool) -> contextlib.AbstractContextManager[Act]:
    return client(middleware, place, int(is_slow))


def _worked(data: Array) -> Array:
    """The answer of the mixed server."""
    if data[0]:
        time.sleep(TAKES)
    return data


# ZeroMQ: a socket for each topic.


def _zeromq_publishers(opened: contextlib.ExitStack, place: Place, number: int) -> list[Act]:
    import zmq

    from robocomp_py.transports.zeromq.sockets import new_socket

    from .. import raw_zeromq as raw

    context = _context(opened)
    context.set(zmq.MAX_SOCKETS, 4096)

    def publisher(each: int) -> Act:
        socket = new_socket(context, zmq.PUB, SNDHWM=place.depth)
        opened.callback(socket.close, 0)
        socket.bind(f"ipc://{place.folder}/raw-{each}")
        return lambda data: raw.send_frames(socket, [b"benchmark", *raw.encode(data)])

    return [publisher(each) for each in range(number)]


def _zeromq_subscribers(opened: contextlib.ExitStack, place: Place, hears: list[Hear]) -> None:
    import zmq

    from robocomp_py.transports.zeromq.sockets import new_socket

    context = _context(opened)
    for number, hear in enumerate(hears):
        socket = new_socket(context, zmq.SUB, RCVHWM=place.depth, RCVTIMEO=_SLICE_MS)
        opened.callback(socket.close, 0)
        socket.subscribe(b"benchmark")
        socket.connect(f"ipc://{place.folder}/raw-{number}")
        _repeating(opened, partial(_zeromq_take, socket, partial(_heard, hear)))


def _zeromq_server(opened: contextlib.ExitStack, place: Place) -> None:
    import zmq

    from robocomp_py.transports.zeromq.sockets import new_socket

    from .. import raw_zeromq as raw

    socket = new_socket(_context(opened), zmq.ROUTER, RCVTIMEO=_SLICE_MS)
    opened.callback(socket.close, 0)
    socket.bind(f"ipc://{place.folder}/raw-echo")

    def answer(frames: list[Any]) -> None:
        identity, *payload = frames
        raw.send_frames(socket, [identity, *raw.encode(raw.decode(payload))])

    _repeating(opened, partial(_zeromq_take, socket, answer))


def _zeromq_pool(opened: contextlib.ExitStack, place: Place) -> None:
    """As the guide of ZeroMQ shows it: a proxy passes requests to threads, each with a socket."""
    import zmq

    from robocomp_py.transports.zeromq.sockets import new_socket, receive_frames

    from .. import raw_zeromq as raw

    context, inside = zmq.Context(), "inproc://raw-pool"
    front, back = new_socket(context, zmq.ROUTER), new_socket(context, zmq.DEALER)
    front.bind(f"ipc://{place.folder}/raw-echo")
    back.bind(inside)

    def work() -> None:
        with new_socket(context, zmq.DEALER) as socket, contextlib.suppress(zmq.ContextTerminated):
            socket.connect(inside)
            while True:
                identity, *payload = receive_frames(socket)
                raw.send_frames(socket, [identity, *raw.encode(_worked(raw.decode(payload)))])

    def relay() -> None:
        with front, back, contextlib.suppress(zmq.ContextTerminated):
            zmq.proxy(front, back)

    threads = [threading.Thread(target=each, name="bare") for each in (relay, *[work] * _THREADS)]
    for thread in threads:
        opened.callback(thread.join)
        thread.start()
    opened.callback(context.term)


def _zeromq_client(opened: contextlib.ExitStack, place: Place) -> Act:
    import zmq

    from robocomp_py.transports.zeromq.sockets import new_socket, receive_frames

    from .. import raw_zeromq as raw

    socket = new_socket(_context(opened), zmq.DEALER, RCVTIMEO=int(PATIENCE * 1000))
    opened.callback(socket.close, 0)
    socket.connect(f"ipc://{place.folder}/raw-echo")

    def ask(data: Any) -> Any:
        raw.send_frames(socket, raw.encode(data))
        return raw.decode(receive_frames(socket))

    return ask


def _zeromq_take(socket: Any, take: Callable[[list[Any]], object]) -> None:
    import zmq

    from robocomp_py.transports.zeromq.sockets import receive_frames

    with contextlib.suppress(zmq.Again):
        take(receive_frames(socket))


def _heard(hear: Hear, frames: list[Any]) -> None:
    from .. import raw_zeromq as raw

    hear(raw.decode(frames[1:]))


def _context(opened: contextlib.ExitStack) -> Any:
    import zmq

    context = zmq.Context()
    opened.callback(context.term)
    return context


# Zenoh: one session. The router is the session of the server or of the publisher.


def _zenoh_publishers(opened: contextlib.ExitStack, place: Place, number: int) -> list[Act]:

    from robocomp_py.transports.zenoh.session import open_router

    from .. import raw_zenoh as raw

    session = open_router(raw._endpoint(place))
    opened.callback(session.close)
    publishers = [session.declare_publisher(f"raw/topic/{each}") for each in range(number)]
    return [lambda data, each=each: each.put(raw.encode(data)) for each in publishers]  # type: ignore[misc]  # mypy


def _zenoh_subscribers(opened: contextlib.ExitStack, place: Place, hears: list[Hear]) -> None:

    from robocomp_py.transports.zenoh.session import open_client

    from .. import raw_zenoh as raw

    session = open_client(raw._endpoint(place))
    opened.callback(session.close)
    for number, hear in enumerate(hears):
        session.declare_subscriber(f"raw/topic/{number}", partial(_zenoh_heard, hear))


def _zenoh_heard(hear: Hear, sample: Any) -> None:
    from .. import raw_zenoh as raw

    hear(raw.decode(sample.payload.to_bytes()))


def _zenoh_server(opened: contextlib.ExitStack, place: Place) -> None:

    from robocomp_py.transports.zenoh.session import open_router

    from .. import raw_zenoh as raw

    session = open_router(raw._endpoint(place))
    opened.callback(session.close)

    def answer(query: Any) -> None:
        query.reply(query.key_expr, raw.encode(raw.decode(query.payload.to_bytes())))

    session.declare_queryable("raw/echo", answer, complete=True)


def _zenoh_pool(opened: contextlib.ExitStack, place: Place) -> None:
    from robocomp_py.transports.zenoh.session import open_router

    from .. import raw_zenoh as raw

    pool = opened.enter_context(ThreadPoolExecutor(_THREADS, "bare"))
    session = open_router(raw._endpoint(place))
    opened.callback(session.close)

    def answer(query: Any) -> None:
        query.reply(query.key_expr, raw.encode(_worked(raw.decode(query.payload.to_bytes()))))

    session.declare_queryable("raw/echo", lambda query: pool.submit(answer, query), complete=True)


def _zenoh_client(opened: contextlib.ExitStack, place: Place) -> Act:
    import zenoh

    from robocomp_py.transports.zenoh.session import open_client

    from .. import raw_zenoh as raw

    session = open_client(raw._endpoint(place))
    opened.callback(session.close)
    querier = session.declare_querier(
        "raw/echo", consolidation=zenoh.ConsolidationMode.NONE, timeout=PATIENCE, express=True
    )
    while not querier.matching_status.matching:  # type: ignore[attr-defined]  # its stub says bool
        threading.Event().wait(0.01)

    def ask(data: Any) -> Any:
        reply = querier.get(payload=raw.encode(data)).recv().ok
        if reply is None:
            raise TimeoutError("zenoh: no answer")
        return raw.decode(reply.payload.to_bytes())

    return ask


# DDS: a writer for each topic.


def _dds_publishers(opened: contextlib.ExitStack, place: Place, number: int) -> list[Act]:
    from .. import raw_dds as raw

    bus = raw._Bus(place)
    opened.callback(bus.close)
    writers = [bus.writer(f"Topic{each}") for each in range(number)]
    return [lambda data, each=each: each.write(raw.Sample(data)) for each in writers]  # type: ignore[misc]  # mypy


def _dds_subscribers(opened: contextlib.ExitStack, place: Place, hears: list[Hear]) -> None:
    from .. import raw_dds as raw

    bus = raw._Bus(place)
    opened.callback(bus.close)
    for number, hear in enumerate(hears):
        reader, waiting = bus.reader(f"Topic{number}")

        def take(reader: Any = reader, waiting: Any = waiting, hear: Hear = hear) -> None:
            if waiting.wait(raw._SLICE):
                for sample in reader.take(32):
                    if isinstance(sample, raw.Sample):
                        hear(sample.data)

        _repeating(opened, take)


# Shared memory: a publisher for each topic.


def _shm_publishers(opened: contextlib.ExitStack, place: Place, number: int) -> list[Act]:
    from .. import raw_shm as raw

    bus = raw._Bus(place)
    opened.callback(bus.close)
    publishers = [bus.publisher(f"topic{each}") for each in range(number)]
    opened.callback(publishers.clear)
    return [partial(raw.send, each) for each in publishers]


def _repeating(opened: contextlib.ExitStack, step: Callable[[], object]) -> None:
    """A thread that does this until the end; each step takes a slice of time at most."""
    stopped = threading.Event()

    def repeat() -> None:
        while not stopped.is_set():
            step()

    thread = threading.Thread(target=repeat, name="bare")
    thread.start()
    opened.callback(thread.join)
    opened.callback(stopped.set)


_PUBLISHERS = {
    "zeromq": _zeromq_publishers,
    "zenoh": _zenoh_publishers,
    "dds": _dds_publishers,
    "shm": _shm_publishers,
}
_SUBSCRIBERS = {"zeromq": _zeromq_subscribers, "zenoh": _zenoh_subscribers, "dds": _dds_subscribers}
_SERVERS = {"zeromq": _zeromq_server, "zenoh": _zenoh_server}
_POOLS = {"zeromq": _zeromq_pool, "zenoh": _zenoh_pool}
_CLIENTS = {"zeromq": _zeromq_client, "zenoh": _zenoh_client}
