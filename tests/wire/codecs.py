"""The codecs, and messages to encode with each of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from robocomp_py.contract.types import Field, Struct, Type
from robocomp_py.testing import everything as e
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.codec import Codec
from robocomp_py.wire.ice import Ice
from robocomp_py.wire.identity import Identity
from robocomp_py.wire.messagepack import MessagePack

CODECS: list[Codec] = [Cdr(), Cdr(columns=True), MessagePack(), Ice(), Identity()]
WIRES: list[Codec] = [Cdr(), Cdr(columns=True), MessagePack(), Ice()]
NAMES = ["cdr", "cdr with columns", "messagepack", "ice", "identity"]
every_codec = pytest.mark.parametrize("codec", CODECS, ids=NAMES)
every_wire = pytest.mark.parametrize("codec", WIRES, ids=NAMES[:-1])


def one(kind: Type) -> Struct:
    """A message of one field."""
    return Struct("Test::Message", (Field("value", kind),))


def there_and_back(codec: Codec, kind: Type, value: Any) -> Any:
    (back,) = codec.decoder(one(kind))(codec.encoder(one(kind))((value,)))
    return back


RICH = Struct("Test::Rich", (Field("nested", e.Nested.__contract__), Field("arrays", e.Arrays.__contract__)))


def rich() -> tuple[e.Nested, e.Arrays]:
    """A message that uses every type."""
    scalars = e.Scalars(True, -1, 2, -3, 4, 0.5, -6, 0.7, "eight", 9, -10, 11, -12, e.Colour.ultraviolet)
    nested = e.Nested(
        scalars,
        [e.Point(1.0, 2.0), e.Point(math.nan, -0.0)],
        ["", "é"],
        [e.Colour.green],
        {"here": e.Point(3.0, 4.0)},
        {-5: "minus five"},
        {e.Colour.red: math.inf},
        [[], [e.Point()]],
    )
    arrays = e.Arrays(
        np.arange(70_000).astype(np.uint8),
        np.array([-1, 2], np.int16),
        np.array([-(2**63)]),
        np.array([0.5, math.nan], np.float32),
        np.linspace(0, 1, 9_000),
        np.array([True, False]),
    )
    return nested, arrays
