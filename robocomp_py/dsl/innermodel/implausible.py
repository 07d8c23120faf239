"""Values that can be read, but cannot be meant. The reader takes them, as RoboComp does; here they are reported."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass

from ...innermodel.nodes import DEVICES
from ...innermodel.numbers import amiss_in_range, written
from ...innermodel.read import Element, found_file, number_of, numbers_of
from ...spelling import closest
from ...wire.names import is_segment
from ..diagnostics import Severity

_ROTATIONS = frozenset(("rx", "ry", "rz", "angle"))
_BUMPER = "bumper"
_WHOLE_TURN = 6.3
"""rad; a little more than 2 π, which many files round up."""


@dataclass(frozen=True, slots=True)
class Implausible:
    """A problem of an attribute; of the whole element if that does not have the attribute."""

    code: str
    attribute: str
    message: str
    hint: str = ""
    severity: Severity = Severity.WARNING


def implausible(element: Element) -> Iterator[Implausible]:
    """The implausible values of an element, without those of its children."""
    for check in (_limits, _rays, _lens, _turns, _size, _colour, _file, _id, _type):
        yield from check(element)


def is_colour(text: str) -> bool:
    """Whether a texture is a colour, `#rrggbb`."""
    return bool(re.fullmatch("#[0-9A-Fa-f]{6}", text))


def _limits(element: Element) -> Iterator[Implausible]:
    if not {"min", "max"} <= element.written.keys() or _negative(element):
        return
    low, high = number_of(element.written["min"]), number_of(element.written["max"])
    if text := amiss_in_range(element.tag.name, low, high):
        yield Implausible("wrong-value", "min", text, "the smaller one is `min`", Severity.ERROR)


def _negative(element: Element) -> list[str]:
    """The distances of a laser that are negative."""
    is_laser = element.tag.name == "laser"
    return [each for each in ("min", "max") if is_laser and number_of(element.values[each]) < 0.0]


def _rays(element: Element) -> Iterator[Implausible]:
    for name in _negative(element):
        yield Implausible("wrong-value", name, f"`{name}` is negative", severity=Severity.ERROR)
    if element.tag.name == "laser" and number_of(element.values["measures"]) > 1 and not element.values["angle"]:
        yield Implausible("without-effect", "angle", "all rays of the laser point ahead: `angle` is 0")


def _lens(element: Element) -> Iterator[Implausible]:
    if element.tag.name not in ("rgbd", "camera"):
        return
    if lacking := [each for each in ("width", "height", "focal") if not element.values[each]]:
        text = f"the camera sees nothing: it needs {' and '.join(f'`{each}`' for each in lacking)}"
        yield Implausible("without-effect", lacking[0], text)


def _turns(element: Element) -> Iterator[Implausible]:
    for name in _ROTATIONS & element.written.keys():
        value = number_of(element.written[name])
        if abs(value) > _WHOLE_TURN:
            meant = written(math.radians(value))
            text = f"`{name}` is in rad, and {value:g} is more than a whole turn"
            yield Implausible("in-degrees", name, text, f"did you mean `{meant}`?")


def _size(element: Element) -> Iterator[Implausible]:
    if "size" not in element.written:
        return
    numbers = numbers_of(element.written["size"])
    if numbers.count(0.0) >= max(1, len(numbers) - 1):
        text = f"nothing of the {element.tag.name} is seen: of its width, height and depth, at most one may be 0"
        yield Implausible("without-effect", "size", text)


def _colour(element: Element) -> Iterator[Implausible]:
    text = str(element.written.get("texture", ""))
    if not text.startswith("#") or is_colour(text) or found_file(text, element.document.path.parent, {}):
        return
    is_short = re.fullmatch("#[0-9A-Fa-f]{3}", text)
    meant = "#" + "".join(2 * each for each in text[1:])
    hint = f"did you mean `{meant}`?" if is_short else "write six digits of 0 to 9 and a to f, such as `#3366cc`"
    yield Implausible("wrong-colour", "texture", f"`{text}` is no colour; the {element.tag.name} is grey", hint)


def _file(element: Element) -> Iterator[Implausible]:
    if element.tag.name == "mesh" and not str(element.values["file"]).strip():
        text = "<mesh> has no `file`; a component that simulates the scene needs it"
        yield Implausible("missing-mesh", "file", text)


def _id(element: Element) -> Iterator[Implausible]:
    is_provided = element.values.get("measures") != 0 and element.values.get("width") != 0
    if element.tag.name in DEVICES and is_provided and element.id.strip() and not is_segment(element.id):
        plain = unicodedata.normalize("NFKD", element.id).encode("ascii", "ignore").decode() or element.id
        meant = re.sub("[^A-Za-z0-9_-]", "_", plain)
        meant = meant if is_segment(meant) else f"_{meant}"
        text = f"`{element.id}` cannot be the name of an instance, as a component that simulates the scene needs it"
        yield Implausible("unfit-id", "id", text, f"did you mean `{meant}`?")


def _type(element: Element) -> Iterator[Implausible]:
    text = str(element.written.get("type", "")).lower()
    if text != _BUMPER and closest(text, (_BUMPER,)):
        message = f"`type` is `{text}`, which makes it a sensor of force"
        yield Implausible("read-otherwise", "type", message, f"did you mean `{_BUMPER}`?")
