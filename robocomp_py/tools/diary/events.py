"""The events of a diary, and the files that hold them.

A diary is an MCAP file with one channel, `/diary`. Each message of it is a page of events, one after the other. An
event is a line of JSON; `octets` says how many octets of data follow the line. Events are in the order in which the
code of the component ran: only one method runs at a time, so there is one order. Each has `event` (its number), `ns`
(since the diary began), `kind`, and the `turn` that it belongs to: a call of a hook, a handler, a timer or a function.

    start   the component, its configuration, seeds, and what cannot be run again
    turn    a call begins: `call`, and its arguments
    out     something goes out: `call`, `data`; `error` if sending it failed
    wait    the call waits, so that others may run: for the reply of the last `out`, or for `sleep`
    back    the wait is over: `data`, `value` or `error`
    read    the code has read a clock: `what`, `value`
    after   the code has asked for a later call: `number`, `seconds`
    end     the call ends: `data` of its reply, or `error`

`data` is CDR. It is null if the values did not fit the contract.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import IO, Any

from ...closing import Closing
from ..recording.bag import RecordingError
from ..recording.chunks import McapFile
from ..recording.formats import need_mcap
from ..recording.reader import Recording

CHANNEL = "/diary"

FORMAT = "2"

FLUSH = 1_000_000_000
"""ns after which what is written is given to the operating system."""

PAGE = 64 * 1024
"""Octets of events that make a page, which is one message of MCAP: a message costs more than an event."""

NO_DATA = b""

_HEADS = 1000
"""Beginnings of events that are kept: calls that the code asks for have ever new names."""

Event = dict[str, Any]


class DiaryWriter:
    """A diary that grows. Safe to use from any thread; after an error nothing more is written."""

    def __init__(self, path: Path, now: Callable[[], int] = time.monotonic_ns) -> None:
        """A file that is there already is kept: the new one gets a number. Raises RecordingError, and
        ConfigurationError if the library is missing."""
        need_mcap()
        self.error: RecordingError | None = None
        self._lock = threading.Lock()
        self._now, self._begun, self._unix, self._last = now, now(), time.time_ns(), -1
        self._number = 0
        self._flushed = self._begun
        self._file: IO[bytes] | None
        self.path, self._file = _created(path)
        self._writer = McapFile(self._file.fileno())
        self._writer.start("", "robocomp_py")
        self._channel = self._writer.add_channel(CHANNEL, "jsonl", 0, {"diary": FORMAT})
        self._page, self._began = bytearray(), 0
        self._heads: dict[tuple[str, str], bytes] = {}

    def write(self, kind: str, turn: int, call: str = "", data: bytes | None = NO_DATA, **more: Any) -> None:
        """Note an event. `data` is CDR, or None if the values could not be encoded; `more` becomes JSON."""
        head = self._heads.get((kind, call)) or self._head(kind, call)
        rest = b""
        if data:
            rest = b', "octets": %d' % len(data)
        elif data is None:
            rest = b', "data": null'
        if more:
            rest += b", " + json.dumps(more)[1:-1].encode()
        with self._lock:
            if self._file is None:
                return
            now = self._now()
            since = now - self._begun
            if since <= self._last:  # files are read in the order of their times
                since = self._last + 1
            self._last = since
            self._page += head % (self._number, since, turn, rest)
            if data:
                self._page += data
            self._number += 1
            if len(self._page) >= PAGE or now - self._flushed >= FLUSH:
                self._turn_over(now)

    def close(self) -> None:
        """Finish the file. Idempotent."""
        with self._lock:
            if self._file is None:
                return
            self._turn_over(self._flushed)
            if self._file is None:
                return
            try:
                self._writer.finish()
                self._file.close()
                self._file = None
            except OSError as exc:
                self._fail(exc)

    def _head(self, kind: str, call: str) -> bytes:
        text = json.dumps({"kind": kind, "call": call} if call else {"kind": kind})[:-1].replace("%", "%%")
        head = f'{text}, "event": %d, "ns": %d, "turn": %d%b}}\n'.encode()
        if len(self._heads) < _HEADS:
            self._heads[kind, call] = head
        return head

    def _turn_over(self, now: int) -> None:
        """Write the page, and begin another one."""
        page, self._page = self._page, bytearray()
        at, self._began = self._unix + self._began, self._last + 1
        try:
            if page:
                self._writer.add_message(self._channel, at, page, at, 0)
            if now - self._flushed >= FLUSH:
                self._flushed = now
                self._writer.flush()
        except OSError as exc:
            self._fail(exc)

    def _fail(self, exc: OSError) -> None:
        self.error = RecordingError(f"{self.path}: {exc.strerror or exc}; the diary ends here")
        file, self._file = self._file, None
        if file:
            with contextlib.suppress(OSError):
                file.close()


def _created(path: Path) -> tuple[Path, IO[bytes]]:
    number = 0
    while True:
        free = path.with_name(f"{path.stem}_{number}{path.suffix}") if number else path
        try:
            return free, open(free, "xb", buffering=0)
        except FileExistsError:
            number += 1
        except OSError as exc:
            raise RecordingError(f"{free}: {exc.strerror}") from exc


class DiaryReader(Closing):
    """The events of a diary, one after the other, with a look at the next one."""

    def __init__(self, path: Path) -> None:
        """Raises RecordingError."""
        self.path = path
        self._recording = Recording(path)
        self._events = self._read()
        self._next: Event | None = None
        try:
            start = self.take()
            if start is None or start["kind"] != "start":
                raise RecordingError(f"{path}: this is no diary; `rcdeploy --diary COMPONENT` writes one")
        except BaseException:
            self.close()
            raise
        self.start = start

    def close(self) -> None:
        self._events.close()
        self._recording.close()

    def peek(self) -> Event | None:
        """The next event; None at the end."""
        if self._next is None:
            self._next = next(self._events, None)
        return self._next

    def take(self) -> Event | None:
        event, self._next = self.peek(), None
        return event

    def _read(self) -> Generator[Event, None, None]:
        topic = self._recording.topics.get(CHANNEL.removeprefix("/"))
        if topic is None:
            return
        if (found := topic.metadata.get("diary")) not in (FORMAT, None):
            raise RecordingError(f"{self.path}: another version of robocomp-py has written this diary (format {found})")
        for message in self._recording.messages([topic.name]):
            yield from self._events_of(message.data)

    def _events_of(self, page: bytes) -> Iterator[Event]:
        at = 0
        try:
            while at < len(page):
                begin, at = at, page.index(b"\n", at) + 1
                event = json.loads(page[begin:at].decode())
                if not _is_event(event):
                    break
                if octets := event.pop("octets", 0):
                    event["data"] = page[at : at + octets]
                    if not 0 < octets == len(event["data"]):
                        break
                    at += octets
                yield event
            else:
                return
        except (ValueError, RecursionError):
            pass
        raise RecordingError(f"{self.path}: an event of this diary is not understood")


def _is_event(event: Any) -> bool:
    return isinstance(event, dict) and all(
        isinstance(event.get(name, standard), kind) for name, kind, standard in _FIELDS
    )


_FIELDS: tuple[tuple[str, type, Any], ...] = (
    ("kind", str, None),
    *((name, int, None) for name in ("event", "ns", "turn")),
    *((name, str, "") for name in ("call", "what")),
    *((name, dict, {}) for name in ("error", "configuration")),
    ("octets", int, 0),
    ("data", type(None), None),
)


@contextlib.contextmanager
def as_broken(path: Path, event: Event) -> Iterator[None]:
    """What an event with wrong contents raises becomes a RecordingError."""
    try:
        yield
    except (ValueError, TypeError, KeyError, LookupError) as exc:
        raise RecordingError(f"{path}: event {event['event']} is not understood: {exc}") from exc
