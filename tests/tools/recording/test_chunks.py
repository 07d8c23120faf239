"""Files are those that the library for MCAP writes, except that nothing is compressed in vain."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from robocomp_py.tools.recording.chunks import CHUNK, McapFile

_SIZES = [10, 300_000, 0, 20_000, CHUNK + 5, 5, 400_000, 400_000, 400_000, 7]


def _messages() -> Iterator[tuple[int, int, bytes, int, int]]:
    """Channel, log time, data, publish time, sequence; not in the order of their times."""
    chance = random.Random(1)
    for number, size in enumerate(_SIZES):
        yield number % 2 + 1, chance.randrange(10**9), bytes(chance.randbytes(16) * size)[:size], number, number


def _ours(path: Path, compress: str = "none", data: bytes = b"") -> bytes:
    with path.open("xb", buffering=0) as file:
        ours = McapFile(file.fileno(), compress)
        ours.start("ros2", "a library")
        schema = ours.add_schema("House/Camera", "ros2msg", b"uint8[] pixels")
        for name in "ab":
            ours.add_channel(name, "cdr", schema, {"more": name})
        if data:
            ours.add_message(1, 0, data, 0, 0)
        else:
            for number, each in enumerate(_messages()):
                ours.add_message(*each)
                if number == 3:
                    ours.flush()
            ours.add_attachment(1, 2, "plan", "text/plain", b"hello")
            ours.add_metadata("about", {"one": "two"})
        ours.finish()
    octets = path.read_bytes()
    assert ours.octets == len(octets)
    return octets


def _theirs(path: Path) -> bytes:
    with path.open("xb") as file:
        theirs: Any = Writer(file, compression=CompressionType.NONE)
        theirs.start("ros2", "a library")
        schema = theirs.register_schema("House/Camera", "ros2msg", b"uint8[] pixels")
        for name in "ab":
            theirs.register_channel(name, "cdr", schema, {"more": name})
        for number, (channel, log_time, data, publish_time, sequence) in enumerate(_messages()):
            theirs.add_message(channel, log_time, data, publish_time, sequence)
            if number == 3:
                theirs.flush()
        theirs.add_attachment(1, 2, "plan", "text/plain", b"hello")
        theirs.add_metadata("about", {"one": "two"})
        theirs.finish()
    return path.read_bytes()


def _summary(path: Path) -> Any:
    with path.open("rb") as file:
        return make_reader(file, validate_crcs=True).get_summary()


def test_messages_are_written_as_by_the_library(tmp_path: Path) -> None:
    ours, theirs = _ours(tmp_path / "ours"), _theirs(tmp_path / "theirs")
    end = int.from_bytes(theirs[-28:-20], "little")  # where the summary begins
    assert ours[:end] == theirs[:end]


def test_the_summary_says_the_same_as_that_of_the_library(tmp_path: Path) -> None:
    _ours(tmp_path / "ours"), _theirs(tmp_path / "theirs")
    assert vars(_summary(tmp_path / "ours")) == vars(_summary(tmp_path / "theirs"))


@pytest.mark.parametrize("compress", ["lz4", "zstd"])
@pytest.mark.parametrize("becomes_smaller", [True, False])
def test_a_large_message_is_compressed_if_that_makes_it_smaller(
    tmp_path: Path, compress: str, becomes_smaller: bool
) -> None:
    data = bytes(2 * CHUNK) if becomes_smaller else random.Random(1).randbytes(2 * CHUNK)
    path = tmp_path / "file"
    octets = _ours(path, compress, data)
    assert [each.compression for each in _summary(path).chunk_indexes] == [compress if becomes_smaller else ""]
    assert (len(octets) < CHUNK) == becomes_smaller
    with path.open("rb") as file:
        assert [each.data for *_, each in make_reader(file, validate_crcs=True).iter_messages()] == [data]


def test_a_message_that_becomes_smaller_only_at_its_end_is_compressed(tmp_path: Path) -> None:
    path = tmp_path / "file"
    _ours(path, "lz4", random.Random(1).randbytes(CHUNK) + bytes(CHUNK // 2))
    assert [each.compression for each in _summary(path).chunk_indexes] == ["lz4"]
