"""Who is there, on this machine: a file per open transport, in a folder of the user's own.

    <run-time folder>/<transport>/<id>.json    what it offers and wants; replaced as a whole, so never half-read
    <run-time folder>/<transport>/<id>.lock    locked as long as its process lives, however it ends
    <run-time folder>/<transport>/<id>.about   a symbolic link whose target, which is not there, is what all channels in
                                               the former file begin with: who looks for others need not open that

A lock that can be taken belongs to somebody dead; whoever notices removes what was left.
The run-time folder is `$ROBOCOMP_RUNTIME_DIR`, or `$XDG_RUNTIME_DIR/robocomp`, or
`robocomp-<uid>` in the folder for temporary files; always mode 0700.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import logging
import os
import secrets
import stat
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from ..errors import ConfigurationError, TransportError
from ..wire.names import ANY, matches
from .exclusive import is_gone
from .inotify import FolderWatch

log = logging.getLogger("robocomp.transport")

_SETTLED = 0.1
"""What was read of a folder less than so many seconds after it changed is read again: its time stamp is too coarse."""

_FEW = 32
"""So many members are looked at whenever something may have changed."""

_LONGEST_PAUSE = 1.0
"""Seconds; see `Directory.pause`."""

_LEAST = 0.002
"""Seconds between two looks for each of many members, where the folder is watched: all together, they look 500 times
in a second at most, and each look takes a fifth of a millisecond, with all that comes of it."""

_SELDOM = 5.0
"""Seconds at most between two looks at all of many members, where the folder is not watched: at those who are new, and
have not said yet what they are about, it is looked each time. Most users have 128 watches for all their processes."""

_ROLL_CALL = 1.0
"""Seconds between two looks whether those who were found live, while the folder changes."""

_FORGET = 1.0
"""Seconds after which what was not needed of the members' files is forgotten."""

_MOST_ASKED = 10_000

_ABOUT = ".about"

_LONGEST_LINK = 4000
"""Bytes; the kernel allows for 4095."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One end of one channel. `role` says which one, in the words of the transport."""

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

    def facing(self, role: str, channel: str) -> Iterator[tuple[Member, Entry]]:
        """Its ends of a channel in that role; the channel, or theirs, may have `*` for its instance."""
        for entry in self.entries:
            if entry.role == role and (matches(channel, entry.channel) or matches(entry.channel, channel)):
                yield self, entry


def runtime_dir() -> Path:
    """The folder for sockets and directory files, made if need be.

    Raises ConfigurationError if it is somebody else's, or open to others.
    """
    if chosen := os.environ.get("ROBOCOMP_RUNTIME_DIR"):
        folder = Path(chosen)
    elif base := os.environ.get("XDG_RUNTIME_DIR"):
        folder = Path(base, "robocomp")
    else:
        folder = _temporary() / f"robocomp-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        info = folder.stat()
    except OSError as exc:
        raise ConfigurationError(f"run-time folder {folder}: {exc.strerror}; set ROBOCOMP_RUNTIME_DIR") from exc
    if info.st_uid != os.getuid() or stat.S_IMODE(info.st_mode) & 0o077:
        raise ConfigurationError(f"run-time folder {folder} is open to other users; make it yours and 0700")
    return folder


def _temporary() -> Path:
    try:
        return Path(tempfile.gettempdir())
    except OSError as exc:  # it tries to write; without file descriptors nothing can be written, for one
        raise ConfigurationError(f"run-time folder: {exc.strerror}; set ROBOCOMP_RUNTIME_DIR") from exc


class _File:
    """What a member wrote. It is taken apart only if it may contain what somebody looks for: of many, few do."""

    __slots__ = ("about", "has_stars", "is_escaped", "member", "raw", "stamp")

    def __init__(self, stamp: tuple[int, int, int], about: bytes | None, raw: bytes | None) -> None:
        self.stamp, self.about = stamp, about
        self.raw = raw
        """None: not read, or forgotten, since nothing new was looked for in a while."""
        self.member: Member | None = None
        """What it comes to, if that was of interest."""
        told = about if about is not None else raw or b""
        self.has_stars = b"*/" in told
        self.is_escaped = about is None and (b"\\/" in told or b"\\u" in told)
        """Whether channels may be spelled in it with JSON's way to write any letter."""


