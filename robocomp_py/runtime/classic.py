"""RoboComp's own configuration files, read as ours.

    classic   LaserProxy = laser:tcp -p 10003 # …     Ice's properties: a key, a value without a type, `#` anywhere
    2025      Period.Compute = 100                    dotted keys with values as in TOML, some in quotes
              [Period]  Compute = 100                 or sections: a TOML file

`Period.Compute` (ms) is `component.period` (s) here. Where Ice finds and serves what, its topics and its own
settings mean something to ports that go over Ice (see `iceports`), and nothing to other middlewares: they are noted.
Every other key is a parameter, found by its name:
`Robot.Speed` is the parameter `Robot_Speed`, or `Speed`. The items of a list are written side by side, and may be
counted:

    numMotors = 2             [[params.motors]]
    name_0 = left             name = "left"
    name_1 = right            [[params.motors]]
                              name = "right"

A list inside of a list has two numbers (`kp_0_1`); `motors.name_0` tells lists apart that both have a `name`; a row
(`Motors_0 = left, 3.5`) holds the values of an item in order.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

from ..contract.parameters import Complaint, Key, Parameter, ParameterList, ParameterSet
from ..errors import ConfigurationError
from .document import UNDECLARED, Document, Note, OfIce, OfIceKind, has_sections, parsed
from .toml_places import Range, Spot, locate

MOST_ITEMS = 1000
"""A number behind a key that is larger is none of an item."""


def read_classic(path: Path, params: ParameterSet | None = None, topics: Collection[str] = ()) -> Document:
    """A file of RoboComp's, classic or of 2025, as a document of ours; its notes say what became of each line.

    With the parameters of a component, values have their types, and only declared keys are taken. Without, all
    are: types and lists are what they look like. `topics` are the interfaces it publishes and subscribes to.
    Raises ConfigurationError if it cannot be read.
    """
    try:
        raw = path.read_bytes()
    except OSError as exc:
        raise ConfigurationError(f"{path}: cannot be read: {exc.strerror}") from exc
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")  # comments were written before everybody had UTF-8
    return from_text(text.replace("\r\n", "\n"), path, params, topics)


def from_text(text: str, path: Path, params: ParameterSet | None = None, topics: Collection[str] = ()) -> Document:
    """The same for a text that was read."""
    entries, notes = (_entries_of(parsed(text, path), text), []) if has_sections(text) else _lines(text)
    reading = _Reading(Document(path=path, text=text, spots={}, params=params), params, notes, topics)
    reading.take(entries)
    return reading.document


def as_written(text: str, path: Path) -> list[tuple[tuple[str, ...], str, Any]]:
    """Every key of a file of RoboComp's in its parts, with its value as text, and as what it looks like.

    What is set twice counts as it stands last. Raises ConfigurationError.
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
    """Whether the value is what it is meant to be, and not a text that may mean a number."""

    @property
    def key(self) -> str:
        return ".".join(self.names)

    @property
    def folded(self) -> str:
        """As a parameter may be called, in lower case."""
        return _folded(self.key)


def _folded(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9]", "_", name).lower()


# The two ways of writing.


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
    """The keys of Ice's properties, and what is none."""
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
"""A key, and a value up to a comment; a backslash in front of `#` and `=` takes away what they mean."""


def _property(found: re.Match[str], start: int) -> _Entry:
    (key, key_spot), (value, value_spot) = (_stripped(found, group, start) for group in (1, 2))
    quoted = len(value) > 1 and value[0] == value[-1] == '"'
    text = value[1:-1] if quoted else re.sub(r"\\([#=\\ ])", r"\1", value)
    names = tuple(re.sub(r"\\(.)", r"\1", key).split("."))
    return _Entry(names, text, Spot(key_spot, value_spot), typed=quoted)


def _stripped(found: re.Match[str], group: int, start: int) -> tuple[str, Range]:
    """A part of a line without blanks around it, and where it is in the text."""
    text = found[group]
    begin = start + found.start(group) + len(text) - len(text.lstrip())
    return text.strip(), (begin, begin + len(text.strip()))


