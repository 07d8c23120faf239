"""Reads recordings: ours, and others whose files are MCAP.

A recording is a file, or a folder with files of one recording. All of it comes from outside: each error of the format
is a RecordingError, which says which file, what is wrong, and what to do.
"""

from __future__ import annotations

import contextlib
import heapq
import io
import os
import struct
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

from ...closing import Closing
from ...contract import told
from ...contract.interface import Operation, Pattern
from ...contract.qos import QoS
from ...printable import one_line
from ...spelling import beside, closest
from ...wire.cdr import Cdr
from ...wire.codec import Decoder
from ..network import contains
from .bag import Attached, Note, RecordingError
from .formats import need_mcap
from .layout import ENCODING, qos_of

if TYPE_CHECKING:
    from mcap.reader import SeekingReader
    from mcap.records import Channel, Schema

SUFFIX = ".mcap"

MAGIC = b"\x89MCAP0\r\n"

LARGEST = 1024 * 1024 * 1024
"""Octets of a record, or of a chunk without compression. Larger ones are refused."""


@dataclass(frozen=True)
class RecordedTopic:
    """A channel of a recording. Equal channels of several files are one."""

    name: str
    """Without the slash in front: `world/LaserPub/pushLaserData`."""
    in_file: str
    """As the file spells it."""
    type: str
    """The name of its schema."""
    encoding: str
    """Of the messages: `cdr`."""
    schema_encoding: str
    schema: bytes = field(repr=False)
    metadata: dict[str, str] = field(repr=False, hash=False)
    operation: Operation[Any] | None = field(repr=False)
    """The contract; None in a recording of another program."""
    problem: str
    """Why messages cannot be decoded here; empty if they can."""
    called: Operation[Any] | None = field(default=None, repr=False)
    """The operation that was called, if these are calls; see `recording.calls`."""

    @property
    def publisher(self) -> str:
        return one_line(self.metadata.get("publisher", ""))

    @property
    def middleware(self) -> str:
        """Over which it was heard."""
        return one_line(self.metadata.get("middleware", ""))

    @property
    def pattern(self) -> Pattern:
        """How it was sent."""
        told = self.metadata.get("pattern", "")
        return Pattern(told) if told in set(Pattern) else Pattern.PUBLISH

    @property
    def qos(self) -> QoS:
        """What its publisher offered."""
        return qos_of(self.metadata)

    def decoder(self) -> Decoder:
        """A function from the data of a message to the values of its fields. Raises RecordingError if there is none;
        the function raises DecodeError."""
        if self.operation is None:
            raise RecordingError(f"{self.name}: {self.problem}")
        return Cdr().decoder(self.operation.request)


class Recorded(NamedTuple):
    """A message of a recording. Times are in ns since 1970."""

    log_time: int
    """When it was recorded."""
    publish_time: int
    """When it was sent; as `log_time` if that is not known."""
    sequence: int
    """Its number among those of its publisher, modulo 2^32; 0 if that is not known."""
    topic: RecordedTopic
    data: bytes
    """CDR, if the topic has no problem."""


class Recording(Closing):
    """An open recording. Closing it closes its files."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Raises RecordingError, and ConfigurationError if the library is missing."""
        need_mcap()
        self.path = Path(path)
        self._end = contextlib.ExitStack()
        try:
            self.files = [_File(each, self._end) for each in files_of(self.path)]
        except BaseException:
            self._end.close()
            raise
        self.topics: dict[str, RecordedTopic] = {}
        """By name, in its order."""
        self.counts: dict[str, int] = {}
        """Messages by topic."""
        for file in self.files:
            for name, topic in file.topics.items():
                self.topics.setdefault(name, topic)
                self.counts[name] = self.counts.get(name, 0) + file.counts.get(name, 0)
        self.topics = dict(sorted(self.topics.items()))
        filled = [each for each in self.files if each.messages]
        self.start = min((each.start for each in filled), default=0)
        """Of the first message; 0 without messages."""
        self.end = max((each.end for each in filled), default=0)
        self.attachments = [each for file in self.files for each in file.attachments]
        """Their names and sizes."""

    def close(self) -> None:
        self._end.close()

    @property
    def octets(self) -> int:
        return sum(each.octets for each in self.files)

    def messages(
        self, names: Collection[str] | None = None, start: int | None = None, end: int | None = None
    ) -> Iterator[Recorded]:
        """In the order of their log times: of these topics, from `start` on and before `end`, in ns since 1970.

        Raises RecordingError for a topic that is not in the recording, and where a file is broken.
        """
        for each in names or ():
            if each.removeprefix("/") not in self.topics:
                raise RecordingError(not_recorded(self, each))
        several = [each.messages_of(names, start, end) for each in self.files]
        return several[0] if len(several) == 1 else heapq.merge(*several, key=lambda each: each.log_time)

    def extras(self) -> Iterator[Attached | Note]:
        """What its files hold beside messages. Raises RecordingError where a file is broken."""
        for each in self.files:
            yield from each.extras()