class Directory:
    """The members of one transport. Safe to use from any thread.

    When it cannot be read for a while (no file descriptor is left, say), that is logged once, and
    what was read last holds until it can. A folder that was removed has no members.

    Where members are many, what changes is seen a little later: else all of them together would do nothing but look.
    """

    def __init__(self, folder: Path) -> None:
        with _as_transport_error(folder):
            folder.mkdir(mode=0o700, exist_ok=True)
        self._folder = folder
        self._watch: FolderWatch | None = None
        self._on_change: Callable[[], object] = _nothing
        self._lock = threading.Lock()
        self._files: dict[str, _File] = {}
        self._found: dict[tuple[str, str], dict[str, list[tuple[Member, Entry]]]] = {}
        """By role and channel that were looked for, and by member."""
        self._groups: dict[bytes, _Group] = {}
        """What was looked for, by what its channels begin with."""
        self._roll_call = 0.0
        self._stopped: dict[str, float] = {}
        """By member: since when its process is known to be stopped."""
        self._unreadable = False
        self._version = 0
        self._stamp = 0
        self._changed_at = 0.0
        self._settled = True
        """Whether it was read so long after it changed that nothing may have been missed."""
        self._asked_at = time.monotonic()
        """When something was looked for that had not been before."""
        self._remembers = False
        """Whether what members wrote is kept, for what else may be looked for."""
        self._next_look = self._full_look = 0.0
        self.pause = 0.0
        """Seconds between two looks into it, by how many there are and how long that took."""

    def heed(self, watch: FolderWatch, on_change: Callable[[], object]) -> None:
        """From now on, look only at what this watch tells of, as long as it works.

        `on_change` is called when the version has changed, on whichever thread has found that.
        """
        self._watch, self._on_change = watch, on_change

    def join(self, owner: str) -> Membership:
        """Become a member. What killed ones left before they were members is removed, too."""
        with contextlib.suppress(OSError):
            for file in os.listdir(self._folder):
                pid, _, rest = file.partition("-")
                if rest.endswith(".lock") and pid.isdecimal() and is_gone(int(pid)):
                    self.alive(file.removesuffix(".lock"))
        return Membership(self._folder, owner)

    def version(self) -> int:
        """A number that grows when what was looked for here changes. Cheap while nothing does."""
        with self._looked():
            return self._version

    def find(self, role: str, channel: str) -> list[tuple[Member, Entry]]:
        """Ends of a channel in that role; the channel, or theirs, may have `*` for its instance."""
        with self._looked():
            known = self._found.get((role, channel))
            if known is None:
                known = self._search(role, channel)
            return [found for name in sorted(known) for found in known[name]]

    def still_has(self, member_id: str, entry: Entry) -> bool:
        """Whether what was found is there this moment, in this folder, and its process lives."""
        try:
            entries = _parse(_content(self._folder / f"{member_id}.json"), member_id).entries
        except (OSError, ValueError, TypeError, KeyError):
            return False
        return entry in entries and self.alive(member_id)

    def alive(self, member_id: str) -> bool:
        """Whether a member's process lives. Removes what a dead one left."""
        if _locked(self._folder / f"{member_id}.lock"):
            return True
        with contextlib.suppress(OSError):
            _remove_all(self._folder, member_id)
        return False

    def responds(self, member: Member, within: float) -> bool:
        """Whether a member's process lives, and has not been stopped (by SIGSTOP, say) for so many seconds."""
        if self.alive(member.id) and state_of(member.pid) != "T":
            self._stopped.pop(member.id, None)
            return True
        now = time.monotonic()
        return self.alive(member.id) and now - self._stopped.setdefault(member.id, now) < within

    @contextlib.contextmanager
    def _looked(self) -> Iterator[None]:
        """With the lock, and knowing what is there."""
        with self._lock:
            before = self._version
            try:
                self._refresh()
                self._unreadable = False
            except OSError as exc:
                self._complain(exc)
            is_news = self._version != before
            yield
        if is_news:
            self._on_change()

    def _complain(self, exc: OSError) -> None:
        self._stamp = -1  # whatever it is next, that is to be read
        if self._watch:
            self._watch.forget()
        if not self._unreadable:
            log.warning("run-time folder %s cannot be read now: %s", self._folder, exc.strerror)
        self._unreadable = True

    def _refresh(self) -> None:
        now = time.monotonic()
        if now < self._next_look:
            return
        names = self._watch.changed() if self._watch else None
        if names is None:
            self._look_through(now)
        elif names:
            self._look_at(names)
            self.pause = min(_LONGEST_PAUSE, _LEAST * len(self._files)) if len(self._files) > _FEW else 0.0
            self._next_look = now + self.pause
        if self._remembers and now - self._asked_at > _FORGET:
            self._remembers = False
            for file in self._files.values():
                file.raw = None

    def _look_at(self, names: Iterable[str]) -> None:
        """Read what the watch tells of."""
        new, gone = {}, []
        for name in names:
            known = self._files.get(name)
            try:
                path = os.path.join(self._folder, f"{name}.json")
                stamp = _stamp(os.stat(path))
                if known is None or known.stamp != stamp:
                    new[name] = _opened(path, stamp)
            except FileNotFoundError:
                gone.append(name)
        self._adopt(new, [name for name in gone if name in self._files])
        self._remembers = True

    def _look_through(self, now: float) -> None:
        """Read all that is there, if anything may have changed."""
        try:
            stamp = self._folder.stat().st_mtime_ns
        except FileNotFoundError:
            stamp = 0
        if stamp != self._stamp:
            self._stamp, self._changed_at, self._settled = stamp, now, False
        if self._settled:  # it is not asked whether it is by now: nobody may have looked for a while
            return
        begun = time.thread_time()
        is_watched = self._watch is not None and self._watch.working  # then nobody looks again at what is missed now
        is_full = is_watched or now >= self._full_look or len(self._files) <= _FEW
        files = self._read(is_full) if stamp else {}
        new = {name: file for name, file in files.items() if self._files.get(name) is not file}
        self._adopt(new, self._files.keys() - files.keys())
        self._remembers = True
        spent = max(_LEAST, time.thread_time() - begun)
        self.pause = min(_LONGEST_PAUSE, spent * len(self._files)) if len(self._files) > _FEW else 0.0
        self._next_look = now + self.pause
        if is_full:
            self._full_look = now + min(_SELDOM, spent * len(self._files))
        self._settled = is_full and now - self._changed_at >= max(_SETTLED, 2 * self.pause)

    def _read(self, is_full: bool) -> dict[str, _File]:
        """Who is there; unless it `is_full`, who has said before what it is about is taken not to have changed."""
        found: dict[str, _File] = {}
        for file in os.listdir(self._folder):
            if not file.endswith(".json"):
                continue
            name, path = file[:-5], os.path.join(self._folder, file)
            known = self._files.get(name)
            if known and known.about and not is_full:
                found[name] = known
                continue
            try:
                stamp = _stamp(os.stat(path))
                found[name] = known if known and known.stamp == stamp else _opened(path, stamp)
            except FileNotFoundError:
                continue  # it left while we read
        return found

    def _adopt(self, new: Mapping[str, _File], gone: Collection[str]) -> None:
        """Know of members that have changed, and of those who have left."""
        for name in gone:
            del self._files[name]
            self._stopped.pop(name, None)
        self._files.update(new)
        concerned = set(self._found) if self._is_roll_call() else set[tuple[str, str]]()
        for group in self._groups.values():
            if group.adopt(new, gone):
                concerned |= group.sought
        for role, channel in concerned:
            known = self._found[role, channel]
            was = dict(known)
            for name in [name for name in known if name in new or name not in self._files or not self.alive(name)]:
                del known[name]
            for name in self._groups[_group(channel)].members & new.keys():
                self._look_into(name, role, channel, known)
            self._version += known != was

    def _is_roll_call(self) -> bool:
        now = time.monotonic()
        is_due = now >= self._roll_call
        if is_due:
            self._roll_call = now + _ROLL_CALL
        return is_due

    def _search(self, role: str, channel: str) -> dict[str, list[tuple[Member, Entry]]]:
        self._asked_at, self._remembers = time.monotonic(), True
        if len(self._found) >= _MOST_ASKED:
            self._found.clear()
            self._groups.clear()
        known: dict[str, list[tuple[Member, Entry]]] = {}
        try:
            named = _group(channel)
            group = self._groups.get(named)
            if group is None:
                group = _Group(named)
                there = self._files.items()
                group.adopt({name: file for name, file in there if file.about or self._recall(name, file)}, ())
            for name in group.members:
                self._look_into(name, role, channel, known)
        except OSError as exc:
            self._complain(exc)
            self._version += 1  # so that who looked for it looks again
        else:
            self._groups[named] = group
            group.sought.add((role, channel))
            self._found[role, channel] = known
        return known

    def _look_into(self, name: str, role: str, channel: str, known: dict[str, list[tuple[Member, Entry]]]) -> None:
        file = self._files[name]
        raw = self._recall(name, file)
        if raw is None:
            return
        try:
            file.member = file.member or _parse(raw, name)
        except (ValueError, TypeError, KeyError):
            return  # written by another version of this package, or by another program
        found = list(file.member.facing(role, channel))
        if found and self.alive(name):
            known[name] = found

    def _recall(self, name: str, file: _File) -> bytes | None:
        """What a member wrote, read once more if need be; None if it has left."""
        if file.raw is None:
            with contextlib.suppress(FileNotFoundError):
                file.raw = _content(self._folder / f"{name}.json")
        return file.raw


