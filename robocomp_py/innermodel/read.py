"""Reads InnerModel files: bytes become elements, each with its place, and a list of all that is wrong.

Unknown tags and attributes, children where there may be none, and missing or repeated ids are errors. What RoboComp's
users have in working files, such as a size with a minus, is a warning.
"""

from __future__ import annotations

import bisect
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from xml.parsers import expat

from ..errors import RobocompError
from ..spelling import closest
from .nodes import INCLUDE, MOST_DEPTH, ROOT, TAGS, Attribute, Kind, Tag, Value
from .numbers import amiss, is_number, remedy

MOST_BYTES = 4 * 1024 * 1024
"""Octets of a file; the largest known one has 60,000."""

MOST_NODES = 100_000
"""Nodes of a model with all files that it includes."""

MOST_INCLUDES = 16
"""The longest chain of files that include one another."""

ROOT_ID = "root"
"""The id of the root, which no element may have."""


def number_of(value: Value) -> float:
    """The value of an attribute that has one number. Raises TypeError for any other."""
    if isinstance(value, (str, tuple)):
        raise TypeError(f"{value!r} is no number")
    return float(value)


def numbers_of(value: Value) -> tuple[float, ...]:
    """The value of an attribute that has one or several numbers."""
    return value if isinstance(value, tuple) else (number_of(value),)


def three_of(values: Mapping[str, Value], kind: str) -> tuple[float, float, float]:
    """The values of three attributes: of `tx`, `ty` and `tz`, if the kind is `t`. A missing one is 0."""
    x, y, z = (number_of(values.get(f"{kind}{axis}", 0.0)) for axis in "xyz")
    return x, y, z


ReadFile = Callable[[Path], bytes]


def read_file(path: Path) -> bytes:
    """The bytes of a file; of a file that is too large, only enough to see that. Raises OSError."""
    if not path.is_file():
        raise OSError("it is a folder" if path.is_dir() else "there is no such file")
    with path.open("rb") as file:
        return file.read(MOST_BYTES + 1)


@dataclass(frozen=True, slots=True)
class Place:
    """From `start` to before `end` in the bytes of a file. Lines and columns count from 1."""

    path: Path
    start: int
    end: int
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.path}:{self.line}:{self.column}"


@dataclass(frozen=True, slots=True)
class Problem:
    """Something wrong in a file. `code` is a stable slug; `hint` is what may be meant."""

    code: str
    message: str
    place: Place
    hint: str = ""
    is_error: bool = True
    related: tuple[tuple[str, Place], ...] = ()

    def __str__(self) -> str:
        severity = "error" if self.is_error else "warning"
        lines = [f"{self.place}: {severity}[{self.code}]: {self.message}", *([f"    {self.hint}"] if self.hint else [])]
        lines += [f"  {place}: {text}" for text, place in self.related]
        return "\n".join(lines)


class InnerModelError(RobocompError, ValueError):
    """A model, or an edit of one, is wrong. `problems` are those of its files; an edit has none.

    `node` is the node that is wrong, if a program can find it by that.
    """

    def __init__(self, message: str, problems: Sequence[Problem] = (), *, node: str = "") -> None:
        super().__init__(message)
        self.problems = tuple(problems)
        self.node = node


@dataclass(slots=True, eq=False)
class Element:
    """A tag of a file with its values, defaults included.

    `written` are the values that the file has, and `spans` are their places, without the quotes.
    """

    tag: Tag
    values: dict[str, Value]
    written: dict[str, Value]
    spans: dict[str, tuple[int, int]]
    document: Document
    place: Place
    """Of the start tag."""
    end: int = 0
    """Where the element ends, in the bytes of its file."""
    inner_end: int = 0
    """Where its end tag begins; the same as `end` for a tag like `<laser/>`."""
    parts: list[Element] = field(default_factory=list)
    """The elements that its file has in it."""
    children: list[Element] = field(default_factory=list)
    """The same, with those of included files in place of the tags that include them."""

    @property
    def id(self) -> str:
        return str(self.values.get("id", ""))

    @property
    def is_closed(self) -> bool:
        """Whether it is written like `<laser/>`."""
        return self.inner_end == self.end


