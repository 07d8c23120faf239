"""sub.toml: a `[[components]]` for each program, with `name`, `cwd`, `cmd` and `ice_name`."""

from __future__ import annotations

import re
from typing import Any

from ...dsl.diagnostics import Report
from ...dsl.source import Source, Span
from ...runtime.document import NotToml, parsed
from .programs import Listing, Program, Said

_KEYS = ("name", "cwd", "cmd", "ice_name")


def read_subtoml(source: Source, report: Report) -> Listing | None:
    """The programs of a file; None if it is no sub.toml, which is reported."""
    try:
        document = parsed(source.text, source.path)
    except NotToml as exc:
        report.error("bad-import", f"this is no TOML: {exc.reason}", source.span(exc.offset, exc.offset + 1))
        return None
    listing = Listing(source.path.name)
    components = document.pop("components", None)
    if not isinstance(components, list) or not all(isinstance(each, dict) for each in components):
        message = "this is no sub.toml: it has no [[components]]"
        report.error("bad-import", message, source.span(0, 0), "a network of ours is a .ddsl file")
        return None
    lines = _Lines(source)
    listing.notes = [Said(f"{key} is not understood", lines.of_key(key, 1)) for key in document]
    starts = lines.tables("components")
    for number, component in enumerate(components):
        line = starts[number] if number < len(starts) else 1
        program = _program(component, line, lines, source, report)
        if program:
            listing.programs.append(program)
    return None if report.errors else listing


def _program(component: dict[str, Any], line: int, lines: _Lines, source: Source, report: Report) -> Program | None:
    wrong = [key for key in _KEYS if not isinstance(component.get(key, ""), str)]
    name = component.get("name", "")
    if wrong or not name or not str(name).strip():
        key = wrong[0] if wrong else "name"
        message = f"`{key}` is no text" if wrong else "a component without `name`"
        report.error("bad-import", message, lines.span(lines.of_key(key, line) if wrong else line))
        return None
    program = Program(name.strip(), line, folder=component.get("cwd", "").strip())
    if component.get("cmd", "").strip():
        program.command = Said(component["cmd"].strip(), lines.of_key("cmd", line))
    if component.get("ice_name", "").strip():
        program.endpoint = Said(component["ice_name"].strip(), lines.of_key("ice_name", line))
    others = [key for key in component if key not in _KEYS]
    program.notes = [lines.not_understood(key, line) for key in others]
    return program


class _Lines:
    """Where things stand; the reader of TOML does not tell."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._lines = source.text.splitlines()

    def tables(self, name: str) -> list[int]:
        pattern = re.compile(rf"\s*\[\[\s*{name}\s*\]\]")
        return [number for number, line in enumerate(self._lines, 1) if pattern.match(line)]

    def of_key(self, key: str, start: int) -> int:
        """The line of a key at or behind a line, in the same table."""
        for number, line in enumerate(self._lines[start - 1 :], start):
            if number > start and line.lstrip().startswith("["):
                break
            if re.match(rf"\s*[\"']?{re.escape(key)}[\"']?\s*=", line):
                return number
        return start

    def not_understood(self, key: str, start: int) -> Said:
        line = self.of_key(key, start)
        text = self._lines[line - 1].strip()
        return Said(f"{text if text.startswith(key) else key} is not understood", line)

    def span(self, line: int) -> Span:
        start = sum(len(each) for each in self._source.text.splitlines(keepends=True)[: line - 1])
        return self._source.span(start, start + len(self._lines[line - 1]))
