"""InnerModel files in an editor: what tags and attributes mean, and what may come next."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from ..dsl.source import Source
from ..innermodel.nodes import CHOICES, ROOT, TAGS, Attribute, Kind, Tag
from ..innermodel.write import as_text
from .complete import Candidate
from .elements import FILES, Element, Written, elements

_MOST_FILES = 200
_OFTEN = ("id", "tx", "ty", "tz", "rx", "ry", "rz", "size", "file")
"""Attributes that are proposed before others."""


# Hover.


def hover(source: Source, offset: int) -> str:
    """Markdown about the tag or the attribute at a place; "" if there is nothing to say."""
    element = _tag_at(elements(source), offset)
    tag = element.tag if element else None
    if element is None or tag is None:
        return ""
    if element.name.touches(offset):
        return about_tag(tag)
    for each in element.attributes:
        if each.name.touches(offset) or (each.value and each.value.touches(offset)):
            attribute = tag.attributes.get(each.name.text)
            return about(attribute, tag) if attribute else ""
    return ""


def about_tag(tag: Tag) -> str:
    names = ", ".join(f"`{each}`" for each in tag.attributes)
    more = "It has no children." if not tag.has_children else "It may have children."
    return f"`<{_shown(tag)}>`: {tag.text}\n\n{f'Attributes: {names}. ' if names else ''}{more}"


def about(attribute: Attribute, tag: Tag) -> str:
    default = "" if attribute.name == "id" or attribute.default == "" else as_text(attribute.default)
    parts = [attribute.kind.value, *([f"default `{default}`"] if default else [])]
    return f"`{attribute.name}` of `<{_shown(tag)}>`: {attribute.text}\n\n{'; '.join(parts)}"


def _shown(tag: Tag) -> str:
    return "innerModel" if tag.name == ROOT else tag.name


# Completion.


def complete(source: Source, offset: int) -> list[Candidate]:
    """What may be written at a place."""
    text = source.text
    found = elements(source)
    element = _tag_at(found, offset)
    if element and element.name.touches(offset):
        return list(_tags(source, element, offset))
    if element and not (element.is_complete and offset >= element.tag_end):
        for each in element.attributes:
            if each.value and each.value.touches(offset):
                return list(_values(source, element, each, offset))
        return list(_attributes(source, element, offset))
    written = re.search(r"</([\w.:-]*)\Z", text[:offset])
    if written:
        around = [each for each in found if each.is_complete and each.tag_end <= offset <= each.end]
        over = source.span(offset - len(written[1]), offset)
        return [Candidate(f"{each.name.text}>", "word", over=over) for each in _still_open(around, text)]
    return []


def _still_open(around: list[Element], text: str) -> list[Element]:
    """The innermost element that a place is in."""
    inside = [each for each in around if not text.endswith("/>", 0, each.tag_end)]
    return inside[-1:]


def _tags(source: Source, element: Element, offset: int) -> Iterator[Candidate]:
    above = element.above.tag if element.above else None
    over = source.span(element.name.start, offset)
    if element.above is None:
        yield Candidate("innerModel", "word", TAGS[ROOT].text, over=over)
    elif above is None or above.has_children:
        for tag in TAGS.values():
            if tag.name != ROOT:
                yield Candidate(tag.name, "word", tag.text, about_tag(tag), over=over)


def _attributes(source: Source, element: Element, offset: int) -> Iterator[Candidate]:
    tag = element.tag
    before = re.search(r"[^\s=<>/\"']*\Z", source.text[element.name.end : offset])
    if tag is None or before is None or before.start() == 0:
        return
    over = source.span(element.name.end + before.start(), offset)
    written = {each.name.text for each in element.attributes if not each.name.touches(offset)}
    for name, attribute in tag.attributes.items():
        if name not in written:
            rank = 0 if name in _OFTEN else 2 if attribute.text.startswith("without effect") else 1
            yield Candidate(name, "word", attribute.text, about(attribute, tag), rank=rank, over=over)


def _values(source: Source, element: Element, written: Written, offset: int) -> Iterator[Candidate]:
    tag = element.tag
    attribute = tag.attributes.get(written.name.text) if tag else None
    assert written.value
    over = source.span(written.value.start, written.value.end)
    if tag is None or attribute is None:
        return
    words = CHOICES.get(attribute.kind, ("0", "1") if attribute.kind is Kind.FLAG else ())
    words = ("bumper",) if (tag.name, attribute.name) == ("touchsensor", "type") else words
    yield from (Candidate(word, "word", attribute.text, over=over) for word in words)
    endings = FILES.get((tag.name, attribute.name))
    if endings:
        folder = PurePosixPath(source.text[written.value.start : offset]).parent
        if source.text[written.value.start : offset].endswith("/"):
            folder = PurePosixPath(source.text[written.value.start : offset])
        yield from (Candidate(each, "file", over=over) for each in _files(source.path, folder, endings))


def _files(path: Path, folder: PurePosixPath, endings: tuple[str, ...]) -> Iterator[str]:
    """Files with these endings in a folder, and the folders in it; relative to the folder of the file itself."""
    try:
        every = sorted((path.parent / folder).iterdir())
    except (OSError, ValueError):
        return
    for each in every[:_MOST_FILES]:
        if each.is_dir() and not each.name.startswith("."):
            yield f"{folder / each.name}/"
        elif each.suffix.lower() in endings and each != path:
            yield str(folder / each.name)


def _tag_at(found: list[Element], offset: int) -> Element | None:
    """The element whose start tag a place is in, or directly behind if that tag is unfinished."""
    for each in found:
        if each.name.start <= offset and (offset < each.tag_end or (offset == each.tag_end and not each.is_complete)):
            return each
    return None
