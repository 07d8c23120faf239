"""Spans in the editor's terms: a URI, and a range in the editor's text."""

from __future__ import annotations

import os
from pathlib import Path

from lsprotocol.types import Location, Position, PositionEncodingKind, Range
from pygls.uris import from_fs_path, to_fs_path

from ..dsl.source import Span
from .positions import Positions
from .project import Project, real


class Places:
    """Used for one request: it caches the lines of texts."""

    def __init__(self, project: Project, encoding: PositionEncodingKind | str) -> None:
        self._project, self._encoding = project, encoding
        self._known: dict[str, Positions] = {}

    def of(self, path: Path) -> Positions:
        key = real(path)
        if key not in self._known:
            self._known[key] = Positions(self._project.text(path), self._encoding)
        return self._known[key]

    def offset(self, path: Path, position: Position) -> int:
        return self.of(path).offset(position)

    def range(self, span: Span) -> Range:
        return self.of(span.source.path).range(span)

    def location(self, span: Span) -> Location:
        return Location(self.uri(span.source.path), self.range(span))

    def uri(self, path: Path) -> str:
        """The URI of a file; that of the editor if the file is open."""
        buffer = self._project.buffer(path)
        return buffer.uri if buffer and buffer.uri else from_fs_path(os.path.abspath(path)) or ""


def path_of(uri: str) -> Path | None:
    """The file that a URI names; None if it names no file."""
    found = to_fs_path(uri)
    return Path(found) if found and "\0" not in found else None
