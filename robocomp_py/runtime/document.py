"""A configuration before it is checked: nested tables, and the place that each value came from."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

from ..contract.component import Component
from ..contract.parameters import Complaint, Key, ParameterSet
from ..errors import ConfigurationError
from .toml_places import Spot, locate


@dataclass
class Document:
    """Nested tables, and the place that each value came from."""

    data: dict[str, Any] = field(default_factory=dict)
    path: Path | None = None
    text: str = ""
    overrides: list[tuple[Key, str]] = field(default_factory=list)
    """Keys set over those of the file, in order, each with its origin: `--set params.max_speed=1`."""
    spots: Mapping[Key, Spot] | None = None
    """The place of each key in the text; None until first needed."""
    complaints: tuple[Complaint, ...] = ()
    """Mistakes that were found while reading the file."""
    renamed: tuple[Renamed, ...] = ()
    """The keys that were written under an older name."""
    params: ParameterSet | None = None
    """The parameters of the component that the file configures, if it is known."""
    passed_on: bool = False
    """Whether the component's own code reads the parameters, whatever they are, so that they are not checked."""
    notes: tuple[Note, ...] = ()
    """How a plug-in read each line of a file in a foreign format; empty for TOML."""
    complete: Callable[[Document, Component, str], None] | None = None
    """Adds settings of ports from a foreign file that depend on all other settings: see `settings.settle`."""
    peers: Mapping[str, str] = field(default_factory=dict)
    """The addresses of peers in a foreign file, by the name of the port in lower case."""

    def place(self, key: Key) -> str:
        """`etc/config.toml:12`, or the `--set` that gave it."""
        if origin := self.overridden(key):
            return origin
        return f"{self.path}:{self.line(key)}" if self.path else "configuration"

    def overridden(self, key: Key) -> str:
        """The origin that set this key, or a key inside it, over the file; "" if the file decides."""
        for given, origin in reversed(self.overrides):
            if given == key[: len(given)] or key == given[: len(key)]:
                return origin
        return ""

    def line(self, key: Key) -> int:
        """The line of a key in the file, or of the nearest table around it."""
        spot = self.spot(key)
        return self.text.count("\n", 0, spot.key[0]) + 1 if spot else 1

    def spot(self, key: Key) -> Spot | None:
        """The place of a key in the text, or of the nearest table around it; None if the text has neither."""
        if self.spots is None:
            self.spots = locate(self.text)
        key = next((each.written for each in self.renamed if each.key == key and not each.origin), key)
        for length in range(len(key), 0, -1):
            if key[:length] in self.spots:
                return self.spots[key[:length]]
        return None

    def says(self, key: Key) -> bool:
        """Whether exactly this key is in the file."""
        self.spot(key)
        return key in (self.spots or {})


@dataclass(frozen=True)
class Renamed:
    """A key that was written under an older name, which is still accepted."""

    written: Key
    key: Key
    """The key that it sets."""
    origin: str = ""
    """The option or variable that sets it; "" for the file."""

    @property
    def message(self) -> str:
        return f"`{self.written[-1]}` is called `{self.key[-1]}` now"


@dataclass(frozen=True)
class Note:
    """How one line of a file in a foreign format was read."""

    key: str
    """The key as the file spells it."""
    line: int
    became: Key = ()
    """Our key that the line sets; () if it sets none."""
    why: str = ""
    """A message for people: why it sets none."""
    understood: bool = True
    """Whether the meaning of the line is known. A known line may still have no effect here."""
    spot: Spot | None = None
    undeclared: bool = False
    """Whether it sets none only because the component declares no parameters. Code that reads all of them gets it."""


class NotToml(ConfigurationError):
    """A text is not valid TOML. `offset` is the place of the first mistake."""

    def __init__(self, path: Path, text: str, reason: str, place: tuple[int, int] | None) -> None:
        starts = [0, *(found.end() for found in re.finditer("\n", text))]
        line, column = place or (len(starts), 0)
        self.reason = f"{reason[:1].lower()}{reason[1:]}"
        self.offset = starts[line - 1] + column - 1 if place else len(text)
        self.hint = _quoted(text, self.offset) if self.reason == "invalid value" else ""
        said = [f"{path}:{line}{f':{column}' if place else ''}: {self.reason}"]
        shown = text[starts[line - 1] :].partition("\n")[0].rstrip().replace("\t", " ")
        if place and shown.isprintable() and len(shown) <= _SHOWN:
            said += [f"    {shown}", f"    {'^':>{column}}"]
        super().__init__("\n".join([*said, f"    {self.hint}"] if self.hint else said))


_SHOWN = 160
"""Longest line, in characters, that a message quotes."""


def _quoted(text: str, offset: int) -> str:
    """A hint for a string without quotes; "" if the value was probably meant as something else."""
    found = re.compile(r"[^\W\d][^\n\"'#,\]}\\]*|[/.~][^\n\"'#,\]}\\]*").match(text, offset)
    word = found[0].strip() if found else ""
    if word.lower() in ("true", "false"):
        return f"did you mean `{word.lower()}`?"
    return f'text needs quotes: "{word}"' if word and "=" not in word else ""


def parsed(text: str, path: Path) -> dict[str, Any]:
    """The tables of a TOML text. Raises NotToml with the place of the mistake."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as exc:
        found = re.search(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", str(exc))
        message = found[1] if found else str(exc)
        place = (int(found[2]), int(found[3])) if found and found[2] else None
        raise NotToml(path, text, _plainly(message, text, place), place) from exc
    except RecursionError as exc:
        raise NotToml(path, text, "nested too deeply", None) from exc
    except ValueError as exc:  # Python refuses integers of thousands of digits
        raise NotToml(path, text, str(exc).partition(":")[0], None) from exc


def _plainly(message: str, text: str, place: tuple[int, int] | None) -> str:
    """The message of tomllib; for a key that is set twice, one that names the key."""
    if message == "Cannot overwrite a value" and place:
        key = text.split("\n")[place[0] - 1].partition("=")[0].strip()
        return f"`{key}` is set twice: keep one of them"
    twice = re.fullmatch(r"Cannot declare \((.*?),?\) twice", message)
    if not twice:
        return message
    return f"the table `{'.'.join(re.findall(chr(39) + r'(.*?)' + chr(39), twice[1]))}` is defined twice: join them"


def has_sections(text: str) -> bool:
    """Whether a text has headers of tables, as in TOML. Property lists have none."""
    return re.search(r"^[ \t]*\[", text, re.MULTILINE) is not None


def put(data: dict[str, Any], key: Key, value: Any) -> None:
    """Set a key, creating missing tables. Does nothing if a part of its path is not a table."""
    table: Any = data
    for part, _ in pairwise(key):
        table = table.setdefault(part, {}) if isinstance(table, dict) else None
    if isinstance(table, dict):
        table[key[-1]] = value
