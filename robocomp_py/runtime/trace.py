"""Tracebacks for the author of a component: their own lines, without those of this package."""

from __future__ import annotations

import os
import traceback
from collections.abc import Hashable
from pathlib import Path
from types import FrameType

from ..errors import RobocompError

_PACKAGE = Path(__file__).parent.parent
_PLUMBING = f"{_PACKAGE}{os.sep}"
_NO_FILES = ("<frozen ", "<robocomp_py")


def user_trace(exc: BaseException) -> str:
    """What Python would print of an exception, less the frames that its reader did not write.

    What led to an error of this package's own, whose message says all, is left out, too.
    """
    told = traceback.TracebackException.from_exception(exc)
    if isinstance(exc, RobocompError):
        told.__cause__ = told.__context__ = None
    part: traceback.TracebackException | None = told
    while part is not None:
        kept = [frame for frame in part.stack if not _is_plumbing(frame.filename)]
        if kept or isinstance(exc, SyntaxError):  # which names its own place
            part.stack = traceback.StackSummary.from_list(kept)
        part = part.__cause__ or part.__context__
    return "".join(told.format()).rstrip()


def frames_in(folder: Path, exc: BaseException) -> list[tuple[FrameType, int]]:
    """What of the files in a folder led to an exception, from the outside in, and the lines."""
    frames = traceback.walk_tb(exc.__traceback__)
    return [(at, line) for at, line in frames if Path(at.f_code.co_filename).is_relative_to(folder)]


def way_of(exc: BaseException) -> Hashable:
    """Equal for exceptions that come from the same lines by the same calls."""
    return type(exc), tuple((at.f_code.co_filename, line) for at, line in traceback.walk_tb(exc.__traceback__))


def times_more(number: int) -> str:
    """What is told below an exception of those before it that were like it, and left out."""
    return f"\n(and {number} times since this was told last)" if number else ""


def _is_plumbing(file: str) -> bool:
    return file.startswith((_PLUMBING, *_NO_FILES)) or "/importlib/" in file
