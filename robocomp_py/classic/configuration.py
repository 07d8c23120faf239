"""The plug-in that reads RoboComp's own configuration files as documents of ours.

    classic   LaserProxy = laser:tcp -p 10003 # …     Ice's properties: a key, a value without a type, `#` anywhere
    2025      Period.Compute = 100                    dotted keys with values as in TOML, some in quotes
              [Period]  Compute = 100                 or sections: a TOML file

`Period.Compute` (ms) becomes `component.period` (s). Ice's addresses, topics and settings apply to ports over Ice (see
`icelines`); for other middlewares they have no effect, which a note says. Every other key is a parameter, found by its
name: `Robot.Speed` is the parameter `Robot_Speed`, or `Speed`. Lists of parameters can only be set in our own form.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from ..contract.parameters import Key, Parameter, ParameterSet
from ..runtime.document import Document, Note, has_sections, parsed
from ..runtime.toml_places import Range, Spot, locate
from . import icelines
from .icelines import OfIce, OfIceKind
from .workers.kind import accepts as is_existing

_UNDECLARED = "a parameter, and the component has none (params in its .cdsl)"


SECTIONS = ("Proxies", "Endpoints", "Period", "Ice", "Agent")
"""Names of tables; a TOML file of 2025 has at least one of them."""


def find(folder: Path) -> Path | None:
    """The classic configuration file to read. Without RoboComp's generator, `etc/config.toml` takes precedence.

    In a component of RoboComp's generator, `etc/config.toml` is the user's own file.
    """
    path = folder / "etc" / "config"
    counts = is_existing(folder) or not path.with_name("config.toml").exists()
    return path if counts and path.is_file() else None


def accepts(path: Path, text: str) -> bool:
    """Whether a file has RoboComp's form: Ice's properties, or a TOML file of 2025."""
    if path.suffix == ".toml" or has_sections(text):
        return is_of_2025(parsed(text, path))
    entries, notes = _lines(text)
    return bool(entries) or not notes


def is_of_2025(data: Mapping[str, Any]) -> bool:
    """Whether a TOML file has RoboComp's tables instead of ours."""
    ours = any(isinstance(data.get(name), dict) for name in ("component", "params", "ports", "transports"))
    return not ours and any(isinstance(data.get(name), dict) for name in SECTIONS)


def read(text: str, path: Path, params: ParameterSet, topics: Collection[str]) -> Document:
    """Read a file of RoboComp's, classic or of 2025, as a document of ours; notes report the effect of each line.

    Values have the types that the parameters of the component give them, and only declared keys are taken.
    `topics` are the interfaces it publishes and subscribes to.
    """
    entries, notes = (_entries_of(parsed(text, path), text), []) if has_sections(text) else _lines(text)
    reading = _Reading(Document(path=path, text=text, spots={}, params=params), params, notes, topics)
    reading.take(entries)
    return reading.document


def as_written(text: str, path: Path) -> list[tuple[tuple[str, ...], str, Any]]:
    """Every key of RoboComp's file in its parts, with its value as text, and with the type it seems to have.

    The last line with a key counts. Raises ConfigurationError.
    """
    entries = _entries_of(parsed(text, path), text) if has_sections(text) else _lines(text)[0]
    last = {entry.names: entry for entry in entries}
    return [(names, str(entry.value), _guessed(entry)) for names, entry in last.items()]


@dataclass(frozen=True)
class _Entry:
    names: tuple[str, ...]
    value: Any
    spot: Spot
    typed: bool = False
    """Whether the value has its type; otherwise it is a text that may stand for a number."""

    @property
    def key(self) -> str:
        return ".".join(self.names)

    @property
    def folded(self) -> str:
        """The possible name of a parameter, in lower case."""
        return _folded(self.key)


def _folded(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9]", "_", name).lower()


# The two formats.


def _entries_of(data: Mapping[str, Any], text: str) -> list[_Entry]:
    spots = locate(text)

    def visit(table: Mapping[str, Any], at: Key) -> Iterator[_Entry]:
        for name, value in table.items():
            if isinstance(value, dict) and value:
                yield from visit(value, (*at, name))
            else:
                yield _Entry(tuple(map(str, (*at, name))), value, spots[(*at, name)], typed=True)

    return list(visit(data, ()))


