"""Recordings of any messages, for those that read them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from robocomp_py.contract.types import Struct
from robocomp_py.tools.recording.bag import Options
from robocomp_py.tools.recording.layout import Topic
from robocomp_py.tools.recording.writer import Recorder, to_cdr
from robocomp_py.wire.cdr import TAIL, Cdr
from robocomp_py.wire.codec import Codec
from tests.wire.schemas import operation_of

ROOMY = Cdr(40)
"""As of a transport that sends a header and a message as one sample."""


def recorded(
    folder: Path,
    message: Struct,
    sent: Sequence[tuple[Any, ...]],
    options: Options,
    codec: Codec | None = None,
) -> Path:
    """A recording of these messages, a second apart: numbers 1, 2, ... of any/Source/told, each sent 10 ns before."""
    used, operation = codec or Cdr(), operation_of(message)
    clock = iter(range(10**9, 10**12, 10**9))
    with Recorder(folder, options, now=lambda: next(clock)) as recorder:
        track = recorder.track(Topic("any/Source/told", operation), to_cdr(used, operation.request))
        encode = used.encoder(operation.request)
        for number, values in enumerate(sent, 1):
            payload = encode(values)
            if used is ROOMY:
                payload = payload[: -len(TAIL)]  # as publications are sent
            track.put(payload, number * 10**9 - 10, number)
    assert recorder.error is None
    assert track.malformed == 0
    return folder
