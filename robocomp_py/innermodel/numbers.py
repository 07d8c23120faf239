"""Reads the numbers in attributes of a scene. For a text that is no number, it proposes one."""

from __future__ import annotations

import math
import re

from .nodes import Attribute, Kind

_LOOK_ALIKE = str.maketrans(
    {"O": "0", "o": "0", "l": "1", "I": "1", "\N{MINUS SIGN}": "-", "\N{EN DASH}": "-", "_": ""}
)
_UNITS = {
    "mm": ("mm", 1.0),
    "cm": ("mm", 10.0),
    "m": ("mm", 1000.0),
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180.0),
    "°": ("rad", math.pi / 180.0),
    "kg": ("kg", 1.0),
    "g": ("kg", 0.001),
}
"""The unit that the attribute has, and the factor to it, by what may be written after a number."""

_WITH_UNIT = re.compile(rf"(?P<number>.*[\d.])\s*(?P<unit>{'|'.join(_UNITS)})", re.DOTALL)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")
_YES, _NO = ("yes", "y", "on", "t"), ("no", "n", "off", "f", "none")


def is_number(text: str) -> bool:
    """Whether a text is a number, which may be infinite or `nan`."""
    try:
        float(text)
    except ValueError:
        return False
    return text.isascii() and "_" not in text


def written(number: float) -> str:
    """A number as a person writes it: `90`, `1.570796`."""
    text = f"{number:.6f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def remedy(attribute: Attribute, text: str) -> str:
    """What to write instead of a text that is no number."""
    meant = _meant(attribute, text)
    return f"did you mean `{meant}`?" if meant else f"write {attribute.kind.value}"


def _meant(attribute: Attribute, text: str) -> str:
    if attribute.kind is Kind.FLAG and text.lower() in (*_YES, *_NO):
        return "1" if text.lower() in _YES else "0"
    if attribute.kind is not Kind.NUMBERS:
        return _one(attribute, text)
    separated = [_one(attribute, each.strip()) for each in text.split(",")]
    if not all(separated):
        separated = [_one(attribute, each) for each in re.split(r"[\s,;x*]+", text.strip(" \t\r\n,;"))]
    return ",".join(separated) if all(separated) and len(separated) <= 3 else ""


def _one(attribute: Attribute, text: str) -> str:
    """The number that is meant; "" if that is not clear."""
    if is_number(text):
        return text
    if found := _WITH_UNIT.fullmatch(text):
        unit, factor = _UNITS[found["unit"]]
        number = _one(attribute, found["number"])
        return written(float(number) * factor) if number and attribute.text.split()[-1] == unit else ""
    if _DECIMAL_COMMA.fullmatch(text):
        return text.replace(",", ".")
    alike = text.translate(_LOOK_ALIKE)
    return alike if is_number(alike) and any(each.isdigit() for each in text) else ""
