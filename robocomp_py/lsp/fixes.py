"""Quick fixes: changes that the hint of a diagnostic describes.

Hints are written for people, in a few fixed phrases. This module carries out those that name a change.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from ..dsl.diagnostics import Diagnostic
from ..dsl.source import Span
from .complaints import UNUSED_IMPORT
from .edits import Edit, add_import, insert, whole_lines
from .index import Index
from .outline import Kind
from .project import real


@dataclass(frozen=True)
class Fix:
    """A change that resolves a diagnostic, with its title."""

    title: str
    edits: tuple[Edit, ...]


def fixes(diagnostic: Diagnostic, index: Index) -> list[Fix]:
    """All fixes; the likeliest comes first."""
    found: list[Fix] = []
    for phrase, carry_out in _PHRASES.items():
        matched = re.search(phrase, diagnostic.hint)
        if matched:
            found += carry_out(diagnostic, matched, index)
    return found


Carried = Iterator[Fix]


def _replace_by_meant(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    """Replace a word by the one that was meant; of a path, only its last part if only that is wrong."""
    meant, given = found[1], diagnostic.span.text
    if diagnostic.code in ("missing-import", "missing-file") and "/" not in meant:
        path = PurePosixPath(given.replace("\\", "/"))
        meant = str(path.with_name(meant if PurePosixPath(meant).suffix else meant + path.suffix))
    yield Fix(f"Change to `{meant}`", (Edit(diagnostic.span, meant),))


def _add_import(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    yield Fix(f'Import "{found[1]}"', (add_import(diagnostic.span.source, found[1]),))


def _import_component(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    """The files of the project that define such a component."""
    source = diagnostic.span.source
    for path in index.project.files():
        made = index.outline(path) if path.suffix.lower() == ".cdsl" else None
        for symbol in made.symbols if made else ():
            if symbol.kind is Kind.COMPONENT and symbol.name.text.lower() == diagnostic.span.text.lower():
                name = relative(path, source.path)
                yield Fix(f'Import "{name}"', (add_import(source, name),))


def _remove(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    span = diagnostic.span
    if diagnostic.code in (UNUSED_IMPORT, "wrong-import"):
        span = _statement_of_import(diagnostic)
        yield Fix("Remove this import", (Edit(whole_lines(span), ""),))
        return
    yield Fix(f"Remove `{_short(span.text)}`", (Edit(whole_lines(span), ""),))


def _remove_rest(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    source = diagnostic.span.source
    yield Fix("Remove what follows", (Edit(source.span(diagnostic.span.start, len(source.text)), ""),))


def _add_mark(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    yield Fix(f"Add `{found[1]}`", (insert(diagnostic.span.source, diagnostic.span.end, found[1]),))


def _close_block(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    source = diagnostic.span.source
    start = source.text.rfind("\n", 0, diagnostic.span.start) + 1
    indent = re.match(r"[ \t]*", source.text[start:])
    yield Fix("Close the block before", (insert(source, start, f"{indent[0] if indent else ''}}};\n"),))


def _close_comment(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    source = diagnostic.span.source
    end = source.text.find("\n", diagnostic.span.end)
    yield Fix("Close it at the end of the line", (insert(source, end if end >= 0 else len(source.text), " */"),))


def _write_instead(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    yield Fix(f"Write `{found[1]}`", (Edit(diagnostic.span, found[1]),))


def _write_plain(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    plain = _PLAIN.get(diagnostic.span.text)
    if plain:
        yield Fix(f"Write a plain `{plain}`", (Edit(diagnostic.span, plain),))


def _say_python(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    source = diagnostic.span.source
    if diagnostic.code == "not-python":
        yield Fix("Change to `python`", (Edit(diagnostic.span, "python"),))
        return
    opening = source.text.find("{", diagnostic.span.end)
    if opening >= 0:
        yield Fix("Add `language python;`", (insert(source, opening + 1, "\n    language python;"),))


def _make_query(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    for _, span in diagnostic.related[:1]:
        yield Fix("Make it a [query]", (Edit(span, "query"),))


def _wire(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    source = diagnostic.span.source
    opening = source.text.find("{", diagnostic.span.end)
    if opening >= 0:
        yield Fix(f"Write `{found[1]}`", (insert(source, opening + 1, f"\n        {found[1]}"),))


def _swap(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    low, colon, high = diagnostic.span.text.partition(":")
    if colon:
        yield Fix("Swap them", (Edit(diagnostic.span, f"{high.strip()}:{low.strip()}"),))


def _write_whole(diagnostic: Diagnostic, found: re.Match[str], index: Index) -> Carried:
    for name in found.groups():
        yield Fix(f"Write `{name}`", (Edit(diagnostic.span, name),))


_PHRASES: dict[str, Callable[[Diagnostic, re.Match[str], Index], Carried]] = {
    r"did you mean `([^`]+)`\?": _replace_by_meant,
    r'^add: import "([^"]+)";$': _add_import,
    r"^import its \.cdsl$": _import_component,
    r"^remove it$": _remove,
    r"^(remove the line$|leave it out)": _remove,
    r"; remove the text after it$": _remove_rest,
    r"^add `([^`]+)` here$": _add_mark,
    r"^add `\};` above it": _close_block,
    r"^close it by `\*/`$": _close_comment,
    r"^write `([^`]+)` instead$": _write_instead,
    r"^write `((?:import|gui|options) [^`]+;)`$": _write_instead,
    r"^write a plain one$": _write_plain,
    r"^write `(?:period|timer \w+) ([^`]+);`": _write_instead,
    r"^write `language python;`$": _say_python,
    r"^make it a \[query\]$": _make_query,
    r"^write in its block: (.*;)$": _wire,
    r"^the smaller one comes first$": _swap,
    r"^write `([^`]+)` for it, or `([^`]+)` for the other one$": _write_whole,
}
"""Patterns of hints, and the functions that carry them out."""

_PLAIN = {**dict.fromkeys("“”„«»", '"'), **dict.fromkeys("‘’‚", "'"), "\N{NO-BREAK SPACE}": " "}


def relative(path: Path, importing: Path) -> str:
    """How a file is imported from another one."""
    return PurePosixPath(os.path.relpath(real(path), os.path.dirname(real(importing)))).as_posix()


def _statement_of_import(diagnostic: Diagnostic) -> Span:
    text, span = diagnostic.span.source.text, diagnostic.span
    start = text.rfind("import", 0, span.start)
    end = re.compile(r'"\s*;?').match(text, span.end)
    return span.source.span(max(start, 0), end.end() if end else span.end)


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= 30 else f"{line[:29]}…"
