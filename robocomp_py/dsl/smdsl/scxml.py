"""SCXML to the model of SMDSL: states, regions, initial and final states, transitions.

Other elements have no effect, which is reported.

Files are read by expat, because it reports positions. Document types are refused, and with them all entities, so that
no file can grow while it is read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from ..diagnostics import Report
from ..source import Name, Source, Span
from ..syntax import MAX_CHARACTERS, MAX_NESTING
from . import model as m

_NAMESPACE = "http://www.w3.org/2005/07/scxml"
_STATES = ("state", "parallel", "final")
_ATTRIBUTES = {
    "scxml": ("initial", "name", "version"),
    "state": ("id", "initial"),
    "parallel": ("id",),
    "final": ("id",),
    "initial": (),
    "transition": ("event", "target"),
}
"""The attributes and children that are read of each element."""

_START = re.compile(r"""<[^\s/>]+(?:\s+[^\s=]+\s*=\s*(?:"[^"]*"|'[^']*'))*\s*/?>?""")


def parse(source: Source, report: Report) -> m.File | None:
    """The model of a file, without the parts that could not be read; None if nothing could."""
    root = _read(source, report)
    if root is None:
        return None
    if root.kind != "scxml":
        message = f"this is not a state machine, but `<{root.kind}>`"
        report.error("syntax", message, root.span, f'the first element is `<scxml xmlns="{_NAMESPACE}">`')
        return None
    return _Builder(source, report).file(root)


@dataclass
class _Element:
    kind: str
    span: Span
    """Its name."""
    attributes: dict[str, Name]
    children: list[_Element] = field(default_factory=list)


class _Refused(Exception):
    """A file is not read further; the message says why."""


def _read(source: Source, report: Report) -> _Element | None:
    """The SCXML elements of a file; None if it is not XML."""
    if len(source.text) > MAX_CHARACTERS:
        report.error("too-large", f"the file has more than {MAX_CHARACTERS} characters", source.span(0, 0))
        return None
    reader = _Reader(source, source.text.encode("utf-8", "surrogatepass"))
    try:
        reader.parse()
    except (_Refused, expat.ExpatError) as exc:
        message, at = str(exc), reader.here()
        if isinstance(exc, expat.ExpatError):
            message, at = f"this is not XML: {expat.ErrorString(exc.code)}", reader.at(exc.lineno, exc.offset)
        report.error("syntax", message, source.span(at, at + 1))
        return None
    return reader.root


class _Reader:
    def __init__(self, source: Source, data: bytes) -> None:
        self.root: _Element | None = None
        self._source, self._data = source, data
        self._bytes = self._characters = 0
        self._open: list[_Element] = []
        self._foreign = 0
        """The depth within foreign elements, such as an editor's."""
        self._expat = expat.ParserCreate("utf-8", " ")
        self._expat.StartElementHandler = self._start
        self._expat.EndElementHandler = self._end
        self._expat.StartDoctypeDeclHandler = self._doctype

    def parse(self) -> None:
        self._expat.Parse(self._data, True)

    def here(self) -> int:
        """The position of the parser, in characters."""
        index = max(self._bytes, self._expat.CurrentByteIndex)
        self._characters += len(self._data[self._bytes : index].decode("utf-8", "replace"))
        self._bytes = index
        return self._characters

    def at(self, line: int, column: int) -> int:
        """A position that expat reports; the last character if it is the end."""
        lines = self._source.text.splitlines(keepends=True)
        return max(0, min(sum(map(len, lines[: line - 1])) + column, len(self._source.text.rstrip()) - 1))

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        namespace, _, kind = name.rpartition(" ")
        if self._foreign or namespace not in ("", _NAMESPACE):
            self._foreign += 1
            return
        if len(self._open) >= MAX_NESTING:
            raise _Refused(f"nested deeper than {MAX_NESTING} levels")
        start = self.here()
        tag = _START.match(self._source.text, start)
        length = len(re.match(r"<[^\s/>]*", self._source.text[start:])[0])  # type: ignore[index]  # it begins so
        found = {key: self._value(key, value, start, tag) for key, value in attributes.items() if " " not in key}
        element = _Element(kind, self._source.span(start + 1, start + length), found)
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)

    def _value(self, key: str, value: str, start: int, tag: re.Match[str] | None) -> Name:
        """An attribute, at its place between the quotes."""
        end = tag.end() if tag else start
        place = re.compile(rf"\s{re.escape(key)}\s*=\s*[\"']([^\"']*)").search(self._source.text, start, end)
        return Name(value, self._source.span(*place.span(1)) if place else self._source.span(start, start + 1))

    def _end(self, name: str) -> None:
        if self._foreign:
            self._foreign -= 1
        else:
            self._open.pop()

    def _doctype(self, name: str, *others: object) -> None:
        raise _Refused("document types are not supported: remove the `<!DOCTYPE …>`")