class _Group:
    """Channels that begin alike, those of one interface of one instance: who may have something to do with them."""

    __slots__ = ("_interface", "_named", "members", "sought")

    def __init__(self, named: bytes) -> None:
        self._named, self._interface = named, named[named.rfind(b"/", 0, -1) + 1 :]
        self.members: set[str] = set()
        self.sought: set[tuple[str, str]] = set()
        """The roles and channels of it that are looked for."""

    def adopt(self, new: Mapping[str, _File], gone: Collection[str]) -> bool:
        """Whether those who have come, changed or left are of any interest."""
        before = self.members & (new.keys() | gone)
        self.members -= before
        after = {name for name, file in new.items() if self._concerns(file)}
        self.members |= after
        return bool(before or after)

    def _concerns(self, file: _File) -> bool:
        told = file.about if file.about is not None else file.raw or b""
        return self._named in told or file.is_escaped or (file.has_stars and self._interface in told)


def _nothing() -> None:
    """Nobody wants to know."""


def _group(channel: str) -> bytes:
    """What a channel has in common with those beside it, and with all that it may match."""
    beginning = _beginning(channel)
    return beginning[beginning.rfind(b"/", 0, -1) + 1 :] if ANY in channel else beginning


def _beginning(channel: str) -> bytes:
    instance, slash, _ = channel.rpartition("/")
    return f"{instance}/".encode() if slash else channel.encode()