def _lines(text: str) -> tuple[list[_Entry], list[Note]]:
    """The properties of Ice in a configuration, and notes on all other lines."""
    entries, notes = [], []
    start = 0
    for number, line in enumerate(text.split("\n"), 1):
        found = _PROPERTY.match(line)
        if found and found[1].strip():
            entries.append(_property(found, start))
        elif line.strip() and not line.lstrip().startswith("#"):
            spot = Spot(*[(start + len(line) - len(line.lstrip()), start + len(line.rstrip()))] * 2)
            notes.append(Note(line.strip(), number, (), "no `key = value`; a comment begins with #", False, spot))
        start += len(line) + 1
    return entries, notes


_PROPERTY = re.compile(r"""((?:\\.|[^\\=#])*)=[ \t]*("[^"]*"(?=\s*(?:#|$))|(?:\\.|[^\\#])*)""")
"""A key, and a value up to a comment; a backslash escapes `#` and `=`."""


def _property(found: re.Match[str], start: int) -> _Entry:
    (key, key_spot), (value, value_spot) = (_stripped(found, group, start) for group in (1, 2))
    quoted = len(value) > 1 and value[0] == value[-1] == '"'
    text = value[1:-1] if quoted else re.sub(r"\\([#=\\ ])", r"\1", value)
    names = tuple(re.sub(r"\\(.)", r"\1", key).split("."))
    return _Entry(names, text, Spot(key_spot, value_spot), typed=quoted)


def _stripped(found: re.Match[str], group: int, start: int) -> tuple[str, Range]:
    """A part of a line without surrounding blanks, and its position in the text."""
    text = found[group]
    begin = start + found.start(group) + len(text) - len(text.lstrip())
    return text.strip(), (begin, begin + len(text.strip()))


# The meaning of entries.


class _Reading:
    """Puts entries into a document."""

    def __init__(self, document: Document, params: ParameterSet, notes: list[Note], topics: Collection[str]) -> None:
        self.document, self._params = document, params
        self._notes, self._spots = notes, dict[Key, Spot]()
        self._topics = {f"{topic}Topic" for topic in topics}
        self._of_ice: list[OfIce] = []

    def take(self, entries: Sequence[_Entry]) -> None:
        last = {entry.key: entry for entry in entries}
        for entry in entries:
            if last[entry.key] is not entry:
                line = self._line(last[entry.key])
                self._note(entry, why=f"set again in line {line}, which counts")
        self._declared([entry for entry in last.values() if not self._take_known(entry)], self._params)
        self.document.spots = self._spots
        icelines.add(self.document, self._of_ice)
        self.document.notes = tuple(sorted(self._notes, key=lambda note: note.line))

    def _take_known(self, entry: _Entry) -> bool:
        """Handle a key with a fixed meaning, unless a parameter has its name."""
        if _find(self._params, entry):
            return False
        if entry.folded == "period_compute":
            self._take_period(entry)
            return True
        if self._take_of_ice(entry):
            return True
        why = _of_robocomp(entry)
        if why:
            self._note(entry, why=why)
        return bool(why)

    def _take_of_ice(self, entry: _Entry) -> bool:
        written = f"{entry.key}={entry.value}"
        matches = ((re.fullmatch(pattern, written, re.DOTALL), kind, why) for kind, pattern, why in _OF_ICE)
        match, kind, why = next((each for each in matches if each[0]), (None, OfIceKind.TOPIC, _TOPIC))
        if not match and entry.key not in self._topics:
            return False
        name = "".join(filter(None, match.groups())) if match else entry.key.removesuffix("Topic")
        self._note(entry, why=why)
        self._of_ice.append(OfIce(kind, name, str(entry.value), self._notes[-1]))
        return True

    def _take_period(self, entry: _Entry) -> None:
        value = _guessed(entry)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        self._put(entry, ("component", "period"), value / 1000 if number else value)

    def _declared(self, entries: Sequence[_Entry], params: ParameterSet) -> None:
        """Put entries into the parameters that the PDSL declares."""
        for entry in entries:
            parameter = _find(params, entry)
            if parameter:
                self._put(entry, ("params", parameter.name), _typed(entry, parameter))
            else:
                self._undeclared(entry, params)

    def _undeclared(self, entry: _Entry, params: ParameterSet) -> None:
        if params.parameters or params.lists:
            self._put(entry, ("params", entry.key), entry.value)
        else:
            self._note(entry, why=_UNDECLARED, undeclared=True)

    def _put(self, entry: _Entry, key: Key, value: Any) -> None:
        table: Any = self.document.data
        for part, following in pairwise(key):
            empty: Any = [] if isinstance(following, int) else {}
            table = table.setdefault(part, empty)
        table[key[-1]] = value
        for length in range(1, len(key) + 1):
            self._spots.setdefault(key[:length], entry.spot)
        self._note(entry, became=key)

    def _note(
        self, entry: _Entry, became: Key = (), why: str = "", *, understood: bool = True, undeclared: bool = False
    ) -> None:
        self._notes.append(Note(entry.key, self._line(entry), became, why, understood, entry.spot, undeclared))

    def _line(self, entry: _Entry) -> int:
        return self.document.text.count("\n", 0, entry.spot.key[0]) + 1