@dataclass(slots=True, eq=False)
class Document:
    """A file and its elements."""

    path: Path
    data: bytes
    root: Element | None = None
    encoding: str = "utf-8"

    lines: list[int] = field(default_factory=list)
    """Where lines begin; made when a place is asked for."""

    def place(self, start: int, end: int) -> Place:
        if not self.lines:
            self.lines = [0, *(found.end() for found in re.finditer(b"\n", self.data))]
        line = bisect.bisect_right(self.lines, start)
        begin = self.lines[line - 1]
        return Place(self.path, start, end, line, len(self.data[begin:start].decode("utf-8", "replace")) + 1)


@dataclass(frozen=True, slots=True)
class Model:
    """What a file and the files that it includes say."""

    documents: tuple[Document, ...]
    """The file itself first."""
    elements: tuple[Element, ...]
    """Those below the root; the elements of included files stand where they are included."""
    problems: tuple[Problem, ...]

    @property
    def errors(self) -> list[Problem]:
        return [each for each in self.problems if each.is_error]


def read(path: Path, *, prefixes: Mapping[str, Path] | None = None, reading: ReadFile = read_file) -> Model:
    """Read a file and all that it includes. Never raises for what is in the files: see `problems`.

    Paths in files are relative to the file. If nothing is there, the start of a path is replaced by `prefixes`, since
    many files name absolute paths of another machine: `{"/home/robocomp/robocomp": Path("~/robocomp")}`.
    """
    reader = _Reader(prefixes or {}, reading)
    elements = reader.file(path, ())
    return Model(tuple(reader.documents), tuple(elements), tuple(reader.problems))


def found_file(written: str, folder: Path, prefixes: Mapping[str, Path]) -> Path | None:
    """The file that a path in a file of this folder means; None if no such file exists."""
    if not written or not written.isprintable():
        return None
    candidates = [folder / written]
    for prefix, instead in prefixes.items():
        if PurePosixPath(written).is_relative_to(prefix):
            candidates.append(instead.expanduser() / PurePosixPath(written).relative_to(prefix))
    return next((each for each in candidates if _is_file(each)), None)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long
        return False


class _Reader:
    """Reads a file and those that it includes, and collects what is wrong."""

    def __init__(self, prefixes: Mapping[str, Path], reading: ReadFile) -> None:
        self._prefixes, self._reading = prefixes, reading
        self.documents: list[Document] = []
        self.problems: list[Problem] = []
        self._ids: dict[str, Place] = {}
        self._nodes = 0

    def file(self, path: Path, chain: tuple[Path, ...]) -> list[Element]:
        """The elements below the root of a file. `chain` are the files that include it, one another."""
        document = Document(path, b"")
        try:
            document.data = self._reading(path)
        except OSError as exc:
            self.error("unreadable", f"the file cannot be read: {exc.strerror or exc}", document.place(0, 0))
            return []
        self.documents.append(document)
        if len(document.data) > MOST_BYTES:
            most = MOST_BYTES // (1024 * 1024)
            self.error("too-large", f"the file has more than {most} MB", document.place(0, 0))
            return []
        _Parser(document, self).parse()
        chain = (*chain, _real(path))
        parts = document.root.parts if document.root else []
        return [element for part in parts for element in self._checked(part, document, chain)]

    def _checked(self, element: Element, document: Document, chain: tuple[Path, ...]) -> list[Element]:
        """The element with its children, or those of the file that it includes."""
        if element.tag.name == INCLUDE:
            return self._included(element, document, chain)
        self._nodes += 1
        if self._nodes == MOST_NODES + 1:
            self.error("too-large", f"the model has more than {MOST_NODES} nodes", element.place)
        if self._nodes > MOST_NODES:
            return []
        self._check_id(element)
        for child in element.parts:
            element.children += self._checked(child, document, chain)
        return [element]

    def _included(self, element: Element, document: Document, chain: tuple[Path, ...]) -> list[Element]:
        written = str(element.values["path"])
        found = found_file(written, document.path.parent, self._prefixes)
        if found is None and written:
            self.warning("missing-include", f"there is no file `{written}`; its nodes are left out", element.place)
        if found is None:
            return []
        if _real(found) in chain:
            self.error("cyclic-include", f"`{written}` includes itself", element.place)
            return []
        if len(chain) >= MOST_INCLUDES:
            self.error("too-deep", f"more than {MOST_INCLUDES} files include one another", element.place)
            return []
        return self.file(found, chain)

    def _check_id(self, element: Element) -> None:
        name, span = element.id, element.spans.get("id")
        place = element.document.place(*span) if span else element.place
        if not name.strip():
            self.error("missing-id", f"<{element.tag.name}> has no `id`", element.place)
        elif not name.isprintable():
            self.error("wrong-value", "an `id` has characters that cannot be printed", place)
        elif name == ROOT_ID:
            self.error("repeated-id", f"`{ROOT_ID}` is the id of the root", place)
        elif name in self._ids:
            first = ("first used here", self._ids[name])
            self.error("repeated-id", f"`{name}` is used twice", place, related=(first,))
        else:
            self._ids[name] = place

    def error(
        self, code: str, message: str, place: Place, hint: str = "", related: tuple[tuple[str, Place], ...] = ()
    ) -> None:
        self.problems.append(Problem(code, message, place, hint, related=related))

    def warning(self, code: str, message: str, place: Place, hint: str = "") -> None:
        self.problems.append(Problem(code, message, place, hint, is_error=False))


