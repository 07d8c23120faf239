"""A user's file replaced by another version of it."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import tempfile
from pathlib import Path


def replace_file(path: Path, data: bytes) -> None:
    """Give a file that content, all of it or none. A link stays one: what it leads to is replaced."""
    path = Path(os.path.realpath(path))
    if not os.access(path, os.W_OK):  # or a file that is protected would be replaced by one that is not
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
