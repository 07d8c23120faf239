"""Values as people see and write them."""

from __future__ import annotations

import json as plain
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from robocomp_py.contract import told
from robocomp_py.contract.interface import Operation
from robocomp_py.contract.types import FLOAT32, FLOAT32_MAX, Field, Struct
from robocomp_py.testing import everything as e
from robocomp_py.wire import json
from robocomp_py.wire.cdr import Cdr

from .messages import messages, patiently


@patiently
@given(messages())
def test_what_is_shown_can_be_read_again(case: tuple[Struct, tuple[Any, ...]]) -> None:
    message, values = case
    operation: Operation[object] = Operation("Any::Thing", "do", message.fields)
    fields = told.operation(operation.text).inputs
    shown = plain.loads(plain.dumps(json.show_fields(message.fields, values)))
    taken = json.take_fields(fields, shown, "do")
    assert plain.dumps(json.show_fields(fields, taken)) == plain.dumps(shown)
    codec = Cdr()
    first, second = codec.encoder(message)(values), codec.encoder(Struct(message.name, fields))(taken)
    assert bytes(first or b"") == bytes(second or b"") or _has_nan(plain.dumps(shown))


def _has_nan(text: str) -> bool:
    """Two NaN may differ in their bits."""
    return '"NaN"' in text


@pytest.mark.parametrize("number", [FLOAT32_MAX, -FLOAT32_MAX])
def test_the_largest_float32_is_read_as_it_is_shown(number: float) -> None:
    fields = (Field("x", FLOAT32),)
    shown = json.show_fields(fields, (number,))
    assert plain.dumps(shown) in ('{"x": 3.4028235e+38}', '{"x": -3.4028235e+38}')
    assert np.float32(json.take_fields(fields, shown, "do")[0]) == number


FIELDS = told.operation(e.EVERYTHING.operations[0].text).inputs
"""One struct of every type."""


def nested(**changes: Any) -> dict[str, Any]:
    made: dict[str, Any] = json.template(FIELDS)
    scalars = made["value"]["scalars"]
    made["value"] |= {key: value for key, value in changes.items() if key not in scalars}
    scalars |= {key: value for key, value in changes.items() if key in scalars}
    return made


def test_a_template_fits() -> None:
    assert json.take_fields(FIELDS, json.template(FIELDS), "echo_nested")


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"u8": 256}, r"^go\.value\.scalars\.u8: 256 is out of range; it takes 0 to 255$"),
        ({"u8": 1.5}, r"u8: the number 1\.5 is given; it takes uint8$"),
        ({"u8": True}, r"u8: true is given; it takes uint8$"),
        ({"f64": math.inf}, r"f64: inf is out of range; it takes float64$"),
        ({"f64": math.nan}, r"f64: nan is out of range; it takes float64$"),
        ({"f32": 1e300}, r"f32: 1e\+300 is out of range; it takes float32$"),
        ({"f64": "much"}, r"f64: the text 'much' is given; it takes float64$"),
        ({"f64": None}, r"f64: null is given; it takes float64$"),
        ({"flag": 1}, r"flag: the number 1 is given; it takes bool$"),
        ({"text": 1}, r"text: the number 1 is given; it takes string$"),
        ({"colour": "purple"}, r"colour: the text 'purple' is given; it takes one of red, green, ultraviolet$"),
        ({"points": {"x": 1}}, r"points: an object is given; it takes an array of {x float64, y float64}$"),
        ({"points": [{"x": 1}]}, r"^go\.value\.points\[0\]: lacks `y`; it takes {x float64, y float64}$"),
        ({"points": ["there"]}, r"points\[0\]: the text 'there' is given; it takes {x float64, y float64}$"),
        ({"pionts": []}, r"^go\.value: no field `pionts`; did you mean `points`\?$"),
        ({"by_number": {"one": "x"}}, r"^key 'one' of go\.value\.by_number: the text 'one' is given; it takes int32$"),
        ({"by_name": []}, r"by_name: an array is given; it takes an object$"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_place(changes: dict[str, Any], why: str) -> None:
    with pytest.raises(json.Unfit, match=why):
        json.take_fields(FIELDS, nested(**changes), "go")


def test_a_field_of_a_struct_is_proposed_by_its_path() -> None:
    with pytest.raises(json.Unfit, match=r"^go: no field `points`; did you mean `value\.points`\?$"):
        json.take_fields(FIELDS, {"points": []}, "go")
    with pytest.raises(json.Unfit, match=r"^stop: no field `points`; it takes none$"):
        json.take_fields((), {"points": []}, "stop")


def test_a_message_that_is_no_object_is_refused() -> None:
    with pytest.raises(json.Unfit, match=r"^go: an array is given; it takes {value Conformance\.Nested}$"):
        json.take_fields(FIELDS, [], "go")


def test_octets_that_are_no_base64_are_refused() -> None:
    arrays = told.operation(e.EVERYTHING.operations[1].text).inputs
    made = json.template(arrays)
    made["value"]["octets"] = "a?"
    with pytest.raises(json.Unfit, match=r"^go\.value\.octets: not base64"):
        json.take_fields(arrays, made, "go")


@pytest.mark.parametrize(("value", "shown"), [(math.nan, "NaN"), (math.inf, "Infinity"), (-math.inf, "-Infinity")])
def test_json_has_no_infinity(value: float, shown: str) -> None:
    assert json.show(FLOAT32, value) == json.show(FLOAT32, np.float32(value)) == shown


def test_a_float32_is_shown_with_the_digits_that_it_has() -> None:
    assert json.show(FLOAT32, float(np.float32(0.1))) == 0.1
