"""The events of a diary, and the files that hold them.

A diary is an MCAP file with one channel, `/diary`, of JSON objects. They are in the order in which the code of the
component ran: only one method runs at a time, so there is one order. Each has `event` (its number), `ns` (since the
diary began), `kind`, and the `turn` that it belongs to: a call of a hook, a handler, a timer or a function.

    start   the component, its configuration, seeds, and what cannot be run again
    turn    a call begins: `call`, and its arguments
    out     something goes out: `call`, `data`; `error` if sending it failed
    wait    the call waits, so that others may run: for the reply of the last `out`, or for `sleep`
    back    the wait is over: `data`, `value` or `error`
    read    the code has read a clock: `what`, `value`
    after   the code has asked for a later call: `number`, `seconds`
    end     the call ends: `data` of its reply, or `error`

`data` is CDR, in base64.
"""

from __future__ import annotations

import base64
import contextlib
import json
import threading
import time
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import IO, Any

from ..recording.bag import CHUNK, RecordingError
from ..recording.formats import compression, need_mcap
from ..recording.reader import Recording

CHANNEL = "/diary"

FORMAT = "1"

FLUSH = 1_000_000_000
"""ns after which what is written is given to the operating system."""

Event = dict[str, Any]


class DiaryWriter:
    """A diary that grows. Safe to use from any thread; after an error nothing more is written."""

    def __init__(self, path: Path, now: Callable[[], int] = time.monotonic_ns) -> None:
        """A file that is there already is kept: the new one gets a number. Raises RecordingError, and
        ConfigurationError if the library is missing."""
        need_mcap()
        from mcap.writer import Writer

        self.error: RecordingError | None = None
        self._lock = threading.Lock()
        self._now, self._begun, self._unix, self._last = now, now(), time.time_ns(), -1
        self._number = 0
        self._flushed = self._begun
        self._file: IO[bytes] | None
        self.path, self._file = _created(path)
        self._writer = Writer(self._file, chunk_size=CHUNK, compression=compression("none"))
        self._writer.start(library="robocomp_py")
        self._channel = self._writer.register_channel(CHANNEL, "json", 0, {"diary": FORMAT})

    def write(self, kind: str, turn: int, *, data: str | None = "", **more: Any) -> None:
        """`data` is base64: a large one is not worth the time to look for characters that JSON does not allow."""
        ending = (
            b"}" if data == "" else b', "data": null}' if data is None else b', "data": "%b"}' % data.encode("ascii")
        )
        with self._lock:
            if self._file is None:
                return
            now = self._now()
            since = self._last = max(now - self._begun, self._last + 1)  # files are read in the order of their times
            event = {"event": self._number, "ns": since, "kind": kind, "turn": turn, **more}
            self._number += 1
            at = self._unix + since
            try:
                self._writer.add_message(self._channel, at, json.dumps(event)[:-1].encode() + ending, at)
                if now - self._flushed >= FLUSH:
                    self._flushed = now
                    self._writer.flush()  # type: ignore[no-untyped-call]  # the library's
            except OSError as exc:
                self._fail(exc)

    def close(self) -> None:
        """Finish the file. Idempotent."""
        with self._lock:
            if self._file is None:
                return
            try:
                self._writer.finish()  # type: ignore[no-untyped-call]  # the library's
                self._file.close()
                self._file = None
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
            return free, open(free, "xb")
        except FileExistsError:
            number += 1
        except OSError as exc:
            raise RecordingError(f"{free}: {exc.strerror}") from exc


class DiaryReader:
    """The events of a diary, one after the other, with a look at the next one."""

    def __init__(self, path: Path) -> None:
        """Raises RecordingError."""
        self.path = path
        self._recording = Recording(path)
        self._events = self._read()
        self._next: Event | None = None
        start = self.take()
        if start is None or start["kind"] != "start":
            self.close()
            raise RecordingError(f"{path}: this is no diary; `rcdeploy --diary COMPONENT` writes one")
        self.start = start

    def __enter__(self) -> DiaryReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

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
        topic = CHANNEL.removeprefix("/")
        for message in self._recording.messages([topic]) if topic in self._recording.topics else ():
            yield self._event(message.data)

    def _event(self, data: bytes) -> Event:
        try:
            event = json.loads(data)
            if _is_event(event):
                return event  # type: ignore[no-any-return]  # checked in the line before
        except ValueError:
            pass
        raise RecordingError(f"{self.path}: an event of this diary is not understood")


def _is_event(event: Any) -> bool:
    return (
        isinstance(event, dict)
        and isinstance(event.get("kind"), str)
        and all(isinstance(event.get(name), int) for name in ("event", "ns", "turn"))
        and all(isinstance(event.get(name, ""), str) for name in ("call", "what"))
        and all(isinstance(event.get(name, {}), dict) for name in ("error", "configuration"))
    )


def text_of(octets: bytes) -> str:
    return base64.b64encode(octets).decode("ascii")


def octets_of(text: Any) -> bytes:
    """Raises ValueError."""
    if not isinstance(text, str):
        raise ValueError("data is no text")
    return base64.b64decode(text, validate=True)


@contextlib.contextmanager
def as_broken(path: Path, event: Event) -> Iterator[None]:
    """What an event with wrong contents raises becomes a RecordingError."""
    try:
        yield
    except (ValueError, TypeError, KeyError, LookupError) as exc:
        raise RecordingError(f"{path}: event {event['event']} is not understood: {exc}") from exc