# What it means here.


class _Reading:
    """Entries on their way into a document."""

    def __init__(
        self, document: Document, params: ParameterSet | None, notes: list[Note], topics: Collection[str]
    ) -> None:
        self.document, self._params = document, params
        self._notes, self._spots, self._complaints = notes, dict[Key, Spot](), list[Complaint]()
        self._topics = {f"{topic}Topic" for topic in topics}
        self._of_ice: list[OfIce] = []

    def take(self, entries: Sequence[_Entry]) -> None:
        last = {entry.key: entry for entry in entries}
        for entry in entries:
            if last[entry.key] is not entry:
                line = self._line(last[entry.key])
                self._note(entry, why=f"set again in line {line}, which counts")
        left = [entry for entry in last.values() if not self._take_known(entry)]
        if self._params is None:
            self._guess(left)
        else:
            self._declared(left, self._params)
        self.document.spots = self._spots
        self.document.complaints = tuple(self._complaints)
        self.document.of_ice = tuple(self._of_ice)
        self.document.notes = tuple(sorted(self._notes, key=lambda note: note.line))

    def _take_known(self, entry: _Entry) -> bool:
        """Take what has a meaning of its own, unless a parameter is called so."""
        if self._params is not None and _find(self._params, entry):
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
        """Into the parameters that a PDSL declares."""
        items = _Items(params)
        for entry in entries:
            parameter = _find(params, entry)
            if parameter:
                self._put(entry, ("params", parameter.name), _typed(entry, parameter))
            elif not items.take(entry):
                self._undeclared(entry, params)
        for key, value, entry in items.values():
            self._put(entry, ("params", *key), value)
        for complaint, entry in items.complaints:
            self._spots[complaint.key] = entry.spot
            self._note(entry, why=complaint.message, understood=False)
            self._complaints.append(complaint)

    def _undeclared(self, entry: _Entry, params: ParameterSet) -> None:
        if params.parameters or params.lists:
            self._put(entry, ("params", entry.key), entry.value)
        else:
            self._note(entry, why=UNDECLARED)

    def _guess(self, entries: Sequence[_Entry]) -> None:
        """Into parameters that are made up as they come."""
        lists = _lists_in(entries)
        for entry in entries:
            key = lists.get(entry.key, (identifier(entry.key),))
            if entry.key in lists and len(key) == 1:
                self._note(entry, why=f"how many {key[0]} there are")
            else:
                self._put(entry, ("params", *key), _guessed(entry))

    def _put(self, entry: _Entry, key: Key, value: Any) -> None:
        table: Any = self.document.data
        for part, following in pairwise(key):
            empty: Any = [] if isinstance(following, int) else {}
            if isinstance(part, int):
                table.extend({} for _ in range(part + 1 - len(table)))
                table = table[part]
            else:
                table = table.setdefault(part, empty)
        table[key[-1]] = value
        for length in range(1, len(key) + 1):
            self._spots.setdefault(key[:length], entry.spot)
        self._note(entry, became=key)

    def _note(self, entry: _Entry, became: Key = (), why: str = "", *, understood: bool = True) -> None:
        self._notes.append(Note(entry.key, self._line(entry), became, why, understood, entry.spot))

    def _line(self, entry: _Entry) -> int:
        return self.document.text.count("\n", 0, entry.spot.key[0]) + 1


def _of_robocomp(entry: _Entry) -> str:
    """Why a key that means something to RoboComp has no effect here; "" if it may be a parameter."""
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
"""What a key and its value look like that tell Ice something; the groups are whom it is about."""

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
    """The parameter that a key means: by its whole name, else by its last part."""
    by_name = {_folded(each.name): each for each in params.parameters}
    return by_name.get(entry.folded) or by_name.get(_folded(entry.names[-1]))


