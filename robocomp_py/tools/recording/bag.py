"""Writes the files of a recording. Not for several threads at once; see `writer` for what receives while it writes."""

from __future__ import annotations

import contextlib
import os
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NamedTuple

from ...errors import ConfigurationError, RobocompError
from ...version import __version__
from . import layout
from .chunks import McapFile
from .formats import need_mcap
from .layout import Described, Span, Topic

METADATA = "metadata.yaml"


class RecordingError(RobocompError):
    """A recording cannot be written or read; the text says why."""


@dataclass(frozen=True)
class Options:
    """How files are written."""

    compress: str = "none"
    schema: str = "ros2msg"
    split_octets: int | None = None
    """A further file begins when one has this size,"""
    split_seconds: float | None = None
    """or this age."""
    keep: int | None = None
    """Only the last files are kept."""


PLAIN = Options()


class Foreign:
    """A channel of a recording of another program, which is copied as it is."""

    def __init__(
        self, name: str, type_: str, encoding: str, schema: str, text: bytes, metadata: dict[str, str]
    ) -> None:
        self.in_file, self.type, self.encoding, self.schema_encoding = name, type_, encoding, schema
        self.text, self.metadata = text, metadata


class Attached(NamedTuple):
    """A file inside of a recording. Times are in ns since 1970, 0 if unknown."""

    name: str
    media_type: str
    data: bytes
    log_time: int
    create_time: int


class Note(NamedTuple):
    """Texts by name, about a whole recording."""

    name: str
    texts: dict[str, str]


