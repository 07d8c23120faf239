"""Writes lines: breaks those that are too long, and aligns the comments after them in columns."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from .words import Remark, moved

WIDTH = 120
STEP = 4
"""Columns that the inside of a block is indented."""

_MOST_UNEVEN = 30
"""Comments are aligned if the lengths of their lines differ by at most this number of columns."""


class Break:
    """Where a line can be broken."""


BREAK = Break()


@dataclass(slots=True)
class Group:
    """Words that stand on one line, or are broken at all of its breaks. The comments in it end their lines.

    The text after a break is aligned with the text after the group's beginning if the group hangs; otherwise it is
    indented one step more than the line.
    """

    hangs: bool = True
    parts: list[str | Remark | Break | Group] = field(default_factory=list)

    @property
    def begins_with_space(self) -> bool:
        first = self.parts[0] if self.parts else ""
        return first.startswith(" ") if isinstance(first, str) else isinstance(first, Remark)


@dataclass(slots=True)
class _Line:
    level: int
    indent: int
    blank: bool
    """Whether there is a blank line above it."""
    end: int
    """The column after its words."""
    words: list[str] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)

    @property
    def aligns(self) -> bool:
        """Whether its comment is aligned with those of neighbouring lines."""
        return bool(self.words) and self.words[0] not in ("{", "}")


class Page:
    """The written lines. `level` is the number of open blocks."""

    def __init__(self) -> None:
        self.level = 0
        self._lines: list[_Line] = []
        self._blank = False
        self._pending: int | None = None

    def skip(self) -> None:
        """Leave a blank line, unless the page is empty."""
        self._blank = bool(self._lines)

    def fits(self, group: Group) -> bool:
        """Whether it can stand on one line."""
        flat = _flat_width(group)
        return flat is not None and self._indent + flat <= WIDTH

    def line(self, indent: int | None = None) -> None:
        """Begin a line."""
        column = self._indent if indent is None else indent
        self._lines.append(_Line(self.level, column, self._blank, column))
        self._blank, self._pending = False, None

    def group(self, group: Group, behind: int = 0) -> None:
        """Write a group. `behind` is the number of columns needed for the text that must follow it on the line."""
        flat = _flat_width(group)
        if flat is not None and self._column + flat + behind <= WIDTH:
            self._write_flat(group)
            return
        indent = self._inside(group) if group.hangs else self._indent + STEP
        for part, needed in zip(group.parts, _room_behind(group, behind), strict=True):
            match part:
                case str():
                    self.write(part)
                case Remark():
                    self.remark(part, indent)
                case Group():
                    self.group(part, needed)
                case Break():
                    self._pending = indent

    def write(self, text: str) -> None:
        """Write a word on the line; at the beginning, the space before it is omitted."""
        if self._pending is not None:
            self.line(self._pending)
        line = self._last
        line.words.append(text if line.words else text.lstrip(" "))
        line.end = moved(line.end, line.words[-1])

    def remark(self, remark: Remark, indent: int) -> None:
        """Write a comment between words; the next word begins a new line."""
        if remark.fresh:
            self.line(indent)
        self._last.remarks.append(remark)
        self._pending = indent

    def trail(self, remark: Remark) -> None:
        """Write a comment at the end of the line."""
        self._last.remarks.append(remark)

    def text(self) -> str:
        return "".join(f"{line}\n" for line in self._composed())

    @property
    def _indent(self) -> int:
        return self.level * STEP

    @property
    def _last(self) -> _Line:
        return self._lines[-1]

    @property
    def _column(self) -> int:
        return self._last.end if self._pending is None else self._pending

    def _inside(self, group: Group) -> int:
        """The column of a group's first word."""
        is_begun = self._pending is None and self._last.words
        return self._column + (1 if is_begun and group.begins_with_space else 0)

    def _write_flat(self, group: Group) -> None:
        for part in group.parts:
            match part:
                case str():
                    self.write(part)
                case Group():
                    self._write_flat(part)

    def _composed(self) -> Iterator[str]:
        for run in self._runs():
            column = _common_column(run)
            for line in run:
                if line.blank:
                    yield ""
                yield from _with_remarks(line, column)

    def _runs(self) -> Iterator[list[_Line]]:
        """The lines, in groups whose comments are aligned."""
        run: list[_Line] = []
        for line in self._lines:
            if run and (line.blank or not line.aligns or not run[-1].aligns or line.level != run[-1].level):
                yield run
                run = []
            run.append(line)
        yield run


def _flat_width(group: Group) -> int | None:
    """The columns it takes on one line; None if it cannot stand on one."""
    total = 0
    for part in group.parts:
        match part:
            case str():
                total += len(part)
            case Remark():
                return None
            case Group():
                inner = _flat_width(part)
                if inner is None:
                    return None
                total += inner
    return total


def _room_behind(group: Group, behind: int) -> list[int]:
    """For each part of a broken group, the columns of what follows it on its line."""
    room = list[int]()
    for part in reversed(group.parts):
        room.append(behind)
        match part:
            case str():
                behind += len(part)
            case Break() | Remark():
                behind = 0
            case Group():
                behind += _flat_width(part) or 0
    return room[::-1]


def _common_column(run: list[_Line]) -> int | None:
    """The column of the comments after these lines; None if each follows its line directly.

    Comments that were in one column stay aligned, at the same distance from the code.
    """
    lines = [line for line in run if line.remarks and line.aligns]
    ends = [line.end for line in lines]
    if len({line.remarks[0].column for line in lines}) > 1 and max(ends) - min(ends) > _MOST_UNEVEN:
        return None
    return max(ends) + max(1, min(line.remarks[0].gap for line in lines)) if lines else None


def _with_remarks(line: _Line, column: int | None) -> Iterator[str]:
    parts = [" " * line.indent, *line.words]
    end = line.end
    for index, remark in enumerate(line.remarks):
        if index or line.words:
            parts.append(" " * (column - end if column and not index else 1))
            end = moved(end, parts[-1])
        *above, last = remark.lines(end)
        if above:
            yield "".join([*parts, above[0]])
            yield from above[1:]
            parts, end = [], 0
        parts.append(last)
        end = moved(end, last)
    yield "".join(parts)
