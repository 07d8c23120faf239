"""Bare iceoryx2: our limits and its events, an array written straight into a sample and read where it lies, no header.

A publish-subscribe service for each direction, since that is quicker than its request-response; and a
listener for whoever waits, which is how one waits without burning a core.
"""

from __future__ import annotations

import ctypes
import threading
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import iceoryx2 as iox2
import numpy as np

from .parties import PATIENCE, Array, Hear, Place

_SLICE = iox2.Duration.from_millis(200)
"""The far end looks this often whether it is to stop."""

_ENCAPSULATION = b"\0\1\0\0"
_BEFORE = 8
"""Octets in front of the array."""


def encode(data: Array) -> bytes:
    return b"".join((_ENCAPSULATION, data.size.to_bytes(4, "little"), data.data))


def decode(octets: Any) -> Array:
    return np.frombuffer(octets, np.uint8, int.from_bytes(octets[4:8], "little"), _BEFORE)


class _Bus:
    """A node, and what is opened with it."""

    def __init__(self, place: Place) -> None:
        config = iox2.config.default()
        config.global_cfg.root_path = iox2.Path.new(f"{place.folder}/raw-shm")
        self._prefix = f"raw{zlib.crc32(place.folder.encode()):08x}_"
        config.global_cfg.prefix = iox2.FileName.new(self._prefix)
        builder = iox2.NodeBuilder.new().config(config).signal_handling_mode(iox2.SignalHandlingMode.Disabled)
        self._node = builder.create(iox2.ServiceType.Ipc)
        self._depth = place.depth

    def topic(self, name: str) -> Any:
        """One that loses nothing: what finds no room is not sent, and has to be sent again."""
        service = self._node.service_builder(iox2.ServiceName.new(name))
        service = service.publish_subscribe(iox2.Slice[ctypes.c_uint8]).enable_safe_overflow(False)
        service = service.subscriber_max_buffer_size(self._depth).subscriber_max_borrowed_samples(4)
        return service.max_publishers(1).max_subscribers(1).open_or_create()

    def publisher(self, name: str) -> Any:
        port = self.topic(name).publisher_builder().initial_max_slice_len(4096)
        port = port.backpressure_strategy(iox2.BackpressureStrategy.DiscardData)
        return port.allocation_strategy(iox2.AllocationStrategy.PowerOfTwo).create()

    def subscriber(self, name: str) -> Any:
        return self.topic(name).subscriber_builder().create()

    def listener(self, name: str) -> Any:
        return self._event(name).listener_builder().create()

    def notifier(self, name: str) -> Any:
        """Of a listener that is there, or will be soon."""
        service = self._event(name)
        end = time.monotonic() + PATIENCE
        while not service.dynamic_config.number_of_listeners:
            if time.monotonic() > end:
                raise TimeoutError(f"shm: nobody listens to {name} within {PATIENCE:g} s")
            time.sleep(0.01)
        return service.notifier_builder().create()

    def close(self) -> None:
        self._node = None
        for counter in Path("/dev/shm").glob(f"{self._prefix}*.global_mgmt"):  # which nodes share, and leave
            counter.unlink(missing_ok=True)

    def _event(self, name: str) -> Any:
        service = self._node.service_builder(iox2.ServiceName.new(name)).event()
        return service.max_listeners(1).max_notifiers(1).event_id_max_value(63).open_or_create()


def send(publisher: Any, data: Array) -> None:
    size = data.size
    head = _ENCAPSULATION + size.to_bytes(4, "little")
    end = 0.0
    while True:
        sample = publisher.loan_slice_uninit(_BEFORE + size)
        address = sample.payload_ptr
        ctypes.memmove(address, head, _BEFORE)
        ctypes.memmove(address + _BEFORE, data.ctypes.data, size)
        if sample.assume_init().send():
            return
        end = end or time.monotonic() + PATIENCE
        if time.monotonic() > end:
            raise TimeoutError(f"shm: no room for a message within {PATIENCE:g} s")
        time.sleep(0.0001)


def read(subscriber: Any, listener: Any, patience: Any) -> Any:
    """The next sample; None if there is none that soon."""
    sample = subscriber.receive()
    if sample is None and listener.timed_wait(patience):
        sample = subscriber.receive()
    return sample


class Far:
    def __init__(self, place: Place, hear: Hear) -> None:
        self._hear = hear
        self._stopped = threading.Event()
        self._bus = _Bus(place)
        self._asked = self._bus.subscriber("request"), self._bus.listener("request")
        self._heard = self._bus.subscriber("topic"), self._bus.listener("topic")
        self._replies = self._bus.publisher("reply")
        self._ring: Any = None
        self._threads = [
            threading.Thread(target=self._repeat, args=args, name=args[2].__name__)
            for args in ((*self._asked, self._answer), (*self._heard, self._hear_of))
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        self._stopped.set()
        for thread in self._threads:
            thread.join()
        del self._asked, self._heard, self._replies, self._ring
        self._bus.close()

    def _repeat(self, subscriber: Any, listener: Any, take: Callable[[Any], object]) -> None:
        while not self._stopped.is_set():
            sample = read(subscriber, listener, _SLICE)
            if sample is not None:
                take(sample.payload().as_memory_view())

    def _answer(self, octets: Any) -> None:
        if self._ring is None:
            self._ring = self._bus.notifier("reply")
        send(self._replies, decode(octets))
        self._ring.notify()

    def _hear_of(self, octets: Any) -> None:
        self._hear(decode(octets))


class Near:
    def __init__(self, place: Place) -> None:
        self._bus = _Bus(place)
        self._answers = self._bus.subscriber("reply"), self._bus.listener("reply")
        self._requests, self._topic = self._bus.publisher("request"), self._bus.publisher("topic")
        self._ask, self._tell = self._bus.notifier("request"), self._bus.notifier("topic")
        self._sample: Any = None
        """Of the last answer, which is read where it lies."""

    def ask(self, data: Array) -> Array:
        send(self._requests, data)
        self._ask.notify()
        subscriber, listener = self._answers
        end = time.monotonic() + PATIENCE
        while (sample := read(subscriber, listener, _SLICE)) is None:
            if time.monotonic() > end:
                raise TimeoutError(f"shm: no answer within {PATIENCE:g} s")
        self._sample = sample
        return decode(sample.payload().as_memory_view())

    def publish(self, data: Array) -> None:
        send(self._topic, data)
        self._tell.notify()

    def close(self) -> None:
        del self._answers, self._requests, self._topic, self._ask, self._tell, self._sample
        self._bus.close()
