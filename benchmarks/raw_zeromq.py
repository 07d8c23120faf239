"""Bare ZeroMQ: the socket kinds and options of our transport, MessagePack of one array, no header.

Arrays of 64 KiB and more travel beside the MessagePack, in a frame of their own. Frames are sent and
received one by one, which is quicker than `send_multipart`, and copied, as in pyzmq's recipe for
arrays: with `copy=False` the sender's array must not be changed until ZeroMQ says so.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np
import zmq

from robocomp_py.transports.zeromq.sockets import new_socket, receive_frames
from robocomp_py.wire.packed_arrays import APART

from .parties import PATIENCE, Array, Hear, Place

_SLICE_MS = 200
"""The far end looks this often whether it is to stop."""

_TOPIC = b"benchmark"


def encode(data: Array) -> list[Any]:
    return [msgpack.packb([data.tobytes()])] if data.nbytes < APART else [msgpack.packb([None]), data.data]


def decode(frames: list[Any]) -> Array:
    (data,) = msgpack.unpackb(frames[0])
    return np.frombuffer(frames[1] if data is None else data, np.uint8)


def send_frames(socket: zmq.Socket[bytes], frames: list[Any]) -> None:
    for frame in frames[:-1]:
        socket.send(frame, zmq.SNDMORE)
    socket.send(frames[-1])


class Far:
    def __init__(self, place: Place, hear: Hear) -> None:
        self._hear = hear
        self._stopped = threading.Event()
        self._context = zmq.Context()
        self._serving = new_socket(self._context, zmq.ROUTER, RCVTIMEO=_SLICE_MS)
        self._serving.bind(f"ipc://{place.folder}/raw-echo")
        self._hearing = new_socket(self._context, zmq.SUB, RCVHWM=place.depth, RCVTIMEO=_SLICE_MS)
        self._hearing.subscribe(_TOPIC)
        self._hearing.connect(f"ipc://{place.folder}/raw-topic")
        self._threads = [
            threading.Thread(target=self._repeat, args=args, name=args[1].__name__)
            for args in ((self._serving, self._answer), (self._hearing, self._heard))
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        self._stopped.set()
        for thread in self._threads:
            thread.join()
        self._serving.close()
        self._hearing.close()
        self._context.term()

    def _repeat(self, socket: zmq.Socket[bytes], take: Callable[[list[bytes]], object]) -> None:
        while not self._stopped.is_set():
            try:
                frames = receive_frames(socket)
            except zmq.Again:
                continue
            take(frames)

    def _answer(self, frames: list[bytes]) -> None:
        identity, *payload = frames
        send_frames(self._serving, [identity, *encode(decode(payload))])

    def _heard(self, frames: list[bytes]) -> None:
        self._hear(decode(frames[1:]))


class Near:
    def __init__(self, place: Place) -> None:
        patience = {"RCVTIMEO": int(PATIENCE * 1000), "SNDTIMEO": int(PATIENCE * 1000)}
        self._context = zmq.Context()
        self._asking = new_socket(self._context, zmq.DEALER, None, **patience)
        self._asking.connect(f"ipc://{place.folder}/raw-echo")
        self._publishing = new_socket(
            self._context, zmq.XPUB, None, SNDHWM=place.depth, XPUB_VERBOSER=1, XPUB_NODROP=1, **patience
        )
        self._publishing.bind(f"ipc://{place.folder}/raw-topic")
        self._publishing.recv()  # the subscription

    def ask(self, data: Array) -> Array:
        send_frames(self._asking, encode(data))
        return decode(receive_frames(self._asking))

    def publish(self, data: Array) -> None:
        send_frames(self._publishing, [_TOPIC, *encode(data)])

    def close(self) -> None:
        self._asking.close()
        self._publishing.close()
        self._context.term()
