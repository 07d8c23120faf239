"""The values of literals."""

from __future__ import annotations

import re
import sys
from typing import Any

from ...contract.types import FLOAT32_LIMIT, Primitive, integer_range
from ..numbers import real, whole
from . import model as m

FLOAT64_MAX = sys.float_info.max


def literal_value(kind: Primitive | m.Enum, literal: m.Literal) -> Any:
    """The value of a literal for a type; raises ValueError, in words for people, if it has none."""
    text = literal.text
    if isinstance(kind, m.Enum):
        names = [member.name.text for member in kind.members]
        owner, _, short = text.rpartition("::")
        if literal.quoted or short not in names or owner.rpartition("::")[2] not in ("", kind.name.text):
            raise ValueError(f"`{text}` is not an enumerator of `{kind.name}`; allowed: {', '.join(names)}")
        return short
    if kind.python is str:
        if not literal.quoted:
            raise ValueError("a string needs double quotes")
        return text
    if literal.quoted:
        raise ValueError(f"a {kind} is written without quotes")
    if kind.python is bool:
        if text not in ("true", "false"):
            raise ValueError(f"`{text}` is not a bool; write true or false")
        return text == "true"
    if kind.python is float:
        return _float(kind, text)
    return _integer(kind, text)


def _float(kind: Primitive, text: str) -> float:
    if not re.fullmatch(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?[fF]?", text):
        raise ValueError(f"`{text}` is not a number")
    value = real(text)
    if abs(value) >= FLOAT32_LIMIT if kind is Primitive.FLOAT32 else abs(value) > FLOAT64_MAX:
        raise ValueError(f"{text} exceeds {kind}")
    return value


def _integer(kind: Primitive, text: str) -> int:
    if not re.fullmatch(r"[+-]?(0[xX][0-9a-fA-F]+|\d+)", text):
        raise ValueError(f"`{text}` is not an integer")
    value = whole(text)
    low, high = integer_range(kind)
    if not low <= value <= high:
        raise ValueError(f"{text} does not fit; allowed: {low} to {high}")
    return value
