"""Warns before a limit of the system is reached, with what to raise.

    file descriptors     of this process: `ulimit -n`
    inotify watches      of the user: fs.inotify.max_user_watches; only those of this process are counted
    inotify instances    of the user: fs.inotify.max_user_instances; only those of the run-time folder are counted

The runtime asks when a component is ready, and when it has opened further links. Each limit is told once in a process.
"""

from __future__ import annotations

import contextlib
import logging
import os
import resource
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from .runtime_folder import runtime_dir

log = logging.getLogger("robocomp.transport")

_SHARE = 0.8
"""The share of a limit from which on it is told."""

_ENOUGH = 4096
"""Descriptors for dozens of publications and subscriptions with all their peers."""

_INOTIFY = Path("/proc/sys/fs/inotify")

_telling = threading.Lock()
_told: set[str] = set()


@dataclass(frozen=True, slots=True)
class Limit:
    """A limit of the system, and how much of it is used."""

    what: str
    used: int
    limit: int
    then: str
    """What happens at the limit."""
    remedy: str
    """The command that raises it."""

    @property
    def is_near(self) -> bool:
        return self.used >= _SHARE * self.limit


def check(owner: str) -> None:
    """Log a warning for each limit that is near, unless that was done before in this process."""
    for each in _limits():
        with _telling:
            if not each.is_near or each.what in _told:
                continue
            _told.add(each.what)
        log.warning(
            "%s: %d of %d %s are in use. At the limit, %s. Raise it: %s",
            owner or "component",
            *(each.used, each.limit, each.what, each.then, each.remedy),
        )


def _limits() -> Iterator[Limit]:
    with contextlib.suppress(OSError):  # /dev/fd cannot be read, or there is no inotify: nothing is known
        limit, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        if limit != resource.RLIM_INFINITY:
            yield _descriptors(len(os.listdir("/dev/fd")) - 1, limit, hard)  # without the one that reads
        if watches := _watches():
            yield _of_inotify("watches", watches)
            yield _of_inotify("instances", _instances())


def _descriptors(used: int, limit: int, hard: int) -> Limit:
    wanted = max(_ENOUGH, 2 * limit)
    remedy = f"ulimit -n {wanted}"
    if hard not in (resource.RLIM_INFINITY, limit) and hard < wanted:
        remedy = f"ulimit -n {hard}"
    elif hard == limit:
        remedy += " (as root, since the hard limit is reached; for good, `nofile` in /etc/security/limits.conf)"
    return Limit("file descriptors", used, limit, "no further peer can connect", remedy)


def _of_inotify(what: str, used: int) -> Limit:
    limit = int((_INOTIFY / f"max_user_{what}").read_text())
    raised = f"sysctl fs.inotify.max_user_{what}={max(1024, 2 * limit)}"
    return Limit(f"inotify {what}", used, limit, "changes are looked for twice a second instead of reported", raised)


def _watches() -> int:
    """The watches of this process."""
    number = 0
    for descriptor in os.listdir("/dev/fd"):
        with contextlib.suppress(OSError):  # closed meanwhile
            if os.readlink(f"/proc/self/fd/{descriptor}") == "anon_inode:inotify":
                number += Path(f"/proc/self/fdinfo/{descriptor}").read_text().count("inotify wd:")
    return number


def _instances() -> int:
    """The open transports in the run-time folder: each has one, and a file that is locked."""
    return sum(
        1
        for folder in runtime_dir().iterdir()
        if folder.is_dir()
        for name in os.listdir(folder)
        if name.endswith(".lock") and "-" in name
    )