@dataclass
class _Items:
    """The items of the lists of a set, as their keys come in any order."""

    params: ParameterSet
    complaints: list[tuple[Complaint, _Entry]] = field(default_factory=list)
    _found: list[tuple[Key, Any, _Entry]] = field(default_factory=list)
    _counts: dict[Key, tuple[int, _Entry]] = field(default_factory=dict)
    """How many items a list has, by its key."""

    def take(self, entry: _Entry) -> bool:
        """Take a key that is one of an item's, or a count; whether it is."""
        numbered = re.fullmatch(r"(.*?)((?:_\d{1,6})*)", entry.names[-1])
        assert numbered
        base, numbers = numbered[1], [int(each) for each in numbered[2].split("_")[1:]]
        before = [_folded(re.sub(r"(_\d+)+$", "", name)) for name in entry.names[:-1]]
        found = [
            (path, parameter)
            for path in _paths(self.params)
            if len(path) == len(numbers)
            for parameter in path[-1].items.parameters
            if _folded(parameter.name) == _folded(base)
        ]
        if len(found) > 1:
            found = [each for each in found if _folded(each[0][-1].name) in before[-1:]] or found
        if len(found) > 1:
            self._complain_ambiguous(entry, [path[-1].name for path, _ in found])
        elif found:
            path, parameter = found[0]
            self._add((*_key(path, numbers), parameter.name), _typed(entry, parameter), entry)
        else:
            return self._take_row(entry, base, before, numbers) or self._take_count(entry, base, numbers)
        return True

    def _take_row(self, entry: _Entry, base: str, before: Sequence[str], numbers: Sequence[int]) -> bool:
        """`Motors_0 = left, 3.5`, or `Motors.Params_0`: the values of one item."""
        meant = {_folded(base)} | ({before[-1]} if before and base.lower() == "params" else set())
        for path in _paths(self.params):
            if len(path) == len(numbers) and _folded(path[-1].name) in meant:
                values = [each.strip() for each in str(entry.value).split(",")]
                parameters = path[-1].items.parameters
                key = _key(path, numbers)
                if len(values) > len(parameters):
                    message = f"{len(values)} values; an item of `{path[-1].name}` has {len(parameters)}"
                    self.complaints.append((Complaint(("params", *key), message, "config-item-count"), entry))
                for parameter, value in zip(parameters, values, strict=False):
                    part = _Entry(entry.names, value, entry.spot)
                    self._add((*key, parameter.name), _typed(part, parameter), entry)
                return True
        return False

    def _take_count(self, entry: _Entry, base: str, numbers: Sequence[int]) -> bool:
        counted, value = _COUNT.fullmatch(base), _guessed(entry)
        for path in _paths(self.params):
            if not counted or len(path) != len(numbers) + 1 or not _same(counted[1], path[-1].name):
                continue
            key = ("params", *_key(path, numbers))
            if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MOST_ITEMS:
                message = f"`{entry.key}` is {entry.value!r}; allowed: a number of items, at most {MOST_ITEMS}"
                self.complaints.append((Complaint(key, message, "config-item-count"), entry))
            else:
                self._counts[key[1:]] = (value, entry)
            return True
        return False

    def _add(self, key: Key, value: Any, entry: _Entry) -> None:
        if any(isinstance(part, int) and part >= MOST_ITEMS for part in key):
            message = f"`{entry.key}`: items are numbered from 0 to {MOST_ITEMS - 1}"
            self.complaints.append((Complaint(("params", *key[:1]), message, "config-item-count"), entry))
        else:
            self._found.append((key, value, entry))

    def values(self) -> Iterator[tuple[Key, Any, _Entry]]:
        """What was found, with empty items where a count says that there are more, and none behind those."""
        counted_items: list[tuple[Key, Any, _Entry]] = [
            (key, [{} for _ in range(number)], entry) for key, (number, entry) in self._counts.items()
        ]
        counted_items.sort(key=lambda each: len(each[0]))  # a list, before the lists inside of it
        for key, value, entry in (*counted_items, *self._found):
            beyond = self._beyond(key)
            if beyond:
                counted, number = beyond
                message = f"`{entry.key}` is one too many: `{counted.key}` says {number}, and the first is number 0"
                self.complaints.append((Complaint(("params", *key), message, "config-item-count"), entry))
            else:
                yield key, value, entry

    def _beyond(self, key: Key) -> tuple[_Entry, int] | None:
        """The count that an item, or one around it, is behind."""
        for position, part in enumerate(key):
            if isinstance(part, int) and key[:position] in self._counts:
                number, entry = self._counts[key[:position]]
                if part >= number:
                    return entry, number
        return None

    def _complain_ambiguous(self, entry: _Entry, lists: Sequence[str]) -> None:
        ways = " or ".join(f"`{each}.{entry.names[-1]}`" for each in lists)
        message = f"`{entry.key}` may be one of several lists; write {ways}"
        self.complaints.append((Complaint(("params", entry.key), message, "config-unknown-key"), entry))


