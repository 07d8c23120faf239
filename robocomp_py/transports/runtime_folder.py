"""The run-time folder: where the processes of a user on this host find each other.

It is `$ROBOCOMP_RUNTIME_DIR`, or `$XDG_RUNTIME_DIR/robocomp`, or `robocomp-<uid>` in the folder for temporary files;
always mode 0700, never a symbolic link (see `owned.py`).
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

from ..errors import ConfigurationError, TransportError
from .owned import NotOurs, make_private


def runtime_dir(*below: str) -> Path:
    """The folder for sockets and directory files, created if it is missing; with `below`, a subfolder, not created.

    Raises ConfigurationError if a folder on the way belongs to another user, is a symbolic link, or is open to others.
    """
    if chosen := os.environ.get("ROBOCOMP_RUNTIME_DIR"):
        folder = Path(chosen)
    elif base := os.environ.get("XDG_RUNTIME_DIR"):
        folder = Path(base, "robocomp")
    else:
        folder = _temporary() / f"robocomp-{os.getuid()}"
    try:
        make_private(folder, below)
    except NotOurs as exc:
        raise ConfigurationError(f"run-time folder {folder} {exc}, or set ROBOCOMP_RUNTIME_DIR") from exc
    except OSError as exc:
        if exc.errno in (errno.EMFILE, errno.ENFILE, errno.ENOMEM):  # another folder would not help
            raise TransportError(f"run-time folder {folder}: {exc.strerror}") from exc
        raise ConfigurationError(f"run-time folder {folder}: {exc.strerror}; set ROBOCOMP_RUNTIME_DIR") from exc
    return folder.joinpath(*below)


def _temporary() -> Path:
    import tempfile  # this takes a while, and most environments name a folder

    try:
        return Path(tempfile.gettempdir())
    except OSError as exc:  # it tries to write a file, which fails without free descriptors, for example
        raise ConfigurationError(f"run-time folder: {exc.strerror}; set ROBOCOMP_RUNTIME_DIR") from exc


@contextlib.contextmanager
def as_transport_error(folder: Path) -> Iterator[None]:
    """Turn an error of writing there into a TransportError."""
    try:
        yield
    except OSError as exc:
        raise TransportError(f"run-time folder {folder} cannot be written: {exc.strerror}") from exc
