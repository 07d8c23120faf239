"""Reads the pages of the documentation: their files, commands, and what the commands print."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
_BLOCK = re.compile(
    r"(?:^File `(?P<file>\S+)`:\n\n)?```(?P<kind>\w+)\n(?P<text>.*?)```",
    re.DOTALL | re.MULTILINE,
)
_ELLIPSIS = "..."
_TIME = re.compile(r"\b\d\d:\d\d:\d\d\.\d{3}\b")


@dataclass
class Command:
    """A command and the lines it must print.

    `...` stands for anything, on a line of its own for any lines; a time of day like `12:00:00.250` for any time.
    """

    text: str
    output: list[str] = field(default_factory=list)
    interrupted: bool = False
    """Whether the reader presses Ctrl-C once all that was printed."""
    exit_code: int = 0

    @property
    def pattern(self) -> re.Pattern[str]:
        lines = [r"(?:.*\n)*?" if line == _ELLIPSIS else _line(line) for line in self.output]
        return re.compile("".join(lines))


@dataclass
class File:
    path: str
    text: str


def _line(line: str) -> str:
    parts = (
        r"\d\d:\d\d:\d\d\.\d{3}".join(map(re.escape, _TIME.split(part))) for part in line.rstrip().split(_ELLIPSIS)
    )
    return ".*".join(parts) + r" *\n"


def steps(page: Path) -> Iterator[File | Command]:
    """What a reader does, in order."""
    for block in _BLOCK.finditer(page.read_text(encoding="utf-8")):
        if block["file"]:
            yield File(block["file"], block["text"])
        elif block["kind"] == "console":
            yield from _commands(block["text"])


def _commands(text: str) -> Iterator[Command]:
    command: Command | None = None
    for line in text.splitlines():
        if line.startswith("$ "):
            if command:
                yield command
            command = Command(line[2:])
        elif command and line == "^C":
            command.interrupted = True
        elif command and (code := re.fullmatch(r"\[exit (\d+)\]", line)):
            command.exit_code = int(code[1])
        elif command:
            command.output.append(line)
    if command:
        yield command


def blocks(page: Path, kind: str) -> list[str]:
    """The fenced blocks of one language."""
    return [found["text"] for found in _BLOCK.finditer(page.read_text(encoding="utf-8")) if found["kind"] == kind]