def files_of(path: Path) -> list[Path]:
    """The files of a recording, in their order. Raises RecordingError."""
    if not path.exists():
        near = beside(path)
        raise RecordingError(f"{path}: no such file or folder" + (f"; did you mean `{near}`?" if near else ""))
    if not path.is_dir():
        return [path]
    try:
        found = sorted((each for each in path.iterdir() if each.suffix == SUFFIX), key=_numbered)
    except OSError as exc:
        raise RecordingError(f"{path}: {exc.strerror}") from exc
    if not found:
        raise RecordingError(f"{path}: this folder has no files *{SUFFIX}")
    return found


def _numbered(path: Path) -> tuple[str, int, str]:
    name, _, number = path.stem.rpartition("_")
    return (name, int(number), "") if number.isdecimal() and number.isascii() else (path.stem, -1, "")


class _File:
    def __init__(self, path: Path, end: contextlib.ExitStack) -> None:
        from mcap.reader import SeekingReader

        self.path = path
        file, self.octets = open_checked(path)
        end.callback(file.close)
        with reading(path):
            self._reader: SeekingReader = SeekingReader(file, validate_crcs=True, record_size_limit=LARGEST)
            try:
                summary = self._reader.get_summary()
            except Exception as exc:
                raise RecordingError(f"{path}: it has no end{_UNFINISHED}") from exc
            if summary is None or summary.statistics is None:
                raise RecordingError(f"{path}: it has no index{_UNFINISHED}")
            if summary.statistics.message_count and not summary.chunk_indexes:
                raise RecordingError(f"{path}: it has no index{_UNFINISHED}")
            if any(each.uncompressed_size > LARGEST for each in summary.chunk_indexes):
                raise RecordingError(f"{path}: it has a chunk of more than {LARGEST} octets")
            statistics = summary.statistics
            self.messages = statistics.message_count
            self.start, self.end = statistics.message_start_time, statistics.message_end_time
            self.compressions = sorted({each.compression or "none" for each in summary.chunk_indexes})
            self.attachments = [(each.name, each.data_size) for each in summary.attachment_indexes]
            self._by_id: dict[int, RecordedTopic] = {
                number: recorded_topic(channel, summary.schemas.get(channel.schema_id))
                for number, channel in summary.channels.items()
            }
            self.topics = {each.name: each for each in self._by_id.values()}
            self.counts: dict[str, int] = {}
            for number, count in statistics.channel_message_counts.items():
                if number in self._by_id:
                    name = self._by_id[number].name
                    self.counts[name] = self.counts.get(name, 0) + count

    def messages_of(self, names: Collection[str] | None, start: int | None, end: int | None) -> Iterator[Recorded]:
        wanted = [f"/{each}" for each in names] + list(names) if names is not None else None
        with reading(self.path):
            found = self._reader.iter_messages(wanted, starting_at=start, ending_before=end)
            for _, channel, message in found:
                topic = self._by_id[channel.id]
                yield Recorded(message.log_time, message.publish_time, message.sequence, topic, message.data)

    def extras(self) -> Iterator[Attached | Note]:
        with reading(self.path):
            for found in (*self._reader.iter_attachments(), *self._reader.iter_metadata()):
                if (extra := extra_of(found)) is not None:
                    yield extra


def extra_of(record: object) -> Attached | Note | None:
    """What a record holds beside messages, if it is worth a copy: what rosbag2 writes about a whole file is not."""
    from mcap.records import Attachment, Metadata

    match record:
        case Attachment(create_time, log_time, name, media_type, data):
            return Attached(name, media_type, data, log_time, create_time)
        case Metadata(name, texts) if name != "rosbag2":
            return Note(name, texts)
    return None


