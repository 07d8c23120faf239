"""Recordings that tests write, and what is in them."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from typing import Any

from robocomp_py.contract.interface import Operation
from robocomp_py.contract.qos import Durability, QoS, Reliability
from robocomp_py.contract.types import INT32, STRING, UINT8, Field, Sequence
from robocomp_py.tools.recording.bag import BagWriter, Options
from robocomp_py.tools.recording.layout import Topic
from robocomp_py.tools.recording.reader import Recording, values_by_topic
from robocomp_py.wire.cdr import Cdr

NEWS = Operation[Any]("House::News", "told", (Field("number", INT32), Field("text", STRING)))
PICTURE = Operation[Any]("House::Camera", "seen", (Field("pixels", Sequence(UINT8)),))
LATCHED = QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=3, lifespan=1.5)
told = Topic("hall/News/told", NEWS, "hall", "shm", LATCHED)
seen = Topic("hall/Camera/seen", PICTURE)


def news(number: int, text: str = "hello") -> bytes:
    return bytes(Cdr().encoder(NEWS.request)((number, text)))


def filled(folder: Path, options: Options, numbers: int, octets: int = 0) -> Path:
    """A recording of `numbers` messages, a second apart; `octets` makes each of them longer."""
    clock = count()
    writer = BagWriter(folder, options, clock=lambda: float(next(clock)))
    topic = writer.add(told)
    for number in range(numbers):
        writer.write(topic, news(number, "hello" + "x" * octets), number * 10**9, number * 10**9 - 5, number + 1)
    writer.close()
    return folder


def numbers_in(path: Path) -> list[int]:
    with Recording(path) as recording:
        values = values_by_topic()
        return [values(each)[0] for each in recording.messages()]
