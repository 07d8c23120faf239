"""The directory: it lists the open transports of this host, one file each, in a private folder of the user.

    <run-time folder>/<transport>/<id>.json         what it offers and wants; replaced atomically
    <run-time folder>/<transport>/<id>.lock         locked while its process lives
    <run-time folder>/<transport>/by/<place>/<id>   a symbolic link to the first: the member uses channels of this place

The first two are a member, which `membership` writes; see `places` for the third. A lock that can be taken belongs to a
dead process; the member that notices this removes its files.
"""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from weakref import WeakValueDictionary

from ..errors import TransportError
from .census import Told
from .exclusive import SWEPT, is_gone, is_swept, left_in, mark_swept, sweep
from .inotify import Watch
from .members import Entry, Found, Member, member_in, understood
from .membership import Membership
from .places import INDEX, OF_MEMBERS, content_of, make_place, places_of, places_of_dead, remove_all
from .runtime_folder import as_transport_error, runtime_dir

log = logging.getLogger("robocomp.transport")

LONGEST_SOCKET = 107
"""Maximum bytes in the path of a socket; a limit of the kernel."""

_SETTLED = 0.1
"""Seconds after a change in which a place is read again, since its time stamp is too coarse to show a second change."""

_UNTOLD = 0.5
"""Seconds between two looks if the system does not report changes."""

_ROLL_CALL = 1.0
"""Seconds between two checks whether found members live, while their places change."""

_MOST_ASKED = 10_000


def census(transport: str) -> list[Told]:
    """What the members of a transport announce now, in the order of their identifiers. The caller does not become one.

    Raises TransportError.
    """
    folder = runtime_dir(transport)
    found: list[Told] = []
    try:
        for name in sorted(os.listdir(folder)):
            if name.endswith(".json"):
                found += _living(folder, name.removesuffix(".json"))
    except FileNotFoundError:
        return []  # nothing uses it
    except OSError as exc:
        raise TransportError(f"run-time folder {folder} cannot be read: {exc.strerror}") from exc
    return found


def announcing() -> list[str]:
    """The transports whose members have announced something here. Raises ConfigurationError, TransportError."""
    folder = runtime_dir()
    try:
        return sorted(each.parent.name for each in folder.glob(f"*/{INDEX}"))
    except OSError as exc:
        raise TransportError(f"run-time folder {folder} cannot be read: {exc.strerror}") from exc


def _living(folder: Path, member_id: str) -> Sequence[Told]:
    """What a member announces, if it lives."""
    try:
        told = _told(content_of(folder / f"{member_id}.json"), member_id)
    except FileNotFoundError:
        return ()  # it has just left
    return told if _locked(folder / f"{member_id}.lock") else ()


@lru_cache(2000)
def _told(raw: bytes, name: str) -> tuple[Told, ...]:
    """What the file of a member announces. It seldom changes, and takes much longer to understand than to read."""
    member = understood(raw, name)
    if member is None:
        return ()
    return tuple(
        Told(member.owner, member.pid, entry.role, entry.channel, entry.fingerprint, entry.text, entry.traits)
        for entry in member.entries
    )


@dataclass(frozen=True)
class _File:
    """The file of a member."""

    stamp: tuple[int, int, int]
    member: Member | None
    """None if it cannot be understood."""


class _Place:
    """What was read of a place."""

    def __init__(self, folder: str) -> None:
        self.folder = folder
        self.files: dict[str, _File] = {}
        """By member."""
        self.sought: set[tuple[str, str]] = set()
        """The roles and channels that this process looks for here."""
        self.stamp = -1, 0
        self.changed_at = 0.0
        self.settled = False
        """Whether it was read long enough after its last change that nothing was missed."""


