"""Writes a tree back into the bytes that it was read from: only what was changed differs."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import escape

from .nodes import INCLUDE, ROOT, Tag, Value
from .read import Document, Element, Model, every

NEW = Path("new.xml")
"""The path under which the text of a tree is given that was not read from a file."""

_INDENT = b"    "


@dataclass(slots=True, eq=False)
class Written:
    """A node that is to be written, with the element that it was read from, if any."""

    tag: Tag
    values: Mapping[str, Value]
    element: Element | None
    children: Sequence[Written] = field(default_factory=list)


def written(model: Model | None, root: Written) -> dict[Path, bytes]:
    """The files that changed, by their paths. Without a model, one new file."""
    if model is None:
        return {
            NEW: b"<innerModel>"
            + b"".join(_new(each, b"\n" + _INDENT) for each in root.children)
            + b"\n</innerModel>\n"
        }
    made = {}
    writer = _Writer(model, root)
    for document in model.documents:
        if document.root:
            top = document.root
            data = document.data[: top.place.start] + writer.element(top) + document.data[top.end :]
            if data != document.data:
                made[document.path] = data
    return made


def as_text(value: Value) -> str:
    """A value as an attribute has it."""
    match value:
        case bool():
            return "1" if value else "0"
        case float() if value.is_integer() and abs(value) < 1e15:
            return str(int(value))
        case tuple():
            return ",".join(map(as_text, value))
        case _:
            return str(value)


class _Writer:
    def __init__(self, model: Model, root: Written) -> None:
        self._above: dict[Element, Element | None] = dict.fromkeys(model.elements)
        """What an element stands in, if all include tags were replaced by what they include."""
        for each in every(model.elements):
            self._above |= dict.fromkeys(each.children, each)
        self._nodes: dict[Element, Written] = {}
        self._parents: dict[Element, Element | None] = {}
        """The present parents of elements; None: the root, or a new node."""
        self._is_lost: set[Element] = set()
        """Elements in new nodes."""
        main = model.documents[0].root
        if main:
            self._nodes[main] = root
        waiting: list[tuple[Written, Element | None, bool]] = [(each, None, False) for each in root.children]
        while waiting:
            node, above, is_in_new = waiting.pop()
            if node.element:
                self._nodes[node.element], self._parents[node.element] = node, above
                if is_in_new:
                    self._is_lost.add(node.element)
            waiting += [(each, node.element, node.element is None) for each in node.children]

    def element(self, element: Element) -> bytes:
        """The bytes of an element as it is to be written."""
        data = element.document.data
        node = self._nodes.get(element)
        added = [self._added(each, element) for each in node.children if not self._stays(each.element)] if node else []
        start = self._start_tag(element, node)
        if element.is_closed:
            if not added:
                return start
            close = f"</{_name_of(element)}>".encode()
            return start[:-2].rstrip() + b">" + b"".join(added) + _indent_of(element) + close
        parts, at = [start], element.place.end
        for part in element.parts:
            gap = data[at : part.place.start]
            if part.tag.name == INCLUDE:
                parts += (gap, data[part.place.start : part.end])
            elif self._stays(part):
                parts += (gap, self.element(part))
            else:
                parts.append(gap.rstrip())
            at = part.end
        rest = data[at : element.inner_end]
        body = rest.rstrip() if added else rest
        parts += (body, *added, rest[len(body) :], data[element.inner_end : element.end])
        return b"".join(parts)

    def _stays(self, element: Element | None) -> bool:
        """Whether an element still stands where it was read."""
        if element is None or element not in self._nodes or element in self._is_lost:
            return False
        return self._parents[element] is self._above[element]

    def _added(self, node: Written, parent: Element) -> bytes:
        indent = _indent_of(parent) + _INDENT
        return indent + self.element(node.element) if node.element else self._new(node, indent, parent.document)

    def _new(self, node: Written, indent: bytes, document: Document) -> bytes:
        deeper = indent + _INDENT
        inner = [
            deeper + self.element(each.element) if each.element else self._new(each, deeper, document)
            for each in node.children
        ]
        return _tagged(node, indent, inner, document.encoding)

    def _start_tag(self, element: Element, node: Written | None) -> bytes:
        data, place = element.document.data, element.place
        if node is None or element.tag.name == ROOT:
            return data[place.start : place.end]
        edits = []
        end = place.end - (2 if data[place.end - 2 : place.end] == b"/>" else 1)
        end -= len(data[place.start : end]) - len(data[place.start : end].rstrip())
        for name, value in node.values.items():
            if value == element.values.get(name):
                continue
            encoded = _quoted(value, element.document)
            if name in element.spans:
                edits.append((*element.spans[name], encoded))
            else:
                edits.append((end, end, f' {name}="'.encode() + encoded + b'"'))
        made: list[bytes] = []
        at = place.start
        for begin, finish, text in sorted(edits, key=lambda each: each[:2]):
            made += (data[at:begin], text)
            at = finish
        return b"".join((*made, data[at : place.end]))


def _new(node: Written, indent: bytes) -> bytes:
    return _tagged(node, indent, [_new(each, indent + _INDENT) for each in node.children])


def _tagged(node: Written, indent: bytes, inner: Sequence[bytes], encoding: str = "utf-8") -> bytes:
    text = f"<{node.tag.name}{''.join(_attributes(node))}".encode(encoding, "xmlcharrefreplace")
    if not inner:
        return indent + text + b"/>"
    return indent + text + b">" + b"".join(inner) + indent + f"</{node.tag.name}>".encode()


def _attributes(node: Written) -> Iterator[str]:
    for name, attribute in node.tag.attributes.items():
        value = node.values[name]
        if value != attribute.default:
            yield f' {name}="{_escaped(value)}"'


def _escaped(value: Value) -> str:
    return escape(as_text(value), {'"': "&quot;", "'": "&apos;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"})


def _quoted(value: Value, document: Document) -> bytes:
    return _escaped(value).encode(document.encoding, "xmlcharrefreplace")


def _name_of(element: Element) -> str:
    """The tag as the file writes it."""
    found = re.match(rb"<([^\s/>]+)", element.document.data[element.place.start : element.place.end])
    return found[1].decode(element.document.encoding) if found else element.tag.name


def _indent_of(element: Element) -> bytes:
    """A new line, and the white space before an element."""
    data, start = element.document.data, element.place.start
    line = data[data.rfind(b"\n", 0, start) + 1 : start]
    return b"\n" + line[: len(line) - len(line.lstrip())]
