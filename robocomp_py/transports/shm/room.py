"""Checks for free shared memory: a process that writes to missing memory is killed."""

from __future__ import annotations

import errno
import hashlib
import mmap
import os
import pwd
import resource
import stat
from pathlib import Path

from ...errors import TransportError
from .unsafe import populate

SHARED_MEMORY = "/dev/shm"

OPENING = 8 * 1024 * 1024
"""Bytes of shared memory that must be free to open a link, which takes a small part of them."""

CONNECTION = 4 * 1024 * 1024
"""Bytes that a client and its server may take in addition to the messages in use."""

PAGE = mmap.PAGESIZE

_LONG = 256 * 1024
"""From this size on, check first: a request that fails takes the remaining memory before it does."""

FILES = 32
"""Files that an operation may open at once, before it fails for lack of descriptors and closes them again."""


class Full(TransportError):
    """There is not enough shared memory."""


def prefix(folder: Path) -> str:
    """The prefix of all names in shared memory, for a folder and its user. The secret follows it."""
    return "rc" + hashlib.sha256(f"{os.getuid()}:{folder.resolve()}".encode()).hexdigest()[:8] + "_"


def free() -> int:
    """Free bytes of shared memory."""
    try:
        found = os.statvfs(SHARED_MEMORY)
    except OSError as exc:
        raise TransportError(f"shm: {SHARED_MEMORY}: {exc.strerror}") from exc
    return found.f_bavail * found.f_frsize


def check_room(size: int) -> None:
    """Raise `Full` unless this many bytes are left: a process that writes to missing memory is killed."""
    left = free()
    if left < size:
        raise full(size, left)


def crowded(connections: int) -> str:
    """Why the shared memory of this host is too small for this many connections; "" if it is not.

    The size of their messages is not known. The total size of the memory counts, not what is free now, so that the
    result stays the same while a network runs.
    """
    try:
        found = os.statvfs(SHARED_MEMORY)
    except OSError as exc:
        return f"{SHARED_MEMORY}: {exc.strerror}"
    needed, size = OPENING + connections * CONNECTION, found.f_blocks * found.f_frsize
    if needed <= size:
        return ""
    return (
        f"{connections} connection{'s' * (connections > 1)} may take {needed >> 20} MB of shared memory, and "
        f"{SHARED_MEMORY} has {size >> 20} MB; "
        f"make it larger (mount -o remount,size=2G {SHARED_MEMORY}; for a container, --shm-size=2g)"
    )


def own(address: int, size: int, missing: int) -> None:
    """Allocate memory at these addresses, of which `missing` bytes have none yet. Raises `Full`."""
    if missing >= _LONG:
        check_room(missing)
    if error := populate(address, size, PAGE):
        left = free()
        if error != errno.EINVAL or left < missing:
            raise full(missing, left)


def is_owned(address: int, size: int) -> bool:
    """The same; False if nothing is mapped there. Raises `Full` if there is too little memory."""
    error = populate(address, size, PAGE)
    if error not in (0, errno.EINVAL, errno.ENOMEM):
        raise full(PAGE, free())
    return error == 0


def full(size: int, left: int) -> Full:
    return Full(
        f"shm: {size} bytes of shared memory are needed, and {left} are left in {SHARED_MEMORY}; make it larger "
        f"(mount -o remount,size=2G {SHARED_MEMORY}; for a container, --shm-size=2g), or choose another middleware"
    )


def spare_files(most: int) -> int:
    """The number of files that this process can open now, at most `most`."""
    opened: list[int] = []
    try:
        opened.append(os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC))
        while len(opened) < most:
            opened.append(os.dup(opened[0]))
    except OSError as exc:
        if exc.errno not in (errno.EMFILE, errno.ENFILE):
            return most
    finally:
        for each in opened:
            os.close(each)
    return len(opened)


def what_is_short() -> str:
    """A remedy for a lack of descriptors, which iceoryx2 reports as an internal failure; "" if there are enough."""
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        used = len(os.listdir("/proc/self/fd"))
    except OSError:  # no descriptor is left even for this
        used = limit
    if used + FILES < limit:
        return ""
    return f"; this process has {used} files open, and may have {limit}: let it have more (ulimit -n 4096)"


def hindrance(path: Path) -> str:
    """The owner of a foreign file and the remedy; "" if the file is our own or missing."""
    try:
        found = path.lstat()
    except OSError:
        return ""
    if found.st_uid == os.geteuid() and stat.S_ISREG(found.st_mode):
        return ""
    try:
        owner = pwd.getpwuid(found.st_uid).pw_name
    except KeyError:
        owner = f"number {found.st_uid}"
    return f"; {path} belongs to user {owner} and is in the way: have it removed (sudo rm -r {path})"