class Directory:
    """The members of one transport. Safe to use from any thread.

    While it cannot be read (no file descriptor is left, for example), that is logged once, and the
    last contents remain valid. A folder that was removed has no members.
    """

    def __init__(self, folder: Path) -> None:
        with as_transport_error(folder):
            folder.mkdir(mode=0o700, exist_ok=True)
        self._folder = folder
        self._watch: Watch | None = None
        self._on_change: Callable[[], object] = _nothing
        self._lock = threading.Lock()
        self._places: dict[str, _Place] = {}
        """By name: the places that this process looks into."""
        self._files: WeakValueDictionary[str, _File] = WeakValueDictionary()
        """By member: places share the file of a member that is in many of them."""
        self._found: dict[tuple[str, str], dict[str, list[Found]]] = {}
        """The results by role and channel, then by member."""
        self._roll_call = 0.0
        self._stopped: dict[str, float] = {}
        """By member: since when its process is known to be stopped (SIGSTOP)."""
        self._unreadable = False
        self._version = 0

    def watch(self, watch: Watch, on_change: Callable[[], object]) -> None:
        """From now on, look only at folders that this watch reports, as far as it can watch them.

        `on_change` is called when the version has changed, on the thread that noticed it.
        """
        self._watch, self._on_change = watch, on_change

    def stop_watching(self) -> None:
        """Called before leaving: a folder that the last member removes must not be created again by a look into it."""
        with self._lock:
            self._watch = None

    @property
    def pause(self) -> float:
        """Seconds until the next look, or 0 if the watch reports all changes."""
        watch = self._watch
        told = watch and watch.able and all([watch.watches(place.folder) for place in list(self._places.values())])
        return 0.0 if told else _UNTOLD

    def join(self, owner: str) -> Membership:
        """Become a member. Files of members that were killed while joining are removed, too."""
        with contextlib.suppress(OSError):
            if not is_swept(self._folder):
                left = {os.path.splitext(name)[0] for name in os.listdir(self._folder) if name.endswith(OF_MEMBERS)}
                mark_swept(self._folder, len(left))
                for name in left:
                    pid = name.partition("-")[0]
                    if pid.isdecimal() and is_gone(int(pid)):
                        self.alive(name)
        return Membership(self._folder, owner)

    def version(self) -> int:
        """A number that grows when a result of `find` changes. Cheap while nothing changes."""
        with self._looked():
            return self._version

    def find(self, role: str, channel: str) -> list[Found]:
        """Links of a channel in that role; either channel may have `*` for its instance."""
        with self._looked():
            known = self._found.get((role, channel))
            if known is None:
                known = self._search(role, channel)
            return [found for name in sorted(known) for found in known[name]]

    def still_has(self, member_id: str, entry: Entry) -> bool:
        """Whether the entry is in this folder now, and its process lives."""
        try:
            entries = member_in(content_of(self._folder / f"{member_id}.json"), member_id).entries
        except (OSError, ValueError, TypeError, KeyError):
            return False
        return entry in entries and self.alive(member_id)

    def alive(self, member_id: str) -> bool:
        """Whether a member's process lives. Removes the files of a dead one."""
        if _locked(self._folder / f"{member_id}.lock"):
            return True
        with contextlib.suppress(OSError):
            remove_all(self._folder, member_id, places_of_dead(self._folder, member_id))
        return False

    def responds(self, member: Member, within: float) -> bool:
        """Whether a member's process lives, and has not been stopped (by SIGSTOP, for example) for `within` seconds."""
        if self.alive(member.id) and state_of(member.pid) != "T":
            self._stopped.pop(member.id, None)
            return True
        now = time.monotonic()
        return self.alive(member.id) and now - self._stopped.setdefault(member.id, now) < within

    @contextlib.contextmanager
    def _looked(self) -> Iterator[None]:
        """With the lock, and after reading what has changed."""
        with self._lock:
            before = self._version
            try:
                self._refresh()
            except OSError as exc:
                self._complain(exc)
            is_news = self._version != before
            yield
        if is_news:
            self._on_change()

    def _complain(self, exc: OSError) -> None:
        if not self._unreadable:
            log.warning("run-time folder %s cannot be read now: %s", self._folder, exc.strerror)
        self._unreadable = True

    def _refresh(self) -> None:
        watch = self._watch
        if watch:
            for folder in watch.changed():
                if place := self._places.get(os.path.basename(folder)):
                    place.settled = False
        for place in self._places.values():
            if not (place.settled and watch and watch.watches(place.folder)):
                self._look_into(place)

    def _look_into(self, place: _Place) -> None:
        """Read the members of a place, if they may have changed."""
        told = self._watch is not None and _watched(self._watch, place.folder)
        stamp = _stamp_of_folder(place.folder)
        now = time.monotonic()  # after the stamp: this thread may have been stopped before
        if stamp != place.stamp:
            place.changed_at, place.settled = now, False
        elif place.settled:
            return
        place.stamp, place.settled = (-1, 0), False  # in case reading fails
        gone = self._read(place)
        self._unreadable = False
        place.stamp, place.settled = stamp, told or now - place.changed_at >= _SETTLED
        for name in gone:
            self._stopped.pop(name, None)
        is_roll_call = now >= self._roll_call
        if is_roll_call:
            self._roll_call = now + _ROLL_CALL
        for role, channel in place.sought:
            found = self._matching(role, channel, is_roll_call=is_roll_call)
            self._version += found != self._found[role, channel]
            self._found[role, channel] = found

    def _read(self, place: _Place) -> Collection[str]:
        """Read the files of the members of a place; returns the members that have left."""
        try:
            names = os.listdir(place.folder)
        except FileNotFoundError:
            names = []
        files: dict[str, _File] = {}
        for name in names:
            path = os.path.join(self._folder, f"{name}.json")
            try:
                stamp = _stamp(os.stat(path))
                known = self._files.get(name)
                if known is None or known.stamp != stamp:
                    known = self._files[name] = _File(stamp, understood(content_of(path), name))
                files[name] = known
            except FileNotFoundError:  # it has left
                self.alive(name)  # or was killed while leaving
        gone = place.files.keys() - files.keys()
        place.files = files
        return gone

    def _matching(self, role: str, channel: str, *, is_roll_call: bool) -> dict[str, list[Found]]:
        """By member, its matching links. Members found before are checked for life only at a roll call."""
        before = self._found.get((role, channel), {})
        result = {}
        for place in map(self._places.__getitem__, places_of(channel).sought()):
            for name, file in place.files.items():
                found = list(file.member.facing(role, channel)) if file.member else []
                if found and ((not is_roll_call and before.get(name) == found) or self.alive(name)):
                    result[name] = found
        return result

    def _search(self, role: str, channel: str) -> dict[str, list[Found]]:
        if len(self._found) >= _MOST_ASKED:
            self._found.clear()
            self._places.clear()
        try:
            for name in places_of(channel).sought():
                if name not in self._places:
                    place = _Place(os.path.join(self._folder, INDEX, name))
                    self._look_into(place)
                    self._places[name] = place
        except OSError as exc:
            self._complain(exc)
            self._version += 1  # so that the caller looks again
            return {}
        for name in places_of(channel).sought():
            self._places[name].sought.add((role, channel))
        self._found[role, channel] = self._matching(role, channel, is_roll_call=True)
        return self._found[role, channel]


