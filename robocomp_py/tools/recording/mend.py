"""Saves what is whole in a file that has no end or is damaged.

A file that was interrupted ends in a chunk that is cut, and has neither index nor statistics, so most readers refuse
it. All its whole chunks are copied into a new file.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

from .bag import BagWriter, Foreign, Options
from .formats import need_mcap
from .reader import LARGEST, MAGIC, broken, extra_of, files_of, open_checked

if TYPE_CHECKING:
    from mcap.records import Channel, Chunk, Schema

_Key = tuple[str, str, str, bytes, str]
"""What tells topics apart: their names, types, encodings, definitions and metadata."""

_HEAD = struct.Struct("<BQ")


class Mended(NamedTuple):
    """What was found in one file."""

    path: Path
    messages: int
    damaged: int
    """Chunks and records that were left out, because their content is wrong."""
    cut: int
    """Octets behind the last whole record."""
    is_whole: bool
    """Whether the file has an end, so nothing had to be mended."""


def mend(path: Path, folder: Path, options: Options) -> list[Mended]:
    """Copy all that is whole in a recording into a new one. Raises RecordingError and ConfigurationError."""
    need_mcap()
    found: list[Mended] = []
    files = files_of(path)
    writer = BagWriter(folder, options)
    try:
        known: dict[_Key, int] = {}
        for each in files:
            if each is files[-1] and found and _has_just_begun(each):
                found.append(Mended(each, 0, 0, each.stat().st_size, is_whole=False))
            else:
                found.append(_mend(each, writer, known))
        writer.close()
    finally:
        writer.abandon()
    return found


def _has_just_begun(path: Path) -> bool:
    """Whether a recorder was killed before it had written the first octets of a file."""
    with path.open("rb") as file:
        begin = file.read(len(MAGIC))
    return len(begin) < len(MAGIC) and MAGIC.startswith(begin)


def _mend(path: Path, writer: BagWriter, known: dict[_Key, int]) -> Mended:
    from mcap.records import Chunk

    copy = _Copy(writer, known)
    damaged = 0
    file, octets = open_checked(path)
    with file:
        scan = _Scan(file, octets)
        for record in scan.records():
            try:
                inside = _records_in(record) if isinstance(record, Chunk) else [record]
            except broken():
                damaged += 1
                continue
            copy.add(inside)
    damaged += copy.lost + scan.unreadable
    return Mended(path, copy.messages, damaged, scan.cut, scan.is_whole)


def _records_in(chunk: Chunk) -> Sequence[object]:
    from mcap.stream_reader import breakup_chunk

    if chunk.uncompressed_size > LARGEST:
        raise ValueError("too large")
    return breakup_chunk(chunk, validate_crc=True)


class _Copy:
    """Writes the records of one file to another recording, which may have topics of the files before."""

    def __init__(self, writer: BagWriter, known: dict[_Key, int]) -> None:
        """`known` are the topics of the recording so far, with their numbers."""
        self._writer, self._known = writer, known
        self._schemas: dict[int, Schema] = {}
        self._topics: dict[int, int] = {}
        """The numbers of topics, by their numbers in the file."""
        self.messages = 0
        self.lost = 0
        """Messages whose channel was in a damaged chunk."""

    def add(self, records: Sequence[object]) -> None:
        from mcap.records import Channel, Message, Schema

        for each in records:
            if (extra := extra_of(each)) is not None:
                self._writer.add_extra(extra)
                continue
            match each:
                case Schema():
                    self._schemas[each.id] = each
                case Channel() if each.id not in self._topics:
                    self._topics[each.id] = self._topic(each)
                case Message() if each.channel_id in self._topics:
                    self.messages += 1
                    topic = self._topics[each.channel_id]
                    self._writer.write(topic, each.data, each.log_time, each.publish_time, each.sequence)
                case Message():
                    self.lost += 1

    def _topic(self, channel: Channel) -> int:
        schema = self._schemas.get(channel.schema_id)
        foreign = Foreign(
            channel.topic,
            schema.name if schema else "",
            channel.message_encoding,
            schema.encoding if schema else "",
            schema.data if schema else b"",
            dict(channel.metadata),
        )
        key = (foreign.in_file, foreign.type, foreign.encoding, foreign.text, str(foreign.metadata))
        if key not in self._known:
            self._known[key] = self._writer.add(foreign)
        return self._known[key]


class _Scan:
    """The records of a file, as far as they are whole. Content of chunks is not looked at."""

    def __init__(self, file: IO[bytes], octets: int) -> None:
        self._file, self._octets = file, octets
        self.cut = self.unreadable = 0
        self.is_whole = False

    def records(self) -> Iterator[object]:
        from mcap.data_stream import ReadDataStream
        from mcap.opcode import Opcode
        from mcap.records import Attachment, Channel, Chunk, Message, Metadata, Schema

        at = len(MAGIC)
        self._file.seek(at)
        while True:
            head = self._file.read(_HEAD.size)
            if len(head) < _HEAD.size:
                self.cut = self._octets - at
                return
            opcode, length = _HEAD.unpack(head)
            end = at + _HEAD.size + length
            if end > self._octets or length > LARGEST:
                self.cut = self._octets - at
                return
            if opcode == Opcode.FOOTER:
                self._file.seek(end)
                self.is_whole = self._file.read(len(MAGIC)) == MAGIC
                return
            if opcode == Opcode.DATA_END:
                self._file.seek(end)
                at = end
                continue  # schemas and channels follow again, which are known
            kind: Any = {
                Opcode.SCHEMA: Schema,
                Opcode.CHANNEL: Channel,
                Opcode.CHUNK: Chunk,
                Opcode.ATTACHMENT: Attachment,
                Opcode.METADATA: Metadata,
            }.get(opcode)
            if kind or opcode == Opcode.MESSAGE:
                stream = ReadDataStream(io.BytesIO(self._file.read(length)))
                try:
                    yield Message.read(stream, length) if kind is None else kind.read(stream)
                except broken():
                    self.unreadable += 1
            self._file.seek(end)
            at = end
