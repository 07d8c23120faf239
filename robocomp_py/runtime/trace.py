"""Tracebacks for the author of a component, without the frames of this package."""

from __future__ import annotations

import logging
import os
import sys
import traceback
from collections.abc import Hashable
from pathlib import Path
from types import FrameType

from ..errors import RobocompError
from ..spelling import closest

log = logging.getLogger(__name__)

_PACKAGE = Path(__file__).parent.parent
_PLUMBING = f"{_PACKAGE}{os.sep}"
_STANDARD = f"{Path(os.__file__).parent}{os.sep}"
_NO_FILES = ("<frozen ", "<robocomp_py")


def user_trace(exc: BaseException) -> str:
    """The traceback of an exception, without the frames of this package.

    An error of this package is shown without its causes, because its message is complete.
    """
    told = traceback.TracebackException.from_exception(exc)
    if isinstance(exc, RobocompError):
        told.__cause__ = told.__context__ = None
    part: traceback.TracebackException | None = told
    while part is not None:
        kept = [frame for frame in part.stack if not _is_plumbing(frame.filename)]
        if kept or isinstance(exc, SyntaxError):  # a SyntaxError states its place itself
            part.stack = traceback.StackSummary.from_list(kept)
        part = part.__cause__ or part.__context__
    return "".join(told.format()).rstrip() + _meant(exc)


def _meant(exc: BaseException) -> str:
    """The attribute that was meant by a misspelt one, as Python's own traceback has it on a terminal; or ""."""
    if sys.version_info >= (3, 12) or not isinstance(exc, AttributeError):  # 3.12 has it in `traceback`
        return ""
    if exc.name is None or not str(exc).endswith(f" has no attribute {exc.name!r}"):  # others propose by themselves
        return ""
    try:
        near = closest(exc.name, dir(exc.obj))
    except Exception:  # of a `__dir__` that is not ours: then there is no proposal
        log.debug("the attributes of %s cannot be listed", type(exc.obj).__name__, exc_info=True)
        return ""
    return f". Did you mean: {near!r}?" if near else ""


def frames_in(folder: Path, exc: BaseException) -> list[tuple[FrameType, int]]:
    """The frames of an exception in files of a folder, outermost first, with their lines."""
    frames = traceback.walk_tb(exc.__traceback__)
    return [(at, line) for at, line in frames if Path(at.f_code.co_filename).is_relative_to(folder)]


def way_of(exc: BaseException) -> Hashable:
    """A key that is equal for exceptions of the same type raised at the same lines."""
    return type(exc), tuple((at.f_code.co_filename, line) for at, line in traceback.walk_tb(exc.__traceback__))


def times_more(number: int) -> str:
    """The line below an exception that says how many equal ones were not logged; "" if there were none."""
    return f"\n(and {number} more times since it was last logged)" if number else ""


def place_of(thread: int | None) -> str:
    """What code of a component a thread is at: its method, file and line; "" if it is in none."""
    frame = sys._current_frames().get(thread) if thread else None
    place = method = ""
    while frame and not (place and _is_plumbing(frame.f_code.co_filename)):
        code = frame.f_code
        if not (_is_plumbing(code.co_filename) or _is_library(code.co_filename)):
            place = place or f"{code.co_filename}:{frame.f_lineno}"
            method = code.co_qualname
        frame = frame.f_back
    return f"{method} at {place}" if place else ""


def _is_library(file: str) -> bool:
    return file.startswith(_STANDARD) or f"{os.sep}site-packages{os.sep}" in file


def _is_plumbing(file: str) -> bool:
    return file.startswith((_PLUMBING, *_NO_FILES)) or "/importlib/" in file
