"""Recordings of any messages, for those that read them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from robocomp_py.contract.interface import Pattern
from robocomp_py.contract.types import Struct
from robocomp_py.testing import everything as e
from robocomp_py.tools.recording.bag import Options
from robocomp_py.tools.recording.calls import calls_topic, info_octets, joined, log_octets, logs_topic
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


def calls_and_logs(folder: Path, options: Options) -> Path:
    """A recording of a call that was answered, one that failed, and a log record."""
    encode = Cdr().encoder
    clock = iter(range(10**9, 10**12, 10**9))
    with Recorder(folder, options, now=lambda: next(clock)) as recorder:
        calls = recorder.track(
            calls_topic("calculator/Everything/divide", e.divide, Pattern.QUERY, "calculator", "shm"), joined(e.divide)
        )
        request, response = encode(e.divide.request)((7, 2)), encode(e.divide.response)((3, 1))
        calls.put([info_octets("pupil", "shm", 10**9, 0.25, "ok", ""), request, response])
        calls.put([info_octets("pupil", "shm", 2 * 10**9, 0.75, "timeout", "no answer"), request, b""])
        logs = recorder.track(logs_topic())
        record = {
            "at": 5,
            "level": "WARNING",
            "logger": "driver",
            "text": "hot",
            "file": "arm.py",
            "line": 3,
            "trace": "",
        }
        logs.put(log_octets("desk/arm", record), 5)
    assert recorder.error is None
    return folder
