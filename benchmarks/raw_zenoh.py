"""Bare Zenoh: our session settings, and a router that is the session of the process that serves, as with ours.

Payloads are one array in CDR, without attachment. Callbacks are plain functions, as a user passes them:
measured, that is as quick as Zenoh's other ways to hand over what came in, or quicker.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import zenoh

from robocomp_py.transports.zenoh.session import open_client, open_router

from .parties import PATIENCE, Array, Hear, Place

_ECHO, _TOPIC = "raw/echo", "raw/topic"
_ENCAPSULATION = b"\0\1\0\0"


def encode(data: Array) -> bytes:
    return b"".join((_ENCAPSULATION, data.size.to_bytes(4, "little"), data.data))


def decode(payload: bytes) -> Array:
    return np.frombuffer(payload, np.uint8, int.from_bytes(payload[4:8], "little"), 8)


class Far:
    def __init__(self, place: Place, hear: Hear) -> None:
        self._hear = hear
        self._session = open_router(_endpoint(place))
        self._session.declare_queryable(_ECHO, self._answer, complete=True)
        self._session.declare_subscriber(_TOPIC, self._heard)

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it

    def _answer(self, query: Any) -> None:
        query.reply(query.key_expr, encode(decode(query.payload.to_bytes())))

    def _heard(self, sample: Any) -> None:
        self._hear(decode(sample.payload.to_bytes()))


class Near:
    def __init__(self, place: Place) -> None:
        self._session = open_client(_endpoint(place))
        self._querier = self._session.declare_querier(
            _ECHO, consolidation=zenoh.ConsolidationMode.NONE, timeout=PATIENCE, express=True
        )
        self._publisher = self._session.declare_publisher(
            _TOPIC, congestion_control=zenoh.CongestionControl.BLOCK, reliability=zenoh.Reliability.RELIABLE
        )
        end = time.monotonic() + PATIENCE
        for each in (self._querier, self._publisher):
            while not each.matching_status.matching:  # type: ignore[attr-defined]  # its stub says bool
                if time.monotonic() > end:
                    raise TimeoutError(f"zenoh: the two ends did not find each other within {PATIENCE:g} s")
                time.sleep(0.01)

    def ask(self, data: Array) -> Array:
        sample = self._querier.get(payload=encode(data)).recv().ok
        if sample is None:
            raise TimeoutError("zenoh: no answer")
        return decode(sample.payload.to_bytes())

    def publish(self, data: Array) -> None:
        self._publisher.put(encode(data))

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it


def _endpoint(place: Place) -> str:
    return f"unixsock-stream/{place.folder}/raw-router"