def _paths(params: ParameterSet, above: tuple[ParameterList, ...] = ()) -> Iterator[tuple[ParameterList, ...]]:
    """Every list of a set with those around it, outermost first."""
    for each in params.lists:
        yield (*above, each)
        yield from _paths(each.items, (*above, each))


def _key(path: Sequence[ParameterList], numbers: Sequence[int]) -> Key:
    """The key of an item; of a list, if there is one number less than lists."""
    key: Key = ()
    for position, each in enumerate(path):
        key = (*key, each.name, *numbers[position : position + 1])
    return key


def _same(counted: str, name: str) -> bool:
    """Whether `numMotors` counts the list `motors`, or `motor`."""
    one, other = (_folded(each).replace("_", "").removesuffix("s") for each in (counted, name))
    return one == other


# Lists that are made up.


def _lists_in(entries: Sequence[_Entry]) -> dict[str, Key]:
    """The key below `params` of those keys that make up lists; a count has that of its list.

    A list is what is counted (`num_cameras = 2`) and numbered (`name_0`, `name_1`) under the same prefix.
    """
    found: dict[str, Key] = {}
    counts = [(entry, counted[1]) for entry in entries if (counted := _COUNT.fullmatch(entry.names[-1]))]
    per_prefix = Counter(entry.names[:-1] for entry, _ in counts)
    for entry, name in counts:
        number, prefix = _guessed(entry), entry.names[:-1]
        if isinstance(number, bool) or not isinstance(number, int):
            continue
        for other in entries:
            numbered = re.fullmatch(r"(.+?)_(\d{1,6})", other.names[-1])
            if not numbered or other.names[:-1] != prefix or int(numbered[2]) >= min(number, MOST_ITEMS):
                continue
            if per_prefix[prefix] == 1 or _same(numbered[1], name) or _same(_plural(numbered[1]), name):
                key = identifier("_".join((*prefix, name[:1].lower() + name[1:])))
                found[other.key] = (key, int(numbered[2]), identifier(numbered[1]))
                found[entry.key] = (key,)
    return found


_COUNT = re.compile(r"num_?(?:of_?)?([A-Za-z]\w*)", re.IGNORECASE)


def _plural(name: str) -> str:
    """The plural of English words that end otherwise: `axis`, `axes`."""
    return re.sub(r"is$", "es", name)


def identifier(key: str) -> str:
    """A key as the name of a parameter: `Robot.Speed` is `Robot_Speed`, and `2d_view` is `_2d_view`."""
    name = re.sub(r"\W", "_", key, flags=re.ASCII)
    return f"_{name}" if name[:1].isdigit() else name


# Values.


def _guessed(entry: _Entry) -> Any:
    """The value as what it looks like."""
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
    """The value as its parameter wants it; as it is, if it cannot be that."""
    return parameter.read(entry.value) if isinstance(entry.value, str) else entry.value


_TRUTH = {"true": True, "false": False}