_UNFINISHED = ": it is still being written, or was interrupted; `rc bag mend` makes a readable copy"


def open_checked(path: Path) -> tuple[IO[bytes], int]:
    """The open file and its size. Raises RecordingError if it is no MCAP file."""
    try:
        file = open(path, "rb")  # noqa: SIM115 - the caller closes it
    except OSError as exc:
        raise RecordingError(f"{path}: {exc.strerror}") from exc
    try:
        begin = file.read(len(MAGIC))
        octets = file.seek(0, io.SEEK_END)
        file.seek(0)
    except OSError as exc:
        file.close()
        raise RecordingError(f"{path}: {exc.strerror}") from exc
    if begin != MAGIC:
        file.close()
        raise RecordingError(f"{path}: this is no MCAP file" if octets else f"{path}: this file is empty")
    return file, octets


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """Whatever the library raises about a file becomes a RecordingError."""
    try:
        yield
    except (RecordingError, GeneratorExit):
        raise
    except OSError as exc:
        raise RecordingError(f"{path}: {exc.strerror or exc}") from exc
    except broken() as exc:
        raise RecordingError(f"{path}: it is damaged ({_short(exc)}); `rc bag mend` saves what is whole") from exc


def broken() -> tuple[type[Exception], ...]:
    """What the library raises about damaged files."""
    from mcap.exceptions import McapError
    from zstandard import ZstdError

    return (
        McapError,
        ZstdError,
        ValueError,
        LookupError,
        ArithmeticError,
        EOFError,
        RuntimeError,
        struct.error,
        MemoryError,
    )


def _short(exc: Exception) -> str:
    text = str(exc).splitlines()[0][:100] if str(exc) else ""
    return f"{type(exc).__name__}: {text}" if text else type(exc).__name__


def recorded_topic(channel: Channel, schema: Schema | None) -> RecordedTopic:
    """A channel as we know it. Its contract is checked, since the file comes from outside."""
    operation, problem = None, ""
    definition = channel.metadata.get("definition")
    if channel.message_encoding != ENCODING:
        problem = f"its messages are {channel.message_encoding[:40] or 'of no encoding'}, not {ENCODING}"
    elif definition is None:
        problem = "the recording has no contract of it, so another program has written it"
    else:
        try:
            operation = told.operation(definition)
        except ValueError as exc:
            problem = f"its contract is not understood: {exc}"
    return RecordedTopic(
        one_line(channel.topic.removeprefix("/")),
        channel.topic,
        one_line(schema.name) if schema else "",
        channel.message_encoding,
        schema.encoding if schema else "",
        schema.data if schema else b"",
        dict(channel.metadata),
        operation,
        one_line(problem),
        _called(channel.metadata) if operation else None,
    )


def _called(metadata: Mapping[str, str]) -> Operation[Any] | None:
    """The operation whose calls these are."""
    try:
        return told.operation(metadata["called"])
    except (KeyError, ValueError):
        return None


Values = Callable[[Recorded], tuple[Any, ...]]


def values_by_topic() -> Values:
    """A function from a message to its values, as `RecordedTopic.decoder` gives them."""
    decoders: dict[str, Decoder] = {}

    def values(message: Recorded) -> tuple[Any, ...]:
        name = message.topic.name
        if name not in decoders:
            decoders[name] = message.topic.decoder()
        return decoders[name](message.data)

    return values


def named(recording: Recording, name: str) -> list[str]:
    """The topics that a name means: a whole one, or a part of it between slashes. Raises RecordingError."""
    wanted = name.strip("/").split("/")
    found = [each for each in recording.topics if contains(each.split("/"), wanted)]
    if not found:
        raise RecordingError(not_recorded(recording, name, parts=True))
    return found


def not_recorded(recording: Recording, name: str, *, parts: bool = False) -> str:
    """The message for a topic that a recording does not have. With `parts`, a part of a name may be meant, too."""
    topics = recording.topics
    known = {part for each in topics for part in (each, *(each.split("/") if parts else ()))}
    near = closest(name.strip("/"), known)
    hint = f"did you mean `{near}`?" if near else f"it has {', '.join(topics) or 'no topics'}"
    return f"{recording.path}: `{name}` is not in it; {hint}"