def _nothing() -> None:
    """The default callback."""


def _stamp_of_folder(folder: str) -> tuple[int, int]:
    try:
        info = os.stat(folder)
    except FileNotFoundError:
        return 0, 0
    return info.st_ino, info.st_mtime_ns


def _stamp(info: os.stat_result) -> tuple[int, int, int]:
    """Differs between any two writes of a file: the clock of a file system is too coarse, and it uses the number of a
    removed file again, so the writer sets the time."""
    return info.st_ino, info.st_size, info.st_mtime_ns


def _watched(watch: Watch, place: str) -> bool:
    if watch.able and not watch.watches(place):
        with contextlib.suppress(OSError):  # also if the folder was removed: it has no members
            make_place(place)
            watch.add(place)
    return watch.watches(place)


def _locked(path: Path) -> bool:
    try:
        probe = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    except OSError:
        return True  # unknown; a living process must not be taken for dead
    try:
        fcntl.flock(probe, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(probe)
    return False


def state_of(pid: int, proc: Path = Path("/proc")) -> str:
    """The letter of Linux for the state of a process (`T`: stopped, `Z`: ended); "" if it is unknown."""
    try:
        status = (proc / str(pid) / "stat").read_text()
    except OSError:
        return ""
    return status.rpartition(")")[2].strip()[:1]


def members_of(folder: Path) -> tuple[int, int]:
    """How many living members a folder has, and how many files killed processes have left. Raises OSError."""
    if not folder.is_dir():
        return 0, 0
    ids = {os.path.splitext(name)[0] for name in os.listdir(folder) if name.endswith(OF_MEMBERS)}
    members = {name: int(pid) for name in ids if (pid := name.partition("-")[0]).isdecimal()}
    dead = {name for name, pid in members.items() if is_gone(pid)}
    claims = {os.path.splitext(name)[0] for name in left_in(folder)} - dead
    below = [each for each in folder.iterdir() if each.is_dir() and each.name != INDEX]
    return len(members) - len(dead), len(dead) + len(claims) + sum(len(left_in(each)) for each in below)


def clear(folder: Path) -> bool:
    """Remove what killed processes left in the folder of a transport; whether members were among them.

    The next member does so, too. This is for a program that has ended processes, since no further member may come.
    Raises OSError; files that could not be removed are harmless.
    """
    members = {os.path.splitext(name)[0] for name in os.listdir(folder) if name.endswith(OF_MEMBERS)}
    gone = [name for name in members if (pid := name.partition("-")[0]).isdecimal() and is_gone(int(pid))]
    directory = Directory(folder)
    found = [name for name in gone if not directory.alive(name)]
    for each in (folder, *(below for below in folder.iterdir() if below.is_dir() and below.name != INDEX)):
        (each / SWEPT).unlink(missing_ok=True)  # a recent sweep may have seen these processes alive
        sweep(each)
        (each / SWEPT).unlink(missing_ok=True)
    return bool(found)
