"""The directory: it lists the open transports of this host, one file each, in a private folder of the user.

    <run-time folder>/<transport>/<id>.json         what it offers and wants; replaced atomically
    <run-time folder>/<transport>/<id>.lock         locked while its process lives
    <run-time folder>/<transport>/by/<place>/<id>   a symbolic link to the first: the member uses channels of this place

A place stands for one interface of one instance. A member that looks for it reads that place only. Each interface
has two more places: one for members that name no instance, and one for all members. See `_Places`.

A lock that can be taken belongs to a dead process; the member that notices this removes its files.
The run-time folder is `$ROBOCOMP_RUNTIME_DIR`, or `$XDG_RUNTIME_DIR/robocomp`, or
`robocomp-<uid>` in the folder for temporary files; always mode 0700, never a symbolic link (see `owned.py`).
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import logging
import os
import secrets
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakValueDictionary

from ..errors import ConfigurationError, TransportError
from ..wire.names import ANY, matches
from .census import Told
from .exclusive import SWEPT, file_name, is_gone, is_swept, left_in, mark_swept, sweep
from .inotify import UNWATCHED, Watch
from .owned import NotOurs, make_private

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

_INDEX = "by"

_OF_MEMBERS = (".json", ".lock")
"""Suffixes of the files of members. A member that was killed while leaving may have no lock any more."""

_TRIES = 100
"""Maximum attempts to create a place that leaving members remove again."""

_ALL = "**"
"""Stands for the instance in the name of a place for all members."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One link. `role` says which end of the channel it is, in the words of the transport."""

    role: str
    channel: str
    fingerprint: int
    text: str
    address: str = ""
    traits: str = ""
    """What it offers, as `contract.qos.traits` writes it."""


@dataclass(frozen=True, slots=True)
class Member:
    """One open transport and its entries."""

    id: str
    owner: str
    pid: int
    entries: tuple[Entry, ...]

    def facing(self, role: str, channel: str) -> Iterator[Found]:
        """Its links of a channel in that role; either channel may have `*` for its instance."""
        for entry in self.entries:
            if entry.role == role and (matches(channel, entry.channel) or matches(entry.channel, channel)):
                yield Found(self, entry)


class Found(NamedTuple):
    """A link in the directory: its entry, and the member that announces it."""

    member: Member
    entry: Entry

    @property
    def channel(self) -> str:
        return self.entry.channel

    @property
    def fingerprint(self) -> int:
        return self.entry.fingerprint

    @property
    def text(self) -> str:
        return self.entry.text

    @property
    def key(self) -> tuple[str, int]:
        return self.member.id, self.entry.fingerprint


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
    try:
        return Path(tempfile.gettempdir())
    except OSError as exc:  # it tries to write a file, which fails without free descriptors, for example
        raise ConfigurationError(f"run-time folder: {exc.strerror}; set ROBOCOMP_RUNTIME_DIR") from exc


def census(transport: str) -> list[Told]:
    """What the members of a transport announce now. The caller does not become one. Raises TransportError."""
    return [
        Told(member.owner, member.pid, entry.role, entry.channel, entry.fingerprint, entry.text, entry.traits)
        for member in _members(runtime_dir(transport))
        for entry in member.entries
    ]


def announcing() -> list[str]:
    """The transports whose members have announced something here. Raises ConfigurationError, TransportError."""
    folder = runtime_dir()
    try:
        return sorted(each.parent.name for each in folder.glob(f"*/{_INDEX}"))
    except OSError as exc:
        raise TransportError(f"run-time folder {folder} cannot be read: {exc.strerror}") from exc


def _members(folder: Path) -> list[Member]:
    """All members that live, in the order of their identifiers."""
    members = []
    try:
        for name in sorted(os.listdir(folder)):
            if name.endswith(".json") and (member := _living(folder, name.removesuffix(".json"))):
                members.append(member)
    except FileNotFoundError:
        return []  # nothing uses it
    except OSError as exc:
        raise TransportError(f"run-time folder {folder} cannot be read: {exc.strerror}") from exc
    return members


def _living(folder: Path, member_id: str) -> Member | None:
    try:
        member = _understood(_content(folder / f"{member_id}.json"), member_id)
    except FileNotFoundError:
        return None  # it has just left
    return member if member and _locked(folder / f"{member_id}.lock") else None


