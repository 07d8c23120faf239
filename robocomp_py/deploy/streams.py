"""Output streams that can no longer be written, as with a full disk or a closed pipe."""

from __future__ import annotations

import contextlib
import os
from typing import Any, TextIO


class Output:
    """A stream that may fail to be written, as with a full disk or a closed pipe.

    A network must not stop because its output cannot be written: the rest is dropped, with one message.
    """

    def __init__(self, stream: TextIO, complaints: TextIO) -> None:
        self._stream, self._complaints = stream, complaints
        self._works = True

    def write(self, text: str) -> int:
        if self._works:
            try:
                self._stream.write(text)
            except OSError as exc:
                self._give_up(exc)
        return len(text)

    def flush(self) -> None:
        if self._works:
            try:
                self._stream.flush()
            except OSError as exc:
                self._give_up(exc)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _give_up(self, exc: OSError) -> None:
        self._works = False
        discard(self._stream)
        with contextlib.suppress(OSError):
            print(
                f"rcdeploy: output is lost from here on; the network keeps running: {exc.strerror}",
                file=self._complaints,
            )


def discard(stream: TextIO) -> None:
    """Point a failed stream to /dev/null, or its buffer fails again when Python ends."""
    with contextlib.suppress(OSError), open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())
