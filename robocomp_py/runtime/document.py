"""What was configured, and by whom: nested tables, each value with the place it came from."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from ..contract.parameters import Complaint, Key, ParameterSet
from ..errors import ConfigurationError
from .toml_places import Spot, locate

SECTIONS = ("Proxies", "Endpoints", "Period", "Ice", "Agent")
"""Tables of which a TOML file of 2025 has at least one."""


UNDECLARED = "the component has no parameters (params in its .cdsl)"
"""Why a key of a file of RoboComp's sets nothing."""


@dataclass
class Document:
    """Nested tables, and where each came from."""

    data: dict[str, Any] = field(default_factory=dict)
    path: Path | None = None
    text: str = ""
    overrides: list[tuple[Key, str]] = field(default_factory=list)
    """What was set over the file, in that order, and who says so: `--set params.max_speed=1`."""
    spots: Mapping[Key, Spot] | None = None
    """Where in the text each key stands; None as long as nobody has asked."""
    complaints: tuple[Complaint, ...] = ()
    """What was wrong already when it was read."""
    params: ParameterSet | None = None
    """The parameters of the component it is for, if it is known."""
    passed_on: bool = False
    """Whether the component's own code is given all that is in it, whatever that is."""
    notes: tuple[Note, ...] = ()
    """What became of the lines of a file of RoboComp's own; a file in our form needs none."""
    of_ice: tuple[OfIce, ...] = ()
    """What such a file says for Ice, which has an effect on ports that go over it: see `iceports`."""

    def place(self, key: Key) -> str:
        """`etc/config.toml:12`, or the `--set` that gave it."""
        if origin := self.overridden(key):
            return origin
        return f"{self.path}:{self.line(key)}" if self.path else "configuration"

    def overridden(self, key: Key) -> str:
        """Who set a key, or something inside of it, over the file; "" if nobody did."""
        for given, origin in reversed(self.overrides):
            if given == key[: len(given)] or key == given[: len(key)]:
                return origin
        return ""

    def line(self, key: Key) -> int:
        """The line of the file at which a key stands, or what is nearest above it."""
        spot = self.spot(key)
        return self.text.count("\n", 0, spot.key[0]) + 1 if spot else 1

    def spot(self, key: Key) -> Spot | None:
        """Where in the text a key stands, or the nearest table around it; None if the text has neither."""
        if self.spots is None:
            self.spots = locate(self.text)
        for length in range(len(key), 0, -1):
            if key[:length] in self.spots:
                return self.spots[key[:length]]
        return None

    def says(self, key: Key) -> bool:
        """Whether exactly this key is in the file."""
        self.spot(key)
        return key in (self.spots or {})


@dataclass(frozen=True)
class Note:
    """What became of one line of a file that was written for RoboComp."""

    key: str
    """As it is written there."""
    line: int
    became: Key = ()
    """The key of ours that it sets; () if it sets none."""
    why: str = ""
    """Why it sets none, for people."""
    understood: bool = True
    """Whether it is known what it means, which may be nothing here."""
    spot: Spot | None = None


@dataclass(frozen=True)
class OfIce:
    """A line of a file that was written for RoboComp, which tells Ice something."""

    kind: OfIceKind
    name: str
    """Whom it is about: an interface, or the name of a property without its `Ice.`."""
    value: str
    note: Note
    """What is said of it as long as it has no effect."""


class OfIceKind(StrEnum):
    PROXY = "proxy"
    ENDPOINTS = "endpoints"
    TOPIC = "topic"
    PREFIX = "prefix"
    STORM = "storm"
    PROPERTY = "property"


class NotToml(ConfigurationError):
    """A text is no TOML. `offset` is where it stops being one."""

    def __init__(self, path: Path, text: str, reason: str, place: tuple[int, int] | None) -> None:
        starts = [0, *(found.end() for found in re.finditer("\n", text))]
        line, column = place or (len(starts), 0)
        self.reason = f"{reason[:1].lower()}{reason[1:]}"
        self.offset = starts[line - 1] + column - 1 if place else len(text)
        super().__init__(f"{path}:{line}{f':{column}' if place else ''}: {self.reason}")


def parsed(text: str, path: Path) -> dict[str, Any]:
    """What a TOML text says. Raises NotToml with the place if it is none."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as exc:
        found = re.search(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", str(exc))
        message = found[1] if found else str(exc)
        place = (int(found[2]), int(found[3])) if found and found[2] else None
        raise NotToml(path, text, message, place) from exc
    except RecursionError as exc:
        raise NotToml(path, text, "nested too deeply", None) from exc
    except ValueError as exc:  # Python reads no number of thousands of digits
        raise NotToml(path, text, str(exc).partition(":")[0], None) from exc


def has_sections(text: str) -> bool:
    """Whether there are tables in a text, as in TOML; Ice's properties have none."""
    return re.search(r"^[ \t]*\[", text, re.MULTILINE) is not None


def is_of_2025(data: Mapping[str, Any]) -> bool:
    """Whether the tables of a TOML file are RoboComp's and not ours."""
    ours = any(isinstance(data.get(name), dict) for name in ("component", "params", "ports", "transports"))
    return not ours and any(isinstance(data.get(name), dict) for name in SECTIONS)