class _Places(NamedTuple):
    """The places of a channel.

    They are named by the part of its name that all operations of its interface share: `robot/world/Laser`.
    """

    own: str
    """For members that use exactly this name."""
    all: str
    """For all members of this interface, with or without an instance."""
    star: str
    """For members that name no instance; equals `own` if the channel names none."""

    def sought(self) -> tuple[str, ...]:
        """The places to look into for peers of the channel."""
        return (self.all,) if self.own == self.star else (self.own, self.star)

    def announced(self) -> tuple[str, ...]:
        """The places where users of the channel are announced."""
        return self.own, self.all


def _places(channel: str) -> _Places:
    return _places_below(channel.rpartition("/")[0] or channel)


@lru_cache(1000)
def _places_below(beginning: str) -> _Places:
    *above, interface = beginning.split("/")
    of_all, of_star = (file_name("/".join((*above[:-1], each, interface))) for each in (_ALL, ANY))
    return _Places(file_name(beginning), of_all, of_star)


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
        with _as_transport_error(folder):
            folder.mkdir(mode=0o700, exist_ok=True)
        self._folder = folder
        self._watch: Watch | None = None
        self._on_change: Callable[[], object] = _nothing
        self._lock = threading.Lock()
        self._places: dict[str, _Place] = {}
        self._files: WeakValueDictionary[str, _File] = WeakValueDictionary()
        """By member: places share the file of a member that is in many of them."""
        """By name: the places that this process looks into."""
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
                left = {os.path.splitext(name)[0] for name in os.listdir(self._folder) if name.endswith(_OF_MEMBERS)}
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
            entries = _parse(_content(self._folder / f"{member_id}.json"), member_id).entries
        except (OSError, ValueError, TypeError, KeyError):
            return False
        return entry in entries and self.alive(member_id)

    def alive(self, member_id: str) -> bool:
        """Whether a member's process lives. Removes the files of a dead one."""
        if _locked(self._folder / f"{member_id}.lock"):
            return True
        with contextlib.suppress(OSError):
            _remove_all(self._folder, member_id, _places_of_dead(self._folder, member_id))
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
                    known = self._files[name] = _File(stamp, _understood(_content(path), name))
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
        for place in map(self._places.__getitem__, _places(channel).sought()):
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
            for name in _places(channel).sought():
                if name not in self._places:
                    place = _Place(os.path.join(self._folder, _INDEX, name))
                    self._look_into(place)
                    self._places[name] = place
        except OSError as exc:
            self._complain(exc)
            self._version += 1  # so that the caller looks again
            return {}
        for name in _places(channel).sought():
            self._places[name].sought.add((role, channel))
        self._found[role, channel] = self._matching(role, channel, is_roll_call=True)
        return self._found[role, channel]


def _nothing() -> None:
    """The default callback."""


def _understood(raw: bytes, name: str) -> Member | None:
    try:
        return _parse(raw, name)
    except (ValueError, TypeError, KeyError):
        return None  # written by another version of this package, or by another program


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


def _content(path: str | Path) -> bytes:
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)  # twice as fast as `open`; there are many files
    try:
        parts = []
        while part := os.read(file, 65536):
            parts.append(part)
        return b"".join(parts)
    finally:
        os.close(file)


