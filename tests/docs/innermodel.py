"""The tables of tags in docs/reference/innermodel.md. `python -m tests.docs.innermodel` writes them from the code."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from robocomp_py.innermodel.nodes import CHOICES, TAGS, Attribute
from robocomp_py.innermodel.write import as_text

from .pages import ROOT

PAGE = ROOT / "docs" / "reference" / "innermodel.md"
_BEGIN, _END = "<!-- tags: begin -->\n", "<!-- tags: end -->\n"


def filled(text: str) -> str:
    """The text of the page with the tables of today."""
    before, _, rest = text.partition(_BEGIN)
    _, _, after = rest.partition(_END)
    return f"{before}{_BEGIN}\n{''.join(_tables())}\n{_END}{after}"


def _tables() -> Iterator[str]:
    yield "| tag | meaning | attributes | children |\n|---|---|---|---|\n"
    for tag in TAGS.values():
        if tag.attributes:
            yield f"| `{tag.name}` | {tag.text} | {_names(tag.attributes)} | {'yes' if tag.has_children else ''} |\n"
    yield "\n| attribute | of | meaning | default |\n|---|---|---|---|\n"
    rows: dict[tuple[str, str, str], list[str]] = {}
    for tag in TAGS.values():
        for each in tag.attributes.values():
            rows.setdefault((each.name, _meaning(each), _default(each)), []).append(tag.name)
    for (name, meaning, default), tags in rows.items():
        yield f"| `{name}` | {'all' if name == 'id' else ', '.join(tags)} | {meaning} | {default} |\n"


def _names(known: Iterable[str]) -> str:
    return " ".join(f"`{name}`" for name in known if name != "id")


def _meaning(attribute: Attribute) -> str:
    choices = CHOICES.get(attribute.kind)
    listed = ", ".join(f"`{each}`" for each in choices or ())
    return attribute.text if not choices or listed.split(",")[0] in attribute.text else f"{attribute.text}: {listed}"


def _default(attribute: Attribute) -> str:
    if attribute.default in (0, "", False):
        return ""
    if isinstance(attribute.default, float) and math.isinf(attribute.default):
        return "none"
    return f"`{as_text(attribute.default)}`"


def main() -> None:
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
