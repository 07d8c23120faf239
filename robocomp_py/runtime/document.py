"""What was configured, and by whom: nested tables, each value with the place it came from."""

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
    renamed: tuple[Renamed, ...] = ()
    """The keys that were written under an older name."""
    params: ParameterSet | None = None
    """The parameters of the component it is for, if it is known."""
    passed_on: bool = False
    """Whether the component's own code is given all that is in it, whatever that is."""
    notes: tuple[Note, ...] = ()
    """What became of the lines of a file in another form; a file in our form needs none."""
    complete: Callable[[Document, Component, str], None] | None = None
    """Adds what such a file says of ports and can be told only when everything else is set: see `settings.settle`."""
    peers: Mapping[str, str] = field(default_factory=dict)
    """Where such a file says that the peer of a port is, by the name of the port in lower case."""

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
    """What became of one line of a file in another form."""

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
    undeclared: bool = False
    """Whether it sets none because the component declares no parameters: code that looks at everything is given it."""


class NotToml(ConfigurationError):
    """A text is no TOML. `offset` is where it stops being one."""

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
"""Characters of a line that is shown."""


def _quoted(text: str, offset: int) -> str:
    """How to write a text that lacks its quotes; nothing if another value is meant."""
    found = re.compile(r"[^\W\d][^\n\"'#,\]}\\]*|[/.~][^\n\"'#,\]}\\]*").match(text, offset)
    word = found[0].strip() if found else ""
    if word.lower() in ("true", "false"):
        return f"did you mean `{word.lower()}`?"
    return f'text needs quotes: "{word}"' if word and "=" not in word else ""


def parsed(text: str, path: Path) -> dict[str, Any]:
    """What a TOML text says. Raises NotToml with the place if it is none."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as exc:
        found = re.search(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", str(exc))
        message = found[1] if found else str(exc)
        place = (int(found[2]), int(found[3])) if found and found[2] else None
        raise NotToml(path, text, _plainly(message, text, place), place) from exc
    except RecursionError as exc:
        raise NotToml(path, text, "nested too deeply", None) from exc
    except ValueError as exc:  # Python reads no number of thousands of digits
        raise NotToml(path, text, str(exc).partition(":")[0], None) from exc


def _plainly(message: str, text: str, place: tuple[int, int] | None) -> str:
    """What tomllib says of a key that is set twice, with the name of the key."""
    if message == "Cannot overwrite a value" and place:
        key = text.split("\n")[place[0] - 1].partition("=")[0].strip()
        return f"`{key}` has a value already"
    twice = re.fullmatch(r"Cannot declare \((.*?),?\) twice", message)
    return (
        f"the table `{'.'.join(re.findall(chr(39) + r'(.*?)' + chr(39), twice[1]))}` is there already"
        if twice
        else message
    )


def has_sections(text: str) -> bool:
    """Whether there are tables in a text, as in TOML; lists of properties have none."""
    return re.search(r"^[ \t]*\[", text, re.MULTILINE) is not None


def put(data: dict[str, Any], key: Key, value: Any) -> None:
    """Set a key below tables that are made if they are missing; nothing, if something else stands in the way."""
    table: Any = data
    for part, _ in pairwise(key):
        table = table.setdefault(part, {}) if isinstance(table, dict) else None
    if isinstance(table, dict):
        table[key[-1]] = value
