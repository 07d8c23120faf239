"""Reads rcmanager's XML: a `<node>` for each program, with its dependences and its commands to start and stop.

Files with a document type are refused, since they may contain attacks on XML parsers.
"""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Any
from xml.parsers import expat

from ...dsl.diagnostics import Report
from ...dsl.source import Source
from .programs import HERE, Listing, Program, Text

_WITHOUT_EFFECT = ("xpos", "ypos", "radius", "color", "downCommand", "configFile")
"""Elements without effect: position in the picture, command to stop, files for the editor."""

_ENDS_TOO_EARLY = expat.errors.codes[expat.errors.XML_ERROR_NO_ELEMENTS]


def read_rcmanager(source: Source, report: Report) -> Listing | None:
    """The programs of a file; None if it is not rcmanager XML, which is reported."""
    reader = _Reader(source)
    try:
        return reader.read()
    except expat.ExpatError as exc:
        message, line, column = f"not valid XML: {reader.wrong(exc)}", exc.lineno, exc.offset
    except _Refused as exc:
        message, line, column = str(exc), exc.line, exc.column
    at = sum(len(each) for each in source.text.splitlines(keepends=True)[: line - 1]) + column
    report.error("bad-import", message, source.span(min(at, len(source.text)), at + 1))
    return None


class _Refused(Exception):
    """Well-formed XML that this module does not read."""

    def __init__(self, message: str, parser: expat.XMLParserType) -> None:
        super().__init__(message)
        self.line, self.column = parser.CurrentLineNumber, parser.CurrentColumnNumber


class _Reader:
    def __init__(self, source: Source) -> None:
        self._source = source
        self._listing = Listing(source.path.name)
        self._inside: list[str] = []
        self._node: Program | None = None
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.StartDoctypeDeclHandler = self._doctype

    def read(self) -> Listing:
        self._parser.Parse(self._source.text, True)
        return self._listing

    def wrong(self, error: expat.ExpatError) -> str:
        if error.code == _ENDS_TOO_EARLY:
            return f"it ends inside of <{self._inside[-1]}>" if self._inside else "there is nothing in it"
        return expat.ErrorString(error.code)

    def _doctype(self, *_: Any) -> None:
        raise self._refused("a document type is declared, which is not read")

    def _start(self, element: str, attributes: dict[str, str]) -> None:
        self._inside.append(element)
        line = self._parser.CurrentLineNumber
        match self._inside:
            case ["rcmanager"]:
                pass
            case [_]:
                raise self._refused(f"the first element is <{element}>; that of rcmanager is <rcmanager>")
            case ["rcmanager", "generalInformation", *_]:
                pass  # the look of its window
            case ["rcmanager", "node"]:
                self._node = self._program(attributes, line)
                self._listing.programs.append(self._node)
            case ["rcmanager", "node", _] if self._node:
                self._part(self._node, element, attributes, line)
            case [_, _]:
                self._listing.notes.append(Text(f"<{element}> is not understood", line))
            case _:
                pass  # inside an element that has been reported, or has no effect

    def _end(self, element: str) -> None:
        self._inside.pop()

    def _program(self, attributes: dict[str, str], line: int) -> Program:
        name = attributes.pop("alias", "").strip()
        endpoint = attributes.pop("endpoint", "").strip()
        if not name:
            raise self._refused("this <node> has no alias")
        others = [Text(f"the attribute {key}='{value}' is not understood", line) for key, value in attributes.items()]
        return Program(name, line, endpoint=Text(endpoint, line) if endpoint else None, notes=others)

    def _part(self, node: Program, element: str, attributes: dict[str, str], line: int) -> None:
        match element:
            case "dependence":
                node.needs.append(Text(attributes.get("alias", "").strip(), line))
            case "workingDir":
                node.folder = node.folder or attributes.get("path", "").strip()
            case "upCommand":
                _set_command(node, attributes.get("command", "").strip(), line)
            case _ if element not in _WITHOUT_EFFECT:
                node.notes.append(Text(f"<{element}> is not understood", line))

    def _refused(self, message: str) -> _Refused:
        return _Refused(message, self._parser)


def _set_command(node: Program, text: str, line: int) -> None:
    """`rcremote HOST NAME FOLDER COMMAND…` runs COMMAND in FOLDER on HOST."""
    words = text.split(None, 4)
    if len(words) == 5 and PurePosixPath(words[0]).name == "rcremote":
        _, host, _, node.folder, text = words
        node.host = "" if host in HERE else host
    if text:
        node.command = Text(text, line)