class Membership:
    """The own member of this process, while it is open."""

    def __init__(self, folder: Path, owner: str) -> None:
        self.id = f"{os.getpid()}-{secrets.token_hex(4)}"
        self._file, self._lock_file = folder / f"{self.id}.json", folder / f"{self.id}.lock"
        self._owner = owner
        self._entries: list[Entry] = []
        self._shown: dict[str, list[Entry]] = {}
        """By place: the entries announced there."""
        self._gathering = 0
        self._unwritten = False
        self._written = 0
        """The time stamp of the file, in ns; no two writes have the same."""
        self._lock = threading.Lock()
        with _as_transport_error(folder):
            self._held = os.open(self._lock_file, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(self._held, fcntl.LOCK_EX)
            self._write()
        except BaseException:
            self.close()
            raise

    def address(self, suffix: str) -> Path:
        """A path for a socket; it is removed with the other files of this member."""
        return self._file.with_name(f"{self.id}-{suffix}")

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The announced entries."""
        return tuple(self._entries)

    @contextlib.contextmanager
    def gathered(self) -> Iterator[None]:
        """Entries added in this context are written together at its end, since each write makes every peer look."""
        with self._lock:
            self._gathering += 1
        try:
            yield
        finally:
            with self._lock:
                self._gathering -= 1
                if not self._gathering and self._unwritten and self._held >= 0:
                    self._write()

    def add(self, entry: Entry) -> None:
        """Announce an entry; raises TransportError if that cannot be written."""
        with self._lock:
            self._entries.append(entry)
            try:
                self._write()
            except TransportError:
                self._entries.remove(entry)
                with contextlib.suppress(TransportError):  # some peers may have read the entry already
                    self._write()
                raise

    def remove(self, entry: Entry) -> None:
        """Withdraw an entry. A failure is only logged, since closing has to go on."""
        with self._lock:
            if entry not in self._entries or self._held < 0:
                return
            self._entries.remove(entry)
            try:
                self._write()
            except TransportError as exc:
                if self._file.exists():
                    log.warning("%s is still announced: %s", entry.channel, exc)

    def close(self) -> None:
        with self._lock:
            if self._held < 0:
                return
            try:
                with contextlib.suppress(OSError):  # otherwise the next member that looks removes it
                    # first, so that peers that see the entries go find no living process
                    self._lock_file.unlink(missing_ok=True)
                    _remove_all(self._file.parent, self.id, self._shown)
            finally:
                os.close(self._held)
                self._held = -1

    def _write(self) -> None:
        self._unwritten = bool(self._gathering)
        if self._gathering:
            return
        record = {"owner": self._owner, "pid": os.getpid(), "entries": list(map(told_of, self._entries))}
        draft = self._file.with_suffix(".draft")
        with _as_transport_error(self._file.parent):
            self._lock_file.stat()  # without the lock file, peers take this process for dead
            draft.write_text(json.dumps(record))
            self._written = max(self._written + 1, time.time_ns())
            os.utime(draft, ns=(self._written, self._written))  # see `_stamp`
            draft.replace(self._file)
            self._show()

    def _show(self) -> None:
        """Update the links in the places of our entries, so that members that look there see the change."""
        shown: dict[str, list[Entry]] = {}
        for entry in self._entries:
            places = _places(entry.channel)
            shown[places.own] = shown.setdefault(places.all, [])  # the same entries in every place of a member
            shown[places.all].append(entry)
        index = os.path.join(self._file.parent, _INDEX)
        for place in self._shown.keys() - shown.keys():
            _withdraw(os.path.join(index, place), self.id)
            del self._shown[place]
        for place, entries in shown.items():
            if place not in self._shown:
                _link(os.path.join(index, place), self.id)
            elif entries != self._shown[place]:
                with contextlib.suppress(FileNotFoundError):  # the folder was removed
                    os.utime(os.path.join(index, place))
            self._shown[place] = entries  # only now, so that a failed update is repeated


def _watched(watch: Watch, place: str) -> bool:
    if watch.able and not watch.watches(place):
        with contextlib.suppress(OSError):  # also if the folder was removed: it has no members
            _make(place)
            watch.add(place)
    return watch.watches(place)


def _make(place: str) -> None:
    for folder in (os.path.dirname(place), place):
        with contextlib.suppress(FileExistsError):
            os.mkdir(folder, 0o700)


def _link(place: str, member_id: str) -> None:
    """Create a link in a place to the file of a member."""
    for _ in range(_TRIES):
        try:
            os.symlink(f"../../{member_id}.json", os.path.join(place, member_id))
        except FileNotFoundError:  # the place has no members yet, or the last one has just left
            with contextlib.suppress(FileNotFoundError):  # or is just leaving
                _make(place)
        else:
            return
    raise OSError(errno.EAGAIN, "it is removed again and again")


def _withdraw(place: str, member_id: str) -> None:
    with contextlib.suppress(OSError):
        os.unlink(os.path.join(place, member_id))
    # the others stay: many members look there, although they are mostly empty
    if _ALL not in place and ANY not in place:
        with contextlib.suppress(OSError):
            os.rmdir(place)


def _remove_all(folder: Path, member_id: str, places: Iterable[str]) -> None:
    """Remove all files of a member, and its links in these places; with the last member, the index, too."""
    for place in places:
        _withdraw(os.path.join(folder, _INDEX, place), member_id)
    others = False
    for name in os.listdir(folder):
        if name.startswith(member_id):
            (folder / name).unlink(missing_ok=True)
        elif "-" in name and name.endswith(".lock"):  # shm has another kind of lock file, without a dash
            others = True
    if not others:
        _remove_index(folder)


def _places_of_dead(folder: Path, member_id: str) -> Iterable[str]:
    """The places with links to a member that may have been killed at any moment."""
    try:
        entries = _parse(_content(folder / f"{member_id}.json"), member_id).entries
    except (OSError, ValueError, TypeError, KeyError):  # killed while joining or leaving
        index = folder / _INDEX
        return os.listdir(index) if index.exists() else ()
    return {place for entry in entries for place in _places(entry.channel).announced()}


def _remove_index(folder: Path) -> None:
    """Remove the index after the last member. Links of a member that is just joining stay."""
    index = os.path.join(folder, _INDEX)
    with contextlib.suppress(OSError):
        for mark in (SWEPT, UNWATCHED):
            (folder / mark).unlink(missing_ok=True)
        for place in (os.path.join(index, name) for name in os.listdir(index)):
            with contextlib.suppress(OSError):
                for link in (os.path.join(place, name) for name in os.listdir(place)):
                    if not os.path.exists(link):  # of a member that was killed while leaving
                        os.unlink(link)
                os.rmdir(place)
        os.rmdir(index)


@contextlib.contextmanager
def _as_transport_error(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as exc:
        raise TransportError(f"run-time folder {folder} cannot be written: {exc.strerror}") from exc


def _parse(raw: bytes, name: str) -> Member:
    return member_of(json.loads(raw), name)


def member_of(record: Any, member_id: str) -> Member:
    """The member that a record describes. Raises ValueError, TypeError or KeyError."""
    owner, pid = record["owner"], record["pid"]
    if type(owner) is not str or type(pid) is not int:
        raise TypeError("owner or pid of a member")
    return Member(member_id, owner, pid, tuple(map(_entry, record["entries"])))


_KEYS = tuple(each.name for each in fields(Entry))


def told_of(entry: Entry) -> dict[str, Any]:
    """An entry as a JSON object."""
    return {key: getattr(entry, key) for key in _KEYS}


def _entry(told: dict[str, Any]) -> Entry:
    """An entry from a JSON object, perhaps of another program. Ignores unknown keys. Raises TypeError."""
    entry = Entry(**{key: told[key] for key in _KEYS if key in told})
    for key in _KEYS:
        if type(getattr(entry, key)) is not (int if key == "fingerprint" else str):
            raise TypeError(f"{key} of an entry")
    return entry


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
    ids = {os.path.splitext(name)[0] for name in os.listdir(folder) if name.endswith(_OF_MEMBERS)}
    members = {name: int(pid) for name in ids if (pid := name.partition("-")[0]).isdecimal()}
    dead = {name for name, pid in members.items() if is_gone(pid)}
    claims = {os.path.splitext(name)[0] for name in left_in(folder)} - dead
    below = [each for each in folder.iterdir() if each.is_dir() and each.name != _INDEX]
    return len(members) - len(dead), len(dead) + len(claims) + sum(len(left_in(each)) for each in below)


def clear(folder: Path) -> bool:
    """Remove what killed processes left in the folder of a transport; whether members were among them.

    The next member does so, too. This is for a program that has ended processes, since no further member may come.
    Raises OSError; files that could not be removed are harmless.
    """
    members = {os.path.splitext(name)[0] for name in os.listdir(folder) if name.endswith(_OF_MEMBERS)}
    gone = [name for name in members if (pid := name.partition("-")[0]).isdecimal() and is_gone(int(pid))]
    directory = Directory(folder)
    found = [name for name in gone if not directory.alive(name)]
    for each in (folder, *(below for below in folder.iterdir() if below.is_dir() and below.name != _INDEX)):
        (each / SWEPT).unlink(missing_ok=True)  # a recent sweep may have seen these processes alive
        sweep(each)
        (each / SWEPT).unlink(missing_ok=True)
    return bool(found)
