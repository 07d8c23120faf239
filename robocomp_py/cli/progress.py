"""Shows the progress of commands that take longer than a second, on a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from types import TracebackType
from typing import Self, TextIO, TypeVar

T = TypeVar("T")

_FIRST, _NEXT = 1.0, 0.1
"""Seconds until progress is shown, and between two updates."""


class Progress:
    """One line on stderr that is rewritten, and erased at the end. Prints nothing if stderr is no terminal."""

    def __init__(self, name: str, to: TextIO | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._name, self._to, self._clock = name, to or sys.stderr, clock
        self._due = clock() + _FIRST
        self._is_shown = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.erase()

    def over(self, items: Sequence[T], doing: str) -> Iterator[T]:
        """Yield the items, and show how many of them are done."""
        for number, each in enumerate(items):
            self.show(f"{doing}: {number} of {len(items)}")
            yield each
        self.erase()

    def show(self, text: str) -> None:
        now = self._clock()
        if now >= self._due and self._to.isatty():
            self._due = now + _NEXT
            self._is_shown = True
            import shutil

            width = shutil.get_terminal_size().columns - 1  # a line that wraps could not be erased
            self._write(f"\r\x1b[K{f'{self._name}: {text}'[:width]}")

    def erase(self) -> None:
        """Erase the line, before other output."""
        if self._is_shown:
            self._is_shown = False
            self._write("\r\x1b[K")

    def _write(self, text: str) -> None:
        self._to.write(text)
        self._to.flush()
