"""Replaces a user's file by a new version."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import tempfile
from pathlib import Path


def replace_file(path: Path, data: bytes) -> None:
    """Replace the content of a file completely or not at all. A link stays: its target is replaced."""
    path = Path(os.path.realpath(path))
    if not os.access(path, os.W_OK):  # otherwise a protected file would be replaced by an unprotected one
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    was = path.stat()
    descriptor, name = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
    new = Path(name)
    try:
        with open(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(descriptor)
        with contextlib.suppress(PermissionError):  # another user's file becomes ours, as with any editor
            os.chown(new, was.st_uid, was.st_gid)
        new.chmod(stat.S_IMODE(was.st_mode))
        new.replace(path)
    except BaseException:
        new.unlink(missing_ok=True)
        raise
