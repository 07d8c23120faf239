"""Saves what is whole in a file that has no end or is damaged.

A file that was interrupted ends in a chunk that is cut, and has neither index nor statistics, so most readers refuse
it. All its whole chunks are copied into a new file.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

from .bag import BagWriter, Foreign, Options
from .formats import need_mcap
from .reader import LARGEST, MAGIC, broken, extra_of, files_of, open_checked

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
        known: dict[tuple[str, str, str, bytes, str], int] = {}
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


def _mend(path: Path, writer: BagWriter, known: dict[tuple[str, str, str, bytes, str], int]) -> Mended:
    from mcap.records import Channel, Chunk, Message, Schema
    from mcap.stream_reader import breakup_chunk

    schemas: dict[int, Schema] = {}
    topics: dict[int, int] = {}
    messages = damaged = 0
    file, octets = open_checked(path)
    with file:
        scan = _Scan(file, octets)
        for record in scan.records():
            inside: Sequence[object] = [record]
            if isinstance(record, Chunk):
                try:
                    if record.uncompressed_size > LARGEST:
                        raise ValueError("too large")
                    inside = breakup_chunk(record, validate_crc=True)
                except broken():
                    damaged += 1
                    continue
            for each in inside:
                if (extra := extra_of(each)) is not None:
                    writer.add_extra(extra)
                    continue
                match each:
                    case Schema():
                        schemas[each.id] = each
                    case Channel() if each.id not in topics:
                        schema = schemas.get(each.schema_id)
                        foreign = Foreign(
                            each.topic,
                            schema.name if schema else "",
                            each.message_encoding,
                            schema.encoding if schema else "",
                            schema.data if schema else b"",
                            dict(each.metadata),
                        )
                        key = (foreign.in_file, foreign.type, foreign.encoding, foreign.text, str(foreign.metadata))
                        if key not in known:
                            known[key] = writer.add(foreign)
                        topics[each.id] = known[key]
                    case Message() if each.channel_id in topics:
                        messages += 1
                        writer.write(
                            topics[each.channel_id], each.data, each.log_time, each.publish_time, each.sequence
                        )
                    case Message():
                        damaged += 1  # its channel was in a damaged chunk
    return Mended(path, messages, damaged + scan.unreadable, scan.cut, scan.is_whole)


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
