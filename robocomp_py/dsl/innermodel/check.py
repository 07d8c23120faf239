"""The problems of an InnerModel file, and of those that it includes, as diagnostics."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from ...innermodel.read import Document, Element, Place, Problem, ReadFile, every, found_file, number_of, read
from ..diagnostics import Diagnostic, Report, Severity
from ..nearby import nearby
from ..source import Source, Span
from .implausible import implausible, is_colour

ENDING = ".xml"

_BEFORE_ROOT = re.compile(r"\ufeff?(?:\s+|<!--.*?-->|<[?!][^>]*>)*", re.DOTALL)
_ROOT = re.compile(r"<innermodel(?![\w.:-])", re.IGNORECASE)
_DECLARED = re.compile(r"""\ufeff?<\?xml[^>]*?\sencoding\s*=\s*["']([\w.-]+)""")
_JOINTS = {"joint", "prismaticjoint"}
_START_AT_MOST = 4096
"""Octets of a file before its root, for comments and declarations."""


def is_innermodel(path: Path) -> bool:
    """Whether an XML file is an InnerModel. False for other XML, and for a file that cannot be read."""
    try:
        with path.open("rb") as file:
            return path.suffix.lower() == ENDING and is_root(file.read(_START_AT_MOST).decode("utf-8", "replace"))
    except OSError:
        return False


def is_root(text: str) -> bool:
    """Whether the first tag of a text is the root of an InnerModel."""
    before = _BEFORE_ROOT.match(text, 0, _START_AT_MOST)
    return bool(before and _ROOT.match(text, before.end()))


def declared_encoding(text: str) -> str:
    """The encoding that the declaration of an XML text names, if Python knows it; else UTF-8."""
    declared = _DECLARED.match(text)
    try:
        return codecs.lookup(declared[1]).name if declared else "utf-8"
    except LookupError:
        return "utf-8"


def check(path: Path, reading: ReadFile, report: Report) -> None:
    """Report what is wrong with a file and with those that it includes."""
    model = read(path, reading=reading)
    sources = {each.path: _Places(each) for each in model.documents}
    report.extend(_diagnostic(each, sources) for each in model.problems)

    def at(element: Element, attribute: str) -> Span:
        document, span = element.document, element.spans.get(attribute)
        return sources[document.path].span(document.place(*span) if span else element.place)

    read_otherwise = {(each.place.path, each.place.start) for each in model.problems}
    for element in every(model.elements):
        for problem in implausible(element):
            span = at(element, problem.attribute)
            if (element.document.path, element.spans.get(problem.attribute, (-1, -1))[0]) not in read_otherwise:
                report.extend([Diagnostic(problem.code, problem.message, span, problem.severity, problem.hint)])
    for element, first in _shared_ports(model.elements):
        text = f"port {element.values['port']} is that of `{first.id}`, too; only one of them can be served there"
        related = ((f"`{first.id}` is here", at(first, "port")),)
        report.extend([Diagnostic("repeated-port", text, at(element, "port"), Severity.WARNING, related=related)])
    for element, attribute in _lost_files(model.elements):
        written, document = element.written[attribute], element.document
        span = at(element, attribute)
        hint, message = nearby(document.path.parent / str(written), str(written)), f"there is no file `{written}`"
        if attribute == "texture":
            hint = hint or (f"did you mean `#{written}`?" if is_colour(f"#{written}") else "")
            report.warning("missing-texture", f"{message}; the plane is grey", span, hint)
        else:
            report.warning("missing-mesh", f"{message}; a component that simulates the scene needs it", span, hint)


def _shared_ports(elements: Sequence[Element]) -> Iterator[tuple[Element, Element]]:
    """Elements whose port an element before them has, with that element. Joints with one port are served together."""
    first: dict[int, Element] = {}
    for element in every(elements):
        if not (port := int(number_of(element.values.get("port", 0)))):
            continue
        before = first.setdefault(port, element)
        if before is not element and not {before.tag.name, element.tag.name} <= _JOINTS:
            yield element, before


def _lost_files(elements: Sequence[Element]) -> Iterator[tuple[Element, str]]:
    """The elements that name a file which is not there, each with the attribute that names it."""
    for element in elements:
        for attribute in ("file", "texture"):
            written = str(element.written.get(attribute, ""))
            is_used = bool(written) and not written.startswith("#") and element.tag.name != "display"
            if is_used and attribute in element.spans and not found_file(written, element.document.path.parent, {}):
                yield element, attribute
        yield from _lost_files(element.children)


class _Places:
    """Turns places in bytes into those in a text."""

    def __init__(self, document: Document) -> None:
        self._data, self._encoding = document.data, document.encoding
        self.source = Source(document.path, self._text(len(document.data)))

    def span(self, place: Place) -> Span:
        start = len(self._text(place.start))
        text = self._data[place.start : place.end].decode(self._encoding, "replace")
        return self.source.span(start, start + len(text))

    def _text(self, end: int) -> str:
        return self._data[:end].decode(self._encoding, "replace").removeprefix("\ufeff")


def _diagnostic(problem: Problem, sources: dict[Path, _Places]) -> Diagnostic:
    severity = Severity.ERROR if problem.is_error else Severity.WARNING
    related = tuple((text, _span(place, sources)) for text, place in problem.related)
    return Diagnostic(problem.code, problem.message, _span(problem.place, sources), severity, problem.hint, related)


def _span(place: Place, sources: dict[Path, _Places]) -> Span:
    known = sources.get(place.path)
    return known.span(place) if known else Source(place.path, "", has_places=False).span(0, 0)