def _real(path: Path) -> Path:
    try:
        return path.resolve()
    except OSError:  # a circle of links
        return path


_ATTRIBUTE = re.compile(rb"""([^\s=<>/"']+)\s*=\s*("[^"]*"|'[^']*')""")
"""An attribute of a start tag that is well-formed."""

_FOREIGN = dict.fromkeys(("robot", "mujoco"), "`rc sim import` makes a scene of URDF and MJCF")
"""Remedies for roots of other formats."""

_UNKNOWN = Tag("", "", {}, has_children=True)
"""The tag of an element that is not known, so that its children are read, too."""


class _Parser:
    """Makes the elements of one file."""

    def __init__(self, document: Document, reader: _Reader) -> None:
        self._document, self._reader = document, reader
        self._open: list[Element] = []
        self._is_given_up = False
        self._parser = parser = expat.ParserCreate()
        parser.ordered_attributes = True
        parser.StartElementHandler = self._begin
        parser.EndElementHandler = self._finish
        parser.XmlDeclHandler = self._declare
        parser.StartDoctypeDeclHandler = self._refuse_doctype
        parser.CharacterDataHandler = self._text

    def parse(self) -> None:
        data = self._document.data
        if data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data[:4]:
            self._error("not-utf8", "the file is UTF-16", 0, 0, hint="save it as UTF-8")
            return
        try:
            self._parser.Parse(data, True)
        except expat.ExpatError as exc:
            if not self._is_given_up:
                at = max(0, min(self._parser.ErrorByteIndex, len(data)))
                self._error(
                    "syntax", f"this is not XML: {expat.ErrorString(exc.code)}", at, at + 1, self._remedy(exc.code)
                )
        except _GivenUp:
            pass  # the reader has the reason

    def _remedy(self, code: int) -> str:
        if code == _MISMATCHED and self._open:
            last = self._open[-1]
            return f"<{last.tag.name or '…'}> of line {last.place.line} is open"
        return ""

    def _begin(self, name: str, pairs: Sequence[str]) -> None:
        start = self._parser.CurrentByteIndex
        end = _end_of_tag(self._document.data, start)
        place = self._document.place(start, end)
        tag = self._tag_of(name, place)
        spans = _spans(self._document.data, start, end)
        element = Element(tag, {}, {}, spans, self._document, place)
        if len(self._open) >= MOST_DEPTH:
            self._give_up("too-deep", f"elements are nested more than {MOST_DEPTH} deep", place)
        if tag is not _UNKNOWN:
            _Values(element, self._reader).take(dict(zip(pairs[::2], pairs[1::2], strict=True)))
        if not self._open:
            self._document.root = element
        else:
            above = self._open[-1]
            if not above.tag.has_children:
                self._reader.error("no-children", f"<{above.tag.name}> has no children", place, _where_to(above))
            above.parts.append(element)
        self._open.append(element)

    def _tag_of(self, name: str, place: Place) -> Tag:
        lower = name.lower()
        if not self._open:
            if lower != ROOT:
                message = f"the root is <{name}>; the root of an InnerModel is <innerModel>"
                self._give_up("foreign-root", message, place, _FOREIGN.get(lower, ""))
            return TAGS[ROOT]
        if lower == ROOT:
            self._reader.error("unknown-tag", "<innerModel> is the root only", place, "use <transform>, or <include>")
            return _UNKNOWN
        if lower not in TAGS:
            near = closest(lower, TAGS)
            hint = f"did you mean <{near}>?" if near else f"known: {', '.join(sorted(TAGS))}"
            self._reader.error("unknown-tag", f"unknown tag <{name}>", place, hint)
            return _UNKNOWN
        return TAGS[lower]

    def _finish(self, name: str) -> None:
        element = self._open.pop()
        data = self._document.data
        if data[element.place.end - 2 : element.place.end] == b"/>":
            element.end = element.inner_end = element.place.end
        else:
            element.inner_end = self._parser.CurrentByteIndex
            element.end = data.index(b">", element.inner_end) + 1
        if element.tag is _UNKNOWN and self._open:  # its children are still checked, as those of what it stands in
            self._open[-1].parts.remove(element)
            self._open[-1].parts += element.parts

    def _text(self, text: str) -> None:
        if text.strip() and self._open:
            start = self._parser.CurrentByteIndex + len(text) - len(text.lstrip())
            place = self._document.place(start, start + len(text.strip().encode(self._document.encoding, "replace")))
            self._reader.warning("without-effect", "text between tags has no effect", place)

    def _declare(self, _version: str, encoding: str | None, _standalone: int) -> None:
        self._document.encoding = encoding or "utf-8"

    def _refuse_doctype(self, *_: object) -> None:
        start = self._parser.CurrentByteIndex
        place = self._document.place(start, start + 1)
        self._give_up("syntax", "a DOCTYPE is not allowed", place, "remove it: a model needs none")

    def _error(self, code: str, message: str, start: int, end: int, hint: str = "") -> None:
        self._reader.error(code, message, self._document.place(start, end), hint)

    def _give_up(self, code: str, message: str, place: Place, hint: str = "") -> None:
        self._reader.error(code, message, place, hint)
        self._is_given_up = True
        self._document.root = None
        raise _GivenUp