def _opened(path: str, stamp: tuple[int, int, int]) -> _File:
    """A member's file, of which nothing is read if it is said what it is about."""
    try:
        about = os.readlink(os.fsencode(path.removesuffix(".json") + _ABOUT))
    except OSError:  # who wrote it does not say
        return _File(stamp, None, _content(path))
    return _File(stamp, about, None)


def _stamp(info: os.stat_result) -> tuple[int, int, int]:
    return info.st_ino, info.st_size, info.st_mtime_ns  # the time alone is too coarse


def _content(path: str | Path) -> bytes:
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)  # in half the time that `open` takes: there are many
    try:
        parts = []
        while part := os.read(file, 65536):
            parts.append(part)
        return b"".join(parts)
    finally:
        os.close(file)


class Membership:
    """Our own entry, as long as we keep it open."""

    def __init__(self, folder: Path, owner: str) -> None:
        self.id = f"{os.getpid()}-{secrets.token_hex(4)}"
        self._file, self._lock_file = folder / f"{self.id}.json", folder / f"{self.id}.lock"
        self._owner = owner
        self._entries: list[Entry] = []
        self._about = b""
        self._gathering = 0
        self._unwritten = False
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
        """A path for a socket of ours, removed with everything else that we leave."""
        return self._file.with_name(f"{self.id}-{suffix}")

    @property
    def entries(self) -> tuple[Entry, ...]:
        """What is announced."""
        return tuple(self._entries)

    @contextlib.contextmanager
    def gathered(self) -> Iterator[None]:
        """What is added while this is entered is written at once at its end: all others look at whatever is written."""
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
        """Announce; raises TransportError if that cannot be written."""
        with self._lock:
            self._entries.append(entry)
            try:
                self._write()
            except TransportError:
                self._entries.remove(entry)
                raise

    def remove(self, entry: Entry) -> None:
        """Take back; that it cannot be written is logged, since who closes has to go on."""
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
                with contextlib.suppress(OSError):  # whoever looks there next removes it
                    self._lock_file.unlink(missing_ok=True)  # first: who sees our entries go finds nobody who lives
                    _remove_all(self._file.parent, self.id)
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
            self._lock_file.stat()  # without it others take us for dead, even if the folder was made again
            self._say_what_it_is_about()
            draft.write_text(json.dumps(record))
            draft.replace(self._file)

    def _say_what_it_is_about(self) -> None:
        """Before it is there: who sees it come knows that then."""
        about = b" ".join(sorted({_beginning(entry.channel) for entry in self._entries}))
        if about == self._about:
            return
        link = self._file.with_suffix(_ABOUT)
        self._about = b""
        link.unlink(missing_ok=True)
        if 0 < len(about) <= _LONGEST_LINK:
            os.symlink(about, os.fsencode(link))
            self._about = about