class _Builder:
    def __init__(self, source: Source, report: Report) -> None:
        self._source, self._report = source, report

    def file(self, root: _Element) -> m.File:
        stem = re.sub(r"\W", "_", self._source.path.stem)
        name = root.attributes.get("name") or Name(stem, root.span)
        return m.File(self._source, name, tuple(self._blocks(root, None)))

    def _blocks(self, element: _Element, parent: Name | None) -> Iterator[m.Block]:
        """An element's own block, then those of its states."""
        self._check(element)
        inner = [each for each in element.children if each.kind in _STATES]
        named = [(each, name) for each in inner if (name := self._name(each))]
        parallel = element.kind == "parallel"
        yield m.Block(
            parent,
            element.span,
            tuple(m.State(name, each.kind == "final") for each, name in named),
            () if parallel else tuple(self._initial(element, [name for _, name in named])),
            tuple(each for state, name in named for each in self._transitions(state, name)),
            parallel,
        )
        for each, name in named:
            if each.kind == "parallel" or any(child.kind in _STATES for child in each.children):
                yield from self._blocks(each, name)
            else:
                self._check(each)

    def _check(self, element: _Element) -> None:
        """Warn about elements and attributes without effect."""
        for key, value in element.attributes.items():
            if key not in _ATTRIBUTES[element.kind]:
                message = f"`{key}` of `<{element.kind}>` has no effect here"
                self._report.warning("ineffective-scxml", message, value.span)
        known = ("transition",) if element.kind == "initial" else (*_STATES, "initial", "transition")
        for child in element.children:
            if child.kind in ("initial", "transition"):
                self._check(child)
            elif child.kind not in known:
                message = f"`<{child.kind}>` has no effect here"
                self._report.warning("ineffective-scxml", message, child.span, "write it in Python: in an `sm_` method")

    def _name(self, element: _Element) -> Name | None:
        name = element.attributes.get("id")
        if name is None or not name.text:
            message = f"this `<{element.kind}>` has no id, which would be the name of its method `sm_<id>`"
            self._report.error("no-id", message, element.span, f'write `<{element.kind} id="…">`')
            return None
        return name

    def _initial(self, element: _Element, states: list[Name]) -> Iterator[Name]:
        """The initial state, by the attribute, the element, or the first state."""
        given = element.attributes.get("initial")
        for child in element.children:
            if child.kind == "initial":
                for transition in child.children:
                    given = given or transition.attributes.get("target")
        if given:
            yield from self._words(given)
        else:
            yield from states[:1]

    def _words(self, name: Name) -> list[Name]:
        """The one state that an attribute names; an error if there are several."""
        words = name.text.split()
        if len(words) == 1:
            return [Name(words[0], name.span)]
        message = f"`{name}` names several states; only one can be entered this way" if words else "no state is named"
        self._report.error("several-targets", message, name.span, "name the state that is around them")
        return []

    def _transitions(self, state: _Element, source: Name) -> Iterator[m.Transition]:
        for each in state.children:
            if each.kind == "transition":
                event, target = each.attributes.get("event"), each.attributes.get("target")
                if target is None:
                    message = "a transition without a target has no effect here"
                    self._report.warning("ineffective-scxml", message, each.span, 'name one: `target="…"`')
                    continue
                if event is None:
                    message = (
                        f"a transition without an event is taken only when it is fired: `self.t_{source}_to_{target}()`"
                    )
                    self._report.warning("ineffective-scxml", message, each.span)
                for word in self._words(target):
                    yield m.Transition(source, word, tuple(event.text.split()) if event else ())