class _GivenUp(Exception):
    """The rest of the file is not read."""


_MISMATCHED = expat.errors.codes[expat.errors.XML_ERROR_TAG_MISMATCH]


def _where_to(above: Element) -> str:
    return f"put it beside <{above.tag.name}>, or both into a <transform>"


def _end_of_tag(data: bytes, start: int) -> int:
    """The offset after the `>` of the start tag that begins here."""
    quote = 0
    for at in range(start, len(data)):
        byte = data[at]
        if quote:
            quote = 0 if byte == quote else quote
        elif byte in b"\"'":
            quote = byte
        elif byte == ord(">"):
            return at + 1
    return len(data)


def _spans(data: bytes, start: int, end: int) -> dict[str, tuple[int, int]]:
    """The places of the values of a start tag, without their quotes."""
    found = _ATTRIBUTE.finditer(data, start, end)
    return {each[1].decode("utf-8", "replace"): (each.start(2) + 1, each.end(2) - 1) for each in found}


_SHORT_NAMES = {"x": "tx", "y": "ty", "z": "tz"}
"""How the first publications about InnerModel write a translation."""


class _Values:
    """Turns the texts of the attributes of one element into values."""

    def __init__(self, element: Element, reader: _Reader) -> None:
        self._element, self._reader = element, reader

    def take(self, texts: Mapping[str, str]) -> None:
        element = self._element
        known = element.tag.attributes
        for name, text in texts.items():
            attribute = known.get(name) or self._renamed(name, texts)
            if attribute is None:
                self._unknown(name)
                continue
            element.written[attribute.name] = self._value(attribute, text, name)
            if attribute.name != name:
                element.spans[attribute.name] = element.spans[name]
        element.values = {name: element.written.get(name, each.default) for name, each in known.items()}
        is_blind = element.tag.name == "laser" and not (element.values["measures"] and element.values["max"])
        if is_blind and texts.keys() <= known.keys():  # else one of these may be misspelt
            self._warning("without-effect", "the laser sees nothing: it needs `measures`, `angle` and `max`")
        if element.tag.name == INCLUDE and not element.values["path"]:
            self._reader.error("wrong-value", "<include> has no `path`", element.place)

    def _renamed(self, name: str, texts: Mapping[str, str]) -> Attribute | None:
        instead = _SHORT_NAMES.get(name, "")
        attribute = self._element.tag.attributes.get(instead)
        if attribute is None or instead in texts:
            return None
        self._warning("read-otherwise", f"`{name}` is read as `{instead}`", name)
        return attribute

    def _unknown(self, name: str) -> None:
        tag = self._element.tag
        near = closest(name, tag.attributes)
        hint = f"did you mean `{near}`?" if near else f"known: {', '.join(tag.attributes) or 'none'}"
        self._reader.error(
            "unknown-attribute", f"<{tag.name}> has no attribute `{name}`", self._place_of_name(name), hint
        )

    def _value(self, attribute: Attribute, text: str, name: str) -> Value:
        match attribute.kind:
            case Kind.NUMBER | Kind.COUNT:
                return self._number(attribute, text.strip(), name)
            case Kind.NUMBERS:
                return self._numbers(attribute, text, name)
            case Kind.FLAG:
                return self._flag(attribute, text.strip(), name)
            case Kind.AXIS | Kind.ENGINE | Kind.RENDER:
                return self._choice(attribute, text.strip().lower(), name)
            case Kind.TEXT:
                return text

    def _flag(self, attribute: Attribute, text: str, name: str) -> bool:
        if text.lower() in ("true", "false"):
            return text.lower() == "true"
        value = self._float(attribute, text, name)
        if not math.isfinite(value):
            self._error("wrong-value", f"`{name}` is {attribute.kind.value}, not `{text}`", name)
        elif value not in (0.0, 1.0):
            message = f"`{name}` is `{text}`, which is neither 0 nor 1; it counts as {int(value > 0)}"
            self._warning("read-otherwise", message, name, f"write {attribute.kind.value}")
        return value > 0

    def _choice(self, attribute: Attribute, text: str, name: str) -> Value:
        if wrong := amiss(attribute, text, text):
            self._error("wrong-value", f"`{name}` {wrong}", name)
            return attribute.default
        return text

    def _number(self, attribute: Attribute, text: str, name: str) -> float | int:
        value = self._float(attribute, text, name)
        if wrong := amiss(attribute, value, text):
            self._error("wrong-value", f"`{name}` {wrong}", name)
            return 0
        return int(value) if attribute.kind is Kind.COUNT else value

    def _float(self, attribute: Attribute, text: str, name: str) -> float:
        if is_number(text):
            return float(text)
        lacks = "neither 0 nor 1" if attribute.kind is Kind.FLAG else "no number"
        found = f"`{text}`, which is {lacks}" if text else "empty"
        message = f"`{name}` is {found}; it counts as 0"
        self._warning("read-otherwise", message, name, remedy(attribute, text))
        return 0.0

    def _numbers(self, attribute: Attribute, text: str, name: str) -> tuple[float, ...]:
        texts = [each.strip() for each in text.split(",")]
        parts = [float(each) if is_number(each) else 0.0 for each in texts]
        if wrong := [f"`{each}`" for each in texts if not is_number(each)]:
            are = "no number; it counts" if len(wrong) == 1 else "no numbers; they count"
            has = "is" if len(texts) == 1 else "has"
            message = f"`{name}` {has} {', '.join(wrong)}, which {'is' if len(wrong) == 1 else 'are'} {are} as 0"
            self._warning("read-otherwise", message, name, remedy(attribute, text))
        if lacks := amiss(attribute, tuple(parts), text):
            self._error("wrong-value", f"`{name}` {lacks}", name)
            return (1.0,)
        if name == "size" and min(parts) < 0:
            self._warning("read-otherwise", "a size is not negative; the minus has no effect", name)
            parts = [abs(each) for each in parts]
        return tuple(parts)

    def _error(self, code: str, message: str, name: str) -> None:
        self._reader.error(code, message, self._place(name))

    def _warning(self, code: str, message: str, name: str = "", hint: str = "") -> None:
        self._reader.warning(code, message, self._place(name) if name else self._element.place, hint)

    def _place_of_name(self, name: str) -> Place:
        span, document, octets = self._element.spans.get(name), self._element.document, name.encode()
        if span is None:
            return self._element.place
        start = document.data.rindex(octets, 0, span[0])
        return document.place(start, start + len(octets))

    def _place(self, name: str) -> Place:
        span = self._element.spans.get(name)
        return self._element.document.place(*span) if span else self._element.place


def every(elements: Sequence[Element]) -> Iterator[Element]:
    """These elements and all below them, parents first."""
    waiting = list(reversed(elements))
    while waiting:
        element = waiting.pop()
        yield element
        waiting += reversed(element.children)
