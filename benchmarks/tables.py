"""Tables for a terminal and for the page on performance, which keeps each between two marks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """`name` is the name of its mark in the page; the first `labels` columns are words, the others numbers."""

    name: str
    title: str
    head: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    labels: int = 2
    note: str = ""


def as_text(table: Table) -> str:
    widths = [max(map(len, column)) for column in zip(table.head, *table.rows, strict=True)]
    lines = []
    for row in (table.head, *table.rows):
        cells = (
            cell.ljust(width) if number < table.labels else cell.rjust(width)
            for number, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        lines.append("  " + "  ".join(cells).rstrip())
    return "\n".join([table.title, *lines, *([f"  {table.note}"] if table.note else [])])


def as_markdown(table: Table) -> str:
    rule = ("---" if number < table.labels else "---:" for number in range(len(table.head)))
    lines = [f"| {' | '.join(row)} |" for row in (table.head, tuple(rule), *table.rows)]
    return "\n".join([*lines, *(["", table.note] if table.note else [])])


def fill(page: str, tables: Iterable[Table]) -> str:
    """The page with these tables between their marks. Raises ValueError if it has no place for one."""
    for table in tables:
        begin = f"<!-- measured: {table.name} -->\n"
        before, found, rest = page.partition(begin)
        _, end, after = rest.partition("<!-- end -->")
        if not (found and end):
            raise ValueError(f"the page has no `{begin.strip()}` … `<!-- end -->`")
        page = f"{before}{begin}{as_markdown(table)}\n{end}{after}"
    return page


def us(microseconds: float | None) -> str:
    if microseconds is None:
        return "–"
    if microseconds >= 9999.5:
        return f"{microseconds / 1000:.1f} ms"
    return f"{microseconds:.0f} µs" if microseconds >= 99.95 else f"{microseconds:.1f} µs"


def times_as_much(ratio: float | None) -> str:
    return "–" if ratio is None else f"{ratio:.2f} ×"


def octets(size: int) -> str:
    """A size for people. The steps are 1024 up to 64 KB and 1000 above, like the measured sizes."""
    if size >= 1_000_000:
        return f"{size / 1e6:g} MB"
    return f"{size / 1024:g} KB" if size >= 1024 else f"{size} B"