def _of_robocomp(entry: _Entry) -> str:
    """Why a known key of RoboComp has no effect here; "" if it may be a parameter."""
    written = f"{entry.key}={entry.value}"
    return next((why for pattern, why in _WITHOUT_EFFECT if re.fullmatch(pattern, written, re.DOTALL)), "")


_TOPIC = "the name of a topic of IceStorm"
_OF_ICE = (
    (OfIceKind.STORM, r"(?:Proxies\.)?TopicManager(?:\.\w+|Proxy)?=.*", "where the topics of IceStorm are managed"),
    (OfIceKind.PROPERTY, r"Ice\.([^=]*)=.*", "a setting of Ice"),
    (OfIceKind.PREFIX, r"(?:Endpoints|Proxies)\.(\w*)Prefix=.*", "the prefix of a topic of IceStorm"),
    (OfIceKind.ENDPOINTS, r"(?:Endpoints\.(\w+)|([\w.]+)\.Endpoints)=.*", "where Ice serves an interface"),
    (
        OfIceKind.PROXY,
        r"(?:Proxies\.(\w+)|(\w*)Proxy(\d*)|(\w+)\.Proxy)=.*",
        "where Ice finds an interface; here a deployment, or `from`, says so",
    ),
    (OfIceKind.TOPIC, r"(\w+?)(?:Topic)?=\1(?:Topic)?", _TOPIC),
)
"""Patterns of `key=value` for Ice's settings; the groups name the interface or property."""

_WITHOUT_EFFECT = (
    (r"(IceStorm|IceGrid|IceSSL|Glacier2)\..*", "a setting of Ice"),
    (r"\w+\.ThreadPool\..*", "a setting of Ice"),
    (r"Period\.Emergency=.*", "`emergency` is called every period, too"),
    (r"Component\.Debug\..*", 'how much is logged; here: component.log = "debug"'),
    (r"InnerModelPath=.*", "the path of an inner model, which is not loaded"),
    (
        r"(Agent|ViewAgent)\..*|agent_(id|name)=.*|(tree|graph|2d|3d)_view=.*",
        "a setting of an agent of the shared graph",
    ),
)


# Parameters that are declared.


def _find(params: ParameterSet, entry: _Entry) -> Parameter | None:
    """The parameter of a key: by its whole name, otherwise by its last part."""
    by_name = {_folded(each.name): each for each in params.parameters}
    return by_name.get(entry.folded) or by_name.get(_folded(entry.names[-1]))


# Values.


def _guessed(entry: _Entry) -> Any:
    """The value with the type that it seems to have."""
    if entry.typed and not isinstance(entry.value, str):
        return entry.value
    text = str(entry.value)
    if entry.typed and entry.folded != "period_compute":
        return text
    if text.lower() in _TRUTH:
        return _TRUTH[text.lower()]
    if re.fullmatch(r"[+-]?(0|[1-9]\d{0,17})", text):  # longer ones are names
        return int(text)
    if re.fullmatch(r"[+-]?(\d+\.\d*|\.\d+|\d+(?=[eE]))([eE][+-]?\d+)?", text):
        return float(text)
    return text


def _typed(entry: _Entry, parameter: Parameter) -> Any:
    """The value converted to its parameter's type; unchanged if that fails."""
    return parameter.read(entry.value) if isinstance(entry.value, str) else entry.value


_TRUTH = {"true": True, "false": False}
