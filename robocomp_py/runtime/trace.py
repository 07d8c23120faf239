"""Tracebacks for the author of a component: their own lines, without those of this package."""

from __future__ import annotations

import traceback
from pathlib import Path

from ..errors import RobocompError

_PACKAGE = Path(__file__).parent.parent
_PLUMBING = tuple(str(_PACKAGE / part) for part in ("runtime", "transports", "wire", "cli", "compat"))
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


def _is_plumbing(file: str) -> bool:
    return file.startswith((*_PLUMBING, *_NO_FILES)) or "/importlib/" in file