def _remove_all(folder: Path, member_id: str) -> None:
    for name in os.listdir(folder):
        if name.startswith(member_id):
            (folder / name).unlink(missing_ok=True)


@contextlib.contextmanager
def _as_transport_error(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as exc:
        raise TransportError(f"run-time folder {folder} cannot be written: {exc.strerror}") from exc


def _parse(raw: bytes, name: str) -> Member:
    return member_of(json.loads(raw), name)


def member_of(record: Any, member_id: str) -> Member:
    """Who told that of itself. Raises ValueError, TypeError or KeyError."""
    owner, pid = record["owner"], record["pid"]
    if type(owner) is not str or type(pid) is not int:
        raise TypeError("owner or pid of a member")
    return Member(member_id, owner, pid, tuple(map(_entry, record["entries"])))


_KEYS = tuple(each.name for each in fields(Entry))


def told_of(entry: Entry) -> dict[str, Any]:
    """What an entry is in JSON."""
    return {key: getattr(entry, key) for key in _KEYS}


def _entry(told: dict[str, Any]) -> Entry:
    """What is told of an entry, perhaps by another program. Raises TypeError; what we do not know is passed over."""
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
        return True  # not to be told now; the living must not be taken for dead
    try:
        fcntl.flock(probe, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(probe)
    return False


def state_of(pid: int) -> str:
    """The letter by which Linux tells the state of a process (`T`: stopped, `Z`: ended); "" if nothing is told."""
    try:
        status = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return ""
    return status.rpartition(")")[2].strip()[:1]