class BagWriter:
    """A folder with the files of a recording. `close` finishes it; without, it can be mended."""

    def __init__(
        self,
        folder: Path,
        options: Options = PLAIN,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Raises ConfigurationError if the folder is there and not empty, and RecordingError."""
        need_mcap()
        self.folder, self._options, self._clock = folder, options, clock
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise ConfigurationError(f"{folder} is there already; choose another folder with -o")
        except OSError as exc:
            raise RecordingError(f"{folder}: {exc.strerror}") from exc
        self._topics: list[Topic | Foreign] = []
        self._ids: dict[int, int] = {}
        """In the present file, by topic."""
        self._file: IO[bytes] | None = None
        self._writer: McapFile | None = None
        self._number = 0
        self._done: deque[Span] = deque()
        self._octets = 0
        """Of files that are finished, those that are gone included."""
        self._counts: Counter[str] = Counter()
        self._start = self._end = 0
        self._open()

    @property
    def octets(self) -> int:
        """Written so far, in all files."""
        return self._octets + (self._writer.octets if self._writer else 0)

    def add(self, topic: Topic | Foreign) -> int:
        """A further topic; the number is what `write` takes."""
        self._topics.append(topic)
        return len(self._topics) - 1

    def write(self, topic: int, data: Any, log_time: int, publish_time: int, sequence: int) -> None:
        """Append a message. `data` is CDR, and may not change until the next `flush`; times are in ns since 1970; MCAP
        has none before. Raises RecordingError."""
        if self._is_full():
            self._finish()
            self._open()
        writer, name = self._writer, self._topics[topic].in_file
        if writer is None:
            raise RecordingError(f"{self.folder}: closed")
        with self._errors():
            if topic not in self._ids:
                self._ids[topic] = self._register(self._topics[topic])
            octets = data if isinstance(data, bytes) else memoryview(data).cast("B")
            number = self._ids[topic]
            log_time, publish_time = max(0, log_time), max(0, publish_time)
            writer.add_message(number, log_time, octets, publish_time, sequence & 0xFFFFFFFF)
        if not self._counts:
            self._start = self._end = log_time
        self._counts[name] += 1
        self._start, self._end = min(self._start, log_time), max(self._end, log_time)

    def add_extra(self, extra: Attached | Note) -> None:
        """Write it into the present file. Raises RecordingError."""
        if self._writer is None:
            raise RecordingError(f"{self.folder}: closed")
        with self._errors():
            match extra:
                case Attached(name, media_type, data, log_time, create_time):
                    self._writer.add_attachment(create_time, log_time, name, media_type, data)
                case Note(name, texts):
                    self._writer.add_metadata(name, texts)

    def flush(self) -> None:
        """Give all to the operating system. Raises RecordingError, also if the file is no longer in its folder."""
        if self._writer and self._file:
            with self._errors():
                self._writer.flush()
                path = self._path(self._number)
                if os.stat(path).st_ino != os.fstat(self._file.fileno()).st_ino:
                    raise FileNotFoundError(0, "it was replaced", str(path))

    def duplicate(self) -> int | None:
        """A further descriptor of the present file, for `fsync` on another thread; the caller closes it."""
        return os.dup(self._file.fileno()) if self._file else None

    def close(self) -> None:
        """Finish the file and write `metadata.yaml`. Idempotent. Raises RecordingError."""
        try:
            self._finish()
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close the file as it is, after an error."""
        file, self._file, self._writer = self._file, None, None
        if file and not file.closed:  # it is closed if the disk was full when it was
            self._octets += _position(file)
            file.close()

    def _is_full(self) -> bool:
        limit, age = self._options.split_octets, self._options.split_seconds
        if not self._counts or self._writer is None:
            return False
        if limit is not None and self._writer.octets >= limit:
            return True
        return age is not None and self._clock() - self._opened >= age

    def _path(self, number: int) -> Path:
        return self.folder / f"{self.folder.resolve().name}_{number}.mcap"

    def _open(self) -> None:
        with self._errors():
            self._file = open(self._path(self._number), "xb", buffering=0)  # noqa: SIM115 - until it is full
            self._opened = self._clock()
            self._ids, self._counts = {}, Counter()
            self._writer = McapFile(self._file.fileno(), self._options.compress)
            self._writer.start(profile=layout.PROFILE, library=f"robocomp_py {__version__}")

    def _register(self, topic: Topic | Foreign) -> int:
        assert self._writer
        if isinstance(topic, Foreign):
            schema = 0
            if topic.schema_encoding:
                schema = self._writer.add_schema(topic.type, topic.schema_encoding, topic.text)
            return self._writer.add_channel(topic.in_file, topic.encoding, schema, topic.metadata)
        told = topic.schema(self._options.schema)
        schema = self._writer.add_schema(told.name, told.encoding, told.text.encode())
        return self._writer.add_channel(topic.in_file, layout.ENCODING, schema, topic.metadata)

    def _finish(self) -> None:
        if self._writer is None or self._file is None:
            return
        with self._errors():
            self._writer.finish()
            self._octets += self._writer.octets
            self._file.close()
        self._file, self._writer = None, None
        self._done.append(Span(self._path(self._number).name, self._start, self._end, dict(self._counts)))
        self._number += 1
        with self._errors():
            gone = []
            while self._options.keep and len(self._done) > self._options.keep:
                gone.append(self._done.popleft())
            write_metadata(self.folder, list(self._done), [self._described(each) for each in self._topics])
            for each in gone:  # after the metadata: it must never name a file that is not there
                (self.folder / each.file).unlink(missing_ok=True)

    def discard(self) -> None:
        """After `close`: remove the files, and the folder if nothing else is in it. Raises OSError."""
        for each in (self.folder / METADATA, *map(self._path, range(self._number + 1))):
            each.unlink(missing_ok=True)
        self.folder.rmdir()

    def _described(self, topic: Topic | Foreign) -> Described:
        kind = topic.type if isinstance(topic, Foreign) else topic.schema(self._options.schema).name
        return Described(topic.in_file, kind, topic.metadata.get("offered_qos_profiles", ""))

    @contextlib.contextmanager
    def _errors(self) -> Any:
        try:
            yield
        except OSError as exc:
            raise RecordingError(f"{self._path(self._number)}: {exc.strerror or exc}") from exc


def _position(file: IO[bytes]) -> int:
    try:
        return os.fstat(file.fileno()).st_size
    except OSError:
        return 0


def write_metadata(folder: Path, files: list[Span], topics: list[Described]) -> None:
    """Replace `metadata.yaml` at once. Raises OSError."""
    new = folder / f".{METADATA}.new"
    new.write_text(layout.bag_metadata(files, topics), encoding="utf-8")
    new.replace(folder / METADATA)
