"""What each code means: the pages of docs/diagnostics, which are shipped with the package."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

_INDEX = "README.md"
_SENTENCE = re.compile(r"(.+?[.:])(?:\s|\Z)", re.DOTALL)


def explanation(code: str) -> str:
    """The page of a code, as Markdown; "" if there is none."""
    page = _folder() / f"{code}.md"
    return page.read_text(encoding="utf-8") if code in codes() else ""


def severity(page: str) -> str:
    """`error` or `warning`: the first word below the title."""
    return page.split("\n\n", 2)[1].partition(" ")[0]


def meaning(page: str) -> str:
    """The text of a page above its examples, as one line."""
    _, _, text = page.partition("\n## ")[0].split("\n\n", 2)
    return " ".join(text.split())


def summary(page: str) -> str:
    """The first sentence of `meaning`."""
    text = meaning(page)
    found = _SENTENCE.match(text)
    return re.sub(":$", ".", found[1] if found else text)


def codes() -> list[str]:
    """All codes that have a page."""
    return sorted(_codes())


def _codes() -> Iterator[str]:
    for each in _folder().iterdir():
        if each.name.endswith(".md") and each.name != _INDEX:
            yield each.name.removesuffix(".md")


def _folder() -> Traversable:
    """The folder of the pages, in a wheel or in a checkout."""
    shipped = files("robocomp_py") / "diagnostics"
    return shipped if shipped.is_dir() else Path(__file__).parents[2] / "docs" / "diagnostics"
