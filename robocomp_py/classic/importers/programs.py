"""The content of an imported file: programs to start, and notes about them."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass, field
from pathlib import PurePosixPath


@dataclass(frozen=True)
class Text:
    """A text of the imported file, or a note about it, with its line."""

    text: str
    line: int


@dataclass
class Program:
    name: str
    line: int
    command: Text | None = None
    folder: str = ""
    """Its working directory; "" if the file does not name it."""
    host: str = ""
    """Its host, if not this one."""
    endpoint: Text | None = None
    """Its proxy in Ice, such as `laser:tcp -h localhost -p 10003`."""
    needs: list[Text] = field(default_factory=list)
    """The names of the programs that must run before."""
    notes: list[Text] = field(default_factory=list)
    """What could not be converted."""


@dataclass
class Listing:
    """The content of the imported file."""

    path: str
    programs: list[Program] = field(default_factory=list)
    notes: list[Text] = field(default_factory=list)


@dataclass(frozen=True)
class Address:
    host: str
    port: str


def address(endpoint: str) -> Address:
    """Host and port of a proxy like `laser:tcp -h localhost -p 10003`; missing ones are ""."""
    host = re.search(r"(?:^|\s)-h\s*(\S+)", endpoint)
    port = re.search(r"(?:^|\s)-p\s*(\d+)", endpoint)
    return Address(host[1] if host else "", port[1] if port else "")


@dataclass(frozen=True)
class CommandLine:
    """What a command starts."""

    words: tuple[str, ...]

    @property
    def python(self) -> bool:
        """Whether it runs a Python file, with or without an explicit interpreter."""
        return self._interpreted or self.words[0].endswith(".py")

    @property
    def name(self) -> str:
        return PurePosixPath(self.words[0]).name

    @property
    def file(self) -> str:
        """The program, or the Python file that it runs."""
        return self.words[1] if self._interpreted else self.words[0]

    @property
    def arguments(self) -> tuple[str, ...]:
        """The arguments after `file`."""
        return self.words[2:] if self._interpreted else self.words[1:]

    @property
    def _interpreted(self) -> bool:
        return bool(_PYTHON.match(self.name)) and len(self.words) > 1 and not self.words[1].startswith("-")


HERE = ("localhost", "127.0.0.1", "::1")
"""Names of this machine."""

_PYTHON = re.compile(r"python(\d(\.\d+)?)?\Z")
_SHELL = re.compile(r"[;&|<>$`*?()\n]")


def command_line(text: str) -> CommandLine | None:
    """The words of a command; None if only a shell understands it."""
    try:
        words = shlex.split(text)
    except ValueError:
        return None
    return CommandLine(tuple(words)) if words and not _SHELL.search(text) else None
