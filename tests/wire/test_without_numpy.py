"""Tools read messages without numpy, unless a message has arrays: its import takes longer than all else they do."""

from __future__ import annotations

import json as plain
import subprocess
import sys
from collections.abc import Sequence as Items
from typing import Any

import pytest

from robocomp_py.contract.interface import Operation
from robocomp_py.contract.types import (
    BOOL,
    FLOAT32,
    FLOAT32_MAX,
    INT32,
    STRING,
    TIME,
    UINT8,
    Dictionary,
    Enumeration,
    Field,
    Sequence,
    Struct,
)
from robocomp_py.wire import json
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.messagepack import MessagePack

BEAM = Struct("Seen::Beam", (Field("angle", FLOAT32), Field("hit", BOOL)))
LIGHT = Enumeration("Seen::Light", (("dark", 0), ("bright", 1)))
SCAN = (
    Field("beams", Sequence(BEAM)),
    Field("names", Sequence(STRING)),
    Field("light", LIGHT),
    Field("at", TIME),
    Field("counts", Dictionary(STRING, INT32)),
)
SEEN = ([(0.1 * each, each % 2 == 0) for each in range(100)], ["left", "right"], 1, 10**18, {"walls": 4})
PICTURE = (Field("octets", Sequence(UINT8)),)

CODECS: dict[str, Cdr | MessagePack] = {"Cdr": Cdr(), "MessagePack": MessagePack()}

READ = """
import json as plain, sys
from robocomp_py.contract import told
from robocomp_py.tools import tap
from robocomp_py.wire import json
from robocomp_py.wire.{module} import {codec}
text, *parts = plain.loads(sys.stdin.read())
operation, parts = told.operation(text), [bytes.fromhex(each) for each in parts]
decode = {codec}().decoder(operation.request)
shown = json.show_fields(operation.inputs, decode(parts if {codec}.__name__ == "MessagePack" else parts[0]))
print(plain.dumps([shown, "numpy" in sys.modules]))
"""


def read_elsewhere(codec: str, fields: tuple[Field, ...], values: Items[Any]) -> tuple[Any, bool]:
    """What another process shows of a message, and whether it has imported numpy for that."""
    operation: Operation[object] = Operation("Seen::Eye", "see", fields)
    payload: Any = CODECS[codec].encoder(operation.request)(tuple(values))
    parts = payload if isinstance(payload, list) else [payload]
    given = plain.dumps([operation.text, *(bytes(each).hex() for each in parts)])
    program = READ.format(codec=codec, module=codec.lower())
    done = subprocess.run([sys.executable, "-c", program], input=given, capture_output=True, text=True, check=True)
    shown, has_numpy = plain.loads(done.stdout)
    return shown, has_numpy


@pytest.mark.parametrize("codec", CODECS)
def test_a_message_without_arrays_is_read_and_shown_without_numpy(codec: str) -> None:
    assert read_elsewhere(codec, SCAN, SEEN) == (json.show_fields(SCAN, SEEN), False)


@pytest.mark.parametrize("codec", CODECS)
def test_a_message_with_an_array_is_read_with_numpy(codec: str) -> None:
    assert read_elsewhere(codec, PICTURE, [b"\1\2\3"]) == ({"octets": "AQID"}, True)


SINGLES = [0.0, -0.0, 0.1, -7.3, 1 / 3, 1e10, 123456.79, 16777216.0, FLOAT32_MAX, -FLOAT32_MAX, 2.0**-126, 2.0**-149]
SINGLES += [10.0**power * digit for power in range(-44, 38, 3) for digit in (1, 2.5, 9.999999)]


def test_a_float32_is_shown_with_the_same_digits_without_numpy() -> None:
    kind = Struct("Seen::Number", (Field("number", FLOAT32),))
    fields = (Field("numbers", Sequence(kind)),)
    values = [[(each,) for each in SINGLES]]
    assert read_elsewhere("Cdr", fields, values) == (json.show_fields(fields, values), False)
