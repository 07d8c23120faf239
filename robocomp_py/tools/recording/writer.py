"""Records while messages arrive: the receiving threads only put them into a queue, and one thread writes.

The queue is bounded in octets. What does not fit is dropped and counted, so the disk never holds up the network. Each
second all is given to the operating system, and every ten seconds another thread asks it to write to the disk.
"""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from ...closing import Closing
from ...contract.types import Struct
from ...errors import DecodeError, EncodeError
from ...threads import NO_THREAD, start_thread
from ...wire.cdr import Cdr
from ...wire.codec import Codec, Payload
from ..tap import octets_of
from .bag import PLAIN, BagWriter, Options, RecordingError
from .layout import Topic

log = logging.getLogger("robocomp.recording")

QUEUE = 256 * 1024 * 1024
"""Octets that may wait to be written."""

FLUSH, SYNC = 0.9, 10.0
"""Seconds between two flushes, and between two requests to write to the disk. A flush takes time, too, and a killed
recorder is to lose one second at most."""

_EACH = 256
"""Octets that a waiting message counts in addition to its payload."""

_LAST = 60.0
"""Seconds for which `close` waits for the disk."""

Convert = Callable[[Payload], Any]


class Track:
    """A topic that is recorded. `put` may be called by any thread, and never waits."""

    def __init__(self, recorder: Recorder, topic: Topic, convert: Convert) -> None:
        self.topic, self._recorder, self.convert = topic, recorder, convert
        self.number = -1
        self.received = self.dropped = self.malformed = self.written = 0
        """Messages: put; discarded because the queue was full or the file had failed; not decoded; written."""

    def put(self, payload: Payload, stamp: int = 0, sequence: int = 0) -> None:
        """A message has arrived. `stamp` is when it was sent, in ns since 1970; 0 if that is not known."""
        self._recorder.put(self, payload, stamp, sequence)


class _Waiting(NamedTuple):
    track: Track
    payload: Payload
    octets: int
    log_time: int
    stamp: int
    sequence: int


class Recorder(Closing):
    """A recording that grows. After an error nothing more is written; `error` says why."""

    def __init__(
        self,
        folder: Path,
        options: Options = PLAIN,
        *,
        limit: int = QUEUE,
        now: Callable[[], int] = time.time_ns,
    ) -> None:
        """Raises ConfigurationError and RecordingError."""
        self._bag = BagWriter(folder, options)
        self.folder, self._limit, self._now = folder, limit, now
        self.tracks: list[Track] = []
        self.error: RecordingError | None = None
        self._queue: deque[_Waiting] = deque()
        self._octets = 0
        self._changed = threading.Condition()
        self._is_over = False
        self._stopped = threading.Event()
        self._files = threading.Lock()
        """Held while the present file is replaced or duplicated."""
        self._threads = [
            threading.Thread(target=self._write, name="recorder"),
            threading.Thread(target=self._sync, name="recorder-sync"),
        ]
        if not all(map(start_thread, self._threads)):
            self.close()
            raise RecordingError(NO_THREAD)

    @property
    def octets(self) -> int:
        """In the files so far, about."""
        return self._written

    @property
    def waiting(self) -> int:
        """Octets in the queue."""
        return self._octets

    _written = 0

    def track(self, topic: Topic, convert: Convert = lambda payload: payload) -> Track:
        """A further topic. `convert` makes standard CDR of its payloads; the thread that writes calls it."""
        made = Track(self, topic, convert)
        with self._changed:
            self.tracks.append(made)
        return made

    def put(self, track: Track, payload: Payload, stamp: int, sequence: int) -> None:
        size = octets_of(payload) + _EACH
        with self._changed:
            track.received += 1
            if self.error or self._is_over or (self._octets and self._octets + size > self._limit):
                track.dropped += 1
                return
            was_empty = not self._queue
            self._octets += size
            self._queue.append(_Waiting(track, payload, size, self._now(), stamp, sequence))
            if was_empty:
                self._changed.notify()

    def close(self) -> None:
        """Write all that waits and finish the files. Idempotent. After it, `error` tells whether all was well."""
        with self._changed:
            self._is_over = True
            self._changed.notify()
        self._stopped.set()
        for each in self._threads:
            if each.ident:
                each.join(_LAST)
        if any(each.is_alive() for each in self._threads):
            self.error = RecordingError(f"{self.folder}: the disk has taken nothing for {_LAST:g} s")

    def discard(self) -> None:
        """After `close`: remove the files, and the folder if nothing else is in it. Raises OSError."""
        self._bag.discard()

    # The thread that writes.

    def _write(self) -> None:
        try:
            self._write_all()
            with self._files:
                self._bag.close()
        except RecordingError as exc:
            self._fail(exc)
        except Exception as exc:
            log.exception("recording failed")
            self._fail(RecordingError(f"{self.folder}: {type(exc).__name__}: {exc}"))
        self._written = self._bag.octets

    def _write_all(self) -> None:
        flushed = time.monotonic()
        while True:
            with self._changed:
                if not self._queue and not self._is_over:
                    self._changed.wait(max(0.0, flushed + FLUSH - time.monotonic()))
                batch, self._queue = self._queue, deque()
                is_over = self._is_over
            while batch:
                message = batch.popleft()
                try:
                    self._write_one(message)
                except RecordingError:
                    batch.appendleft(message)
                    with self._changed:
                        batch.extend(self._queue)
                        self._queue = batch
                    raise
                with self._changed:
                    self._octets -= message.octets
                if time.monotonic() - flushed >= FLUSH:
                    flushed = self._flush()
            if time.monotonic() - flushed >= FLUSH:
                flushed = self._flush()
            if is_over:
                return

    def _write_one(self, message: _Waiting) -> None:
        track = message.track
        try:
            data = track.convert(message.payload)
        except (DecodeError, EncodeError):
            track.malformed += 1
            return
        with self._files:
            if track.number < 0:
                track.number = self._bag.add(track.topic)
            self._bag.write(
                track.number,
                data,
                message.log_time,
                message.stamp if message.stamp > 0 else message.log_time,
                message.sequence,
            )
        track.written += 1

    def _flush(self) -> float:
        with self._files:
            self._bag.flush()
            self._written = self._bag.octets
        return time.monotonic()

    def _fail(self, error: RecordingError) -> None:
        with self._changed:
            self.error = error
            lost, self._queue, self._octets = self._queue, deque(), 0
            for each in lost:
                each.track.dropped += 1
        with self._files:
            self._bag.abandon()

    # The thread that asks for the disk.

    def _sync(self) -> None:
        while not self._stopped.wait(SYNC):
            with self._files:
                descriptor = self._bag.duplicate()
            if descriptor is None:
                return
            with contextlib.suppress(OSError):  # the next write tells
                os.fdatasync(descriptor)
            os.close(descriptor)


def to_cdr(codec: Codec, message: Struct) -> Convert:
    """What makes standard CDR of the payloads of a codec. It may raise DecodeError and EncodeError."""
    if isinstance(codec, Cdr):
        return codec.standard(message)
    decode, encode = codec.decoder(message), Cdr().encoder(message)
    return lambda payload: encode(decode(payload))
