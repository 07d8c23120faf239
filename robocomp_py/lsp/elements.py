"""The elements of an InnerModel as they are written in an editor, and the nodes and files that they name.

A text that is being written is rarely well-formed, so tags are read one by one, as far as they go.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from ..dsl.innermodel.check import ENDING
from ..dsl.source import Name, Source, Span
from ..innermodel.nodes import INCLUDE, MESH_FORMATS, MOST_DEPTH, TAGS, Tag
from .outline import Kind, Link, Outline, Symbol

_MARKUP = re.compile(r"<!--.*?(?:-->|\Z)|<[!?][^>]*>?|</(?P<end>[\w.:-]*)|<(?P<start>[\w.:-]*)", re.DOTALL)
_ATTRIBUTE = re.compile(
    r"""\s*(?P<name>[^\s=<>/"']+)(?P<is>\s*=\s*(?P<value>"[^"<\n]*"?|'[^'<\n]*'?)?)?|\s*(?P<odd>["'=/])"""
)
_TAG_END = re.compile(r"\s*(/?>)")
_PICTURES = (".png", ".jpg", ".jpeg", ".bmp")
FILES = {
    ("mesh", "file"): tuple(f".{each}" for each in MESH_FORMATS),
    (INCLUDE, "path"): (ENDING,),
    ("plane", "texture"): _PICTURES,
    ("display", "texture"): _PICTURES,
}
"""The endings of files that an attribute names, by tag and attribute."""


@dataclass(frozen=True, slots=True)
class Written:
    """An attribute as it is written; `value` is without its quotes."""

    name: Span
    value: Span | None


@dataclass(eq=False, slots=True)
class Element:
    """A tag as it is written, and what is in it."""

    name: Span
    attributes: list[Written] = field(default_factory=list)
    tag_end: int = 0
    """The offset behind its start tag."""
    end: int = 0
    """The offset behind its end tag."""
    is_complete: bool = False
    """Whether its start tag ends with `>`."""
    parts: list[Element] = field(default_factory=list)
    above: Element | None = None

    @property
    def tag(self) -> Tag | None:
        return TAGS.get(self.name.text.lower())

    def value(self, attribute: str) -> Span | None:
        return next((each.value for each in self.attributes if each.name.text == attribute), None)


def elements(source: Source) -> list[Element]:
    """The elements of a text, parents first. Those without an end tag end where what is around them ends."""
    text, found, opened, at = source.text, list[Element](), list[Element](), 0
    while matched := _MARKUP.search(text, at):
        at = matched.end()
        if matched["end"] is not None:
            name = matched["end"].lower()
            at = text.find(">", at) + 1 or len(text)
            if name in (each.name.text.lower() for each in opened):
                while opened[-1].name.text.lower() != name:
                    opened.pop().end = matched.start()
                opened.pop().end = at
        elif matched["start"] is not None:
            above = opened[-1] if opened else None
            element = Element(source.span(*matched.span("start")), above=above)
            at = _read_attributes(source, element, at)
            found.append(element)
            if above:
                above.parts.append(element)
            if element.is_complete and not text.endswith("/>", 0, at) and len(opened) < MOST_DEPTH:
                opened.append(element)
            element.end = at
    for each in opened:
        each.end = len(text)
    return found


def _read_attributes(source: Source, element: Element, at: int) -> int:
    """Read a start tag from behind its name; returns the offset behind it."""
    while True:
        end = _TAG_END.match(source.text, at)
        if end:
            element.is_complete, element.tag_end = True, end.end()
            return end.end()
        matched = _ATTRIBUTE.match(source.text, at)
        if matched is None:
            space = re.compile(r"\s*").match(source.text, at)
            element.tag_end = space.end() if space else at
            return at
        at = matched.end()
        if matched["name"]:
            value = None
            if matched["value"]:
                start, stop = matched.span("value")
                quoted = stop - start > 1 and source.text[stop - 1] == source.text[start]
                value = source.span(start + 1, stop - quoted)
            element.attributes.append(Written(source.span(*matched.span("name")), value))


def outline(source: Source) -> Outline:
    """The nodes of a text, and the files that it names."""
    every = elements(source)
    links = [
        Link(Name(value.text, value))
        for each in every
        for tag, attribute in FILES
        if each.name.text.lower() == tag and (value := each.value(attribute)) and value.text
    ]
    return Outline(source, tuple(_symbol(each) for each in every if each.above is None), (), tuple(links))


def _symbol(element: Element) -> Symbol:
    identity, path = element.value("id"), element.value("path")
    text = identity.text if identity else path.text if path else ""
    name = Name(text or element.name.text, identity if identity and text else element.name)
    whole = element.name.source.span(element.name.start - 1, element.end)
    detail = element.name.text if text else ""
    parts = tuple(_symbol(each) for each in element.parts)
    return Symbol(Kind.NODE, name, "", whole, detail=detail, children=parts)
