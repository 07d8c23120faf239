"""Checks the values of attributes. For a text that is no number, it proposes one."""

from __future__ import annotations

import math
import re

from .nodes import CHOICES, Attribute, Kind, Value

_NEVER_NEGATIVE = frozenset(("width", "height", "measures", "port", "noise", "mass", "focal", "length"))
"""Attributes that may not be negative."""

_MOST = {"port": 65535, "width": 16384, "height": 16384, "measures": 100_000}
"""The greatest values of whole numbers."""

_MOST_NUMBERS = 3

_NEVER_IN_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

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


def amiss(attribute: Attribute, value: Value, text: str) -> str:
    """What is wrong with a value of an attribute, which is written as `text`; "" if nothing is wrong."""
    match attribute.kind:
        case Kind.NUMBER | Kind.COUNT:
            return _amiss_in_number(attribute, value, text)
        case Kind.NUMBERS:
            return _amiss_in_numbers(attribute, value if isinstance(value, tuple) else (value,), text)
        case Kind.FLAG:
            return "" if value in (0, 1) else f"is {attribute.kind.value}, not `{text}`"
        case Kind.AXIS | Kind.ENGINE | Kind.RENDER:
            return "" if value in CHOICES[attribute.kind] else f"is {attribute.kind.value}, not `{text}`"
        case Kind.TEXT:
            if not isinstance(value, str):
                return f"is a text, not `{text}`"
            return "has characters that no XML file can have" if _NEVER_IN_XML.search(value) else ""


def _amiss_in_number(attribute: Attribute, value: Value, text: str) -> str:
    name = attribute.name
    if not isinstance(value, (int, float)):
        return f"is {attribute.kind.value}, not `{text}`"
    if math.isnan(value) or (math.isinf(value) and attribute.default not in (-math.inf, math.inf)):
        return f"is `{text}`, which is no finite number"
    if value < 0 and name in _NEVER_NEGATIVE:
        return "is negative"
    most = _MOST.get(name, 2**31 - 1)
    if attribute.kind is Kind.COUNT and (value != int(value) or value > most):
        return f"is a whole number of at most {most}, not `{text}`"
    return ""


def _amiss_in_numbers(attribute: Attribute, values: tuple[Value, ...], text: str) -> str:
    numbers = [each for each in values if isinstance(each, (int, float))]
    if len(numbers) < len(values) or not values:
        return f"is {attribute.kind.value}, not `{text}`"
    if not all(map(math.isfinite, numbers)):
        return f"is `{text}`, which has a number that is not finite"
    if len(numbers) > _MOST_NUMBERS:
        return f"has {len(numbers)} numbers; at most {_MOST_NUMBERS} are allowed"
    return "is 0 for an axis, which leaves nothing of a mesh" if attribute.name == "scale" and 0 in numbers else ""


def amiss_in_range(tag: str, low: float, high: float) -> str:
    """What is wrong with `min` and `max` of a node with this tag; "" if nothing is wrong."""
    if tag != "laser":
        return f"`min` is {low:g}, more than `max`, which is {high:g}" if high < low else ""
    if low < 0.0 or high < 0.0:
        return f"`{'min' if low < 0.0 else 'max'}` is negative"
    is_empty = 0.0 < high <= low  # if `max` is 0, the laser sees nothing
    return f"`min` is {low:g}, not less than `max`, which is {high:g}" if is_empty else ""


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
