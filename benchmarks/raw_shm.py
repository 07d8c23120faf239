"""Bare iceoryx2: our limits and its events, an array written straight into a sample and read where it lies, no header.

A publish-subscribe service for each direction, since that is quicker than its request-response; and a
listener for whoever waits, which is how one waits without burning a core.
"""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Callable
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
    size = int.from_bytes(octets[4:8], "little")
    array = np.frombuffer(octets, np.uint8, size, _BEFORE)
    return array


class _Bus:
    """A node, and what is opened with it."""

    def __init__(self, place: Place) -> None:
        config = iox2.config.default()
        config.global_cfg.root_path = iox2.Path.new(f"{place.folder}/raw-shm")
        config.global_cfg.prefix = iox2.FileName.new(f"raw{hash(place.folder) & 0xFFFFFF:06x}_")
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

    def event(self, name: str) -> Any:
        service = self._node.service_builder(iox2.ServiceName.new(name)).event()
        return service.max_listeners(1).max_notifiers(1).event_id_max_value(63).open_or_create()
