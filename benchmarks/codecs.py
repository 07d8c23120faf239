"""Measures encoding and decoding alone: our codecs, and those of the bare libraries.

XCDR1 is compared with the codec of the cyclonedds package, MessagePack with `msgpack` and plain dicts and lists.
Each side uses the objects of its users: ours arrays and generated classes, the package its own classes, `msgpack`
dicts. A cloud is a list of points on every side, with an object or a dict for each point.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import msgpack
import numpy as np
from numpy.typing import NDArray

from robocomp_py.contract.types import BOOL, FLOAT32, INT32, UINT8, Field, Primitive, Sequence, Struct
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.codec import Codec
from robocomp_py.wire.messagepack import MessagePack

from .goals import Finding
from .query import Tell
from .rounds import Effort, by_turns, how_many, ratio, seconds_of, times
from .tables import Table, us

PIXELS, BEAMS, POINTS = 1_000_000, 720, 10_000


@dataclass(frozen=True)
class Row:
    """Encoding and decoding once, in µs; `times` is how many times faster ours is."""

    codec: str
    message: str
    ours: float
    its: float
    times: float
    goal: float


# The messages, as generated code has them.


@dataclass(slots=True)
class Image:
    compressed: bool = False
    width: int = 0
    height: int = 0
    depth: int = 0
    image: NDArray[np.uint8] = field(default_factory=lambda: np.empty(0, np.uint8))

    __contract__: ClassVar[Struct]


@dataclass(slots=True)
class Scan:
    first: float = 0.0
    step: float = 0.0
    ranges: NDArray[np.float32] = field(default_factory=lambda: np.empty(0, np.float32))

    __contract__: ClassVar[Struct]


@dataclass(slots=True)
class Point:
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    __contract__: ClassVar[Struct]


@dataclass(slots=True)
class Cloud:
    points: list[Point] = field(default_factory=list)

    __contract__: ClassVar[Struct]


@dataclass(slots=True)
class BaseState:
    """As `GenericBase` has it."""

    x: float = 0.0
    correctedX: float = 0.0
    z: float = 0.0
    correctedZ: float = 0.0
    alpha: float = 0.0
    correctedAlpha: float = 0.0
    advVx: float = 0.0
    advVz: float = 0.0
    rotV: float = 0.0
    isMoving: bool = False

    __contract__: ClassVar[Struct]


_SCALARS: dict[str, Primitive] = {"bool": BOOL, "int": INT32, "float": FLOAT32}


def _describe(made: Any, **others: Any) -> None:
    kinds = {each.name: others.get(each.name) or _SCALARS[str(each.type)] for each in fields(made)}
    made.__contract__ = Struct(made.__name__, tuple(Field(name, kind) for name, kind in kinds.items()), made)


_describe(Image, image=Sequence(UINT8))
_describe(Scan, ranges=Sequence(FLOAT32))
_describe(Point)
_describe(Cloud, points=Sequence(Point.__contract__))
_describe(BaseState)


def _messages() -> Iterator[tuple[str, Any]]:
    random = np.random.default_rng(1)
    yield "image, 1 MB", Image(False, 1000, 1000, 1, random.integers(0, 256, PIXELS, dtype=np.uint8))
    yield f"laser scan, {BEAMS} floats", Scan(-1.5, 0.004, random.random(BEAMS, dtype=np.float32))
    rows = random.random((POINTS, 3), dtype=np.float32).tolist()
    yield f"cloud of {POINTS} points", Cloud([Point(*row) for row in rows])
    yield "state of a base", BaseState(*random.random(9, dtype=np.float32).tolist())


XCDR1_GOALS = (100.0, 5.0, 20.0, 3.0)
MESSAGEPACK_GOALS = (50.0, 50.0, 1.0, 1.0)
"""How many times as quick as the others ours has to be, for these messages. What other libraries are given as bytes
instead of a list must not be slower with ours."""


def run(effort: Effort, tell: Tell) -> list[Row]:
    rows = []
    for (name, message), much, more in zip(_messages(), XCDR1_GOALS, MESSAGEPACK_GOALS, strict=True):
        tell(f"codecs · {name}")
        rows.append(_compared("XCDR1", name, _ours(Cdr(), message), _package(message), effort, much))
        plain = _plain(message)
        rows.append(_compared("MessagePack", name, _ours(MessagePack(), message), _bare(plain), effort, more))
        if isinstance(message, Image):
            plain["image"] = message.image.tobytes()
            rows.append(
                _compared("MessagePack", f"{name}, bytes", _ours(MessagePack(), message), _bare(plain), effort, 1.0)
            )
    return sorted(rows, key=lambda row: row.codec, reverse=True)


def _compared(
    codec: str, name: str, ours: Callable[[], object], its: Callable[[], object], effort: Effort, goal: float
) -> Row:
    measures = [lambda call=call: seconds_of(call, how_many(call, effort.seconds)) for call in (ours, its)]
    mine, others = by_turns(measures, effort.rounds)
    return Row(codec, name, times(mine).p50, times(others).p50, 1 / ratio(mine, others), goal)


def _ours(codec: Codec, message: Any) -> Callable[[], object]:
    request = Struct("Request", (Field("value", message.__contract__),))
    encode, decode = codec.encoder(request, snapshot=False), codec.decoder(request)
    return lambda: decode(encode((message,)))


def _package(message: Any) -> Callable[[], object]:
    """The codec of cyclonedds, with the fastest types that it accepts: bytes for an image."""
    from . import package_types as its

    kind, sample = its.sample(message)
    return lambda: kind.deserialize(sample.serialize())


def _bare(plain: dict[str, Any]) -> Callable[[], object]:
    return lambda: msgpack.unpackb(msgpack.packb(plain))


def _plain(message: Any) -> Any:
    """Dicts and lists."""
    if isinstance(message, np.ndarray):
        return message.tolist()
    if isinstance(message, list):
        return [_plain(each) for each in message]
    if hasattr(message, "__contract__"):
        return {each.name: _plain(getattr(message, each.name)) for each in fields(message)}
    return message


def table(rows: list[Row]) -> Table:
    cells = [
        (
            row.codec,
            row.message,
            us(row.ours),
            us(row.its),
            _times(row.times),
            f"≥ {_times(row.goal)}: {'met' if row.times >= row.goal else 'missed'}",
        )
        for row in rows
    ]
    head = ("", "encoded and decoded", "ours", "the other", "ours is quicker by", "goal")
    return Table("codecs", "our codecs, and those of users of the bare libraries", head, cells)


def findings(rows: list[Row]) -> list[Finding]:
    return [
        Finding(row.codec.lower(), row.message, "", _times(row.times), row.times >= row.goal, 1 / row.times)
        for row in rows
    ]


def _times(ratio: float) -> str:
    return f"{ratio:.0f} ×" if ratio >= 20 else f"{ratio:.1f} ×"
