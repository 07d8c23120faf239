"""Files of private keys must not be readable by other users."""

from __future__ import annotations

import os
from pathlib import Path

from ..errors import ConfigurationError


def insist_private(path: Path, option: str) -> None:
    """Raises ConfigurationError, in the name of an option, if others may read that file; OSError if it is not there."""
    _insist(path.stat(), path, option)


def read_private(path: Path, option: str) -> str:
    """The text of a file, checked as by `insist_private`; what is checked is what is read.

    Also raises UnicodeDecodeError if it is not UTF-8.
    """
    with path.open(encoding="utf-8") as file:
        _insist(os.fstat(file.fileno()), path, option)
        return file.read()


def _insist(info: os.stat_result, path: Path, option: str) -> None:
    if excess(info.st_mode, info.st_uid, os.getuid()):
        may = allowed(info.st_uid, os.getuid())
        raise ConfigurationError(f"{option}: {path} is open to other users; chmod {may:o} {path}")


def excess(mode: int, owner: int, us: int) -> int:
    """The bits of a mode that allow others too much; 0 if there are none."""
    return mode & 0o077 & ~allowed(owner, us)


def allowed(owner: int, us: int) -> int:
    """The widest mode of a private key, by PostgreSQL's rule.

    A group may read a file of root: so an administrator gives a key to one user, as Kubernetes does.
    """
    return 0o640 if owner == 0 != us else 0o600
