"""Writes one MCAP file. Large messages are not copied: they go to the file from where they are.

The writer of the library copies each message three times, which took a quarter of a core at 180 MB/s. Its records
still write what is rare: schemas, channels, attachments and the summary.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mcap.records import McapRecord, Statistics

CHUNK = 1024 * 1024
"""Octets of a chunk, before compression. A reader of a broken file gets whole chunks."""

MAGIC = b"\x89MCAP0\r\n"

_LARGE = CHUNK // 4
"""A message of at least this number of octets is not copied, but held until its chunk is written."""

_SAMPLE = 32 * 1024
"""Octets that are compressed to find out whether a large message becomes smaller."""

_WORTH = 0.95
"""If samples keep at least this part of their size, their chunk is not compressed."""

_MESSAGE = struct.Struct("<BQHIQQ")  # opcode · length · channel · sequence · log time · publish time
_CHUNK = struct.Struct("<BQQQQI")  # opcode · length · first log time · last · octets · their CRC-32
_U32, _U64 = struct.Struct("<I"), struct.Struct("<Q")
_INDEX = struct.Struct("<BQHI")  # opcode · length · channel · octets of the entries
_ENTRY = struct.Struct("<QQ")  # log time · place in the chunk

Octets = bytes | bytearray | memoryview
Compress = Callable[[Octets], bytes]


class McapFile:
    """An MCAP file that is being written. The caller closes the descriptor. All methods may raise OSError."""

    def __init__(self, descriptor: int, compress: str = "none") -> None:
        from mcap.opcode import Opcode
        from mcap.records import Statistics

        self._descriptor = descriptor
        self._compression = "" if compress == "none" else compress
        self._compress = _compressor(compress)
        self._opcode = Opcode
        self.octets = 0
        """Of the file."""
        self._parts: list[Octets] = []
        """The present chunk; the last one is a bytearray, which takes small messages."""
        self._size = 0
        self._start = self._end = 0
        self._indexes: dict[int, bytearray] = {}
        """Of the present chunk, by channel."""
        self._statistics: Statistics = Statistics(0, 0, {}, 0, 0, 0, 0, 0, 0)
        self._schemas: list[McapRecord] = []
        self._channels: list[McapRecord] = []
        self._chunks: list[McapRecord] = []
        self._attachments: list[McapRecord] = []
        self._metadata: list[McapRecord] = []

    @property
    def messages(self) -> int:
        return self._statistics.message_count

    def start(self, profile: str, library: str) -> None:
        from mcap.records import Header

        self._put(MAGIC, _packed(Header(profile, library)))

    def add_schema(self, name: str, encoding: str, text: bytes) -> int:
        from mcap.records import Schema

        self._statistics.schema_count = number = len(self._schemas) + 1
        self._schemas.append(Schema(id=number, data=text, encoding=encoding, name=name))
        self._append(_packed(self._schemas[-1]))
        return number

    def add_channel(self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        from mcap.records import Channel

        self._statistics.channel_count = number = len(self._channels) + 1
        channel = Channel(id=number, topic=topic, message_encoding=encoding, metadata=dict(metadata), schema_id=schema)
        self._channels.append(channel)
        self._append(_packed(channel))
        return number

    def add_message(self, channel: int, log_time: int, data: Octets, publish_time: int, sequence: int) -> None:
        """Times are in ns since 1970, not below 0. `data` may not change until `flush` or the end of the chunk."""
        size, told = len(data), self._statistics
        if told.message_count == 0:
            told.message_start_time = told.message_end_time = log_time
        told.message_start_time = min(told.message_start_time, log_time)
        told.message_end_time = max(told.message_end_time, log_time)
        told.message_count += 1
        told.channel_message_counts[channel] = told.channel_message_counts.get(channel, 0) + 1
        if not self._indexes:
            self._start = self._end = log_time
        self._start, self._end = min(self._start, log_time), max(self._end, log_time)
        index = self._indexes.get(channel)
        if index is None:
            index = self._indexes[channel] = bytearray()
        index += _ENTRY.pack(log_time, self._size)
        head = _MESSAGE.pack(self._opcode.MESSAGE, _MESSAGE.size - 9 + size, channel, sequence, log_time, publish_time)
        self._append(head)
        self._append(data)
        if self._size > CHUNK:
            self._end_chunk()

    def add_attachment(self, create_time: int, log_time: int, name: str, media_type: str, data: bytes) -> None:
        from mcap.records import Attachment, AttachmentIndex

        record = _packed(Attachment(create_time, log_time, name, media_type, data))
        self._statistics.attachment_count += 1
        self._attachments.append(
            AttachmentIndex(self.octets, len(record), log_time, create_time, len(data), name, media_type)
        )
        self._put(record)

    def add_metadata(self, name: str, texts: dict[str, str]) -> None:
        from mcap.records import Metadata, MetadataIndex

        record = _packed(Metadata(name, texts))
        self._statistics.metadata_count += 1
        self._metadata.append(MetadataIndex(offset=self.octets, length=len(record), name=name))
        self._put(record)

    def flush(self) -> None:
        """Write the present chunk, unless it has no messages."""
        if self._indexes:
            self._end_chunk()

    def finish(self) -> None:
        """Write the rest, and the summary."""
        from mcap.records import DataEnd, Footer, SummaryOffset

        self.flush()
        self._put(_packed(DataEnd(0)))
        begin, summary, offsets = self.octets, bytearray(), bytearray()
        for opcode, records in (
            (self._opcode.SCHEMA, self._schemas),
            (self._opcode.CHANNEL, self._channels),
            (self._opcode.STATISTICS, [self._statistics]),
            (self._opcode.CHUNK_INDEX, self._chunks),
            (self._opcode.ATTACHMENT_INDEX, self._attachments),
            (self._opcode.METADATA_INDEX, self._metadata),
        ):
            start = len(summary)
            for each in records:
                summary += _packed(each)
            if len(summary) > start:
                offsets += _packed(SummaryOffset(opcode, begin + start, len(summary) - start))
        places = begin, begin + len(summary)
        summary += offsets
        crc = zlib.crc32(struct.pack("<BQQQ", self._opcode.FOOTER, 20, *places), zlib.crc32(summary))
        self._put(summary, _packed(Footer(*places, crc)), MAGIC)

    def _append(self, octets: Octets) -> None:
        self._size += len(octets)
        if len(octets) >= _LARGE:
            self._parts += octets, bytearray()
            return
        if not self._parts:
            self._parts.append(bytearray())
        last = self._parts[-1]
        assert isinstance(last, bytearray)
        last += octets

    def _end_chunk(self) -> None:
        from mcap.records import ChunkIndex

        crc = 0
        for part in self._parts:
            crc = zlib.crc32(part, crc)
        parts, compression = self._compressed()
        size, name = sum(map(len, parts)), compression.encode()
        length = _CHUNK.size - 9 + 4 + len(name) + 8 + size
        head = _CHUNK.pack(self._opcode.CHUNK, length, self._start, self._end, self._size, crc)
        place, indexes, places = self.octets, bytearray(), dict[int, int]()
        behind = place + 9 + length
        for channel, entries in self._indexes.items():
            places[channel] = behind + len(indexes)
            indexes += _INDEX.pack(self._opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries)) + entries
        self._chunks.append(
            ChunkIndex(
                chunk_length=9 + length,
                chunk_start_offset=place,
                compression=compression,
                compressed_size=size,
                message_end_time=self._end,
                message_index_length=len(indexes),
                message_index_offsets=places,
                message_start_time=self._start,
                uncompressed_size=self._size,
            )
        )
        self._statistics.chunk_count += 1
        self._parts, self._size, self._indexes = [], 0, {}
        self._put(head + _U32.pack(len(name)) + name + _U64.pack(size), *parts, indexes)

    def _compressed(self) -> tuple[Sequence[Octets], str]:
        """The present chunk as it is written, and its compression: none if that would not make it smaller."""
        if not self._compression or not self._is_compressible():
            return self._parts, ""
        return [self._compress(b"".join(self._parts))], self._compression

    def _is_compressible(self) -> bool:
        """Whether samples of its largest message become smaller. A chunk of small messages is compressed anyway."""
        largest = max(self._parts, key=len)
        size = len(largest)
        if size < 4 * _SAMPLE or size < self._size / 2:
            return True
        view = memoryview(largest)
        samples = (view[place : place + _SAMPLE] for place in (size // 4, size // 2, size - _SAMPLE))
        return any(len(self._compress(each)) < _WORTH * _SAMPLE for each in samples)

    def _put(self, *parts: Octets) -> None:
        """Write all of it."""
        views = [memoryview(part).cast("B") for part in parts if len(part)]
        while views:
            taken = os.writev(self._descriptor, views[:_MOST_PARTS])
            self.octets += taken
            while views and taken >= len(views[0]):
                taken -= len(views.pop(0))
            if taken:
                views[0] = views[0][taken:]


_MOST_PARTS = 256
"""Parts that one system call takes; the smallest limit of the systems that we know is 1024."""


def _packed(record: McapRecord) -> bytes:
    from mcap.data_stream import RecordBuilder

    builder = RecordBuilder()
    record.write(builder)
    octets: bytes = builder.end()  # type: ignore[no-untyped-call]  # the library's
    return octets


def _compressor(name: str) -> Compress:
    if name not in _MODULES:
        return bytes
    found: Compress = import_module(_MODULES[name]).compress
    return found


_MODULES = {"lz4": "lz4.frame", "zstd": "zstandard"}
"""By the name of a compression."""
