"""Files that are broken in any way are told in one sentence, and what is whole in them is saved."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from robocomp_py.cli import rc
from robocomp_py.tools.recording.bag import Attached, BagWriter, Note, Options, RecordingError
from robocomp_py.tools.recording.mend import mend
from robocomp_py.tools.recording.reader import Recording

from ..commands import said
from .recordings import filled, news, numbers_in, told

OCTETS = 300_000


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A file with 20 messages in about six chunks."""
    folder = filled(tmp_path_factory.mktemp("whole") / "run", Options(), 20, OCTETS)
    return (folder / "run_0.mcap").read_bytes()


def saved(path: Path, folder: Path) -> list[int]:
    mend(path, folder, Options())
    return numbers_in(folder)


BREAKS: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "no magic": (lambda data: b"x" + data[1:], "this is no MCAP file"),
    "empty": (lambda data: b"", "this file is empty"),
    "no footer": (lambda data: data[:-40], "it has no end: it is still being written, or was interrupted"),
    "cut in a chunk": (lambda data: data[: len(data) // 2], "`rc bag mend` makes a readable copy"),
    "only magic": (lambda data: data[:8], "it has no end"),
    "wrong octet in a chunk": (
        lambda data: data[: len(data) // 2] + b"?" + data[len(data) // 2 + 1 :],
        "it is damaged (CRCValidationError",
    ),
}


@pytest.mark.parametrize("what", BREAKS)
def test_a_broken_file_is_told(what: str, whole: bytes, tmp_path: Path) -> None:
    broken, why = BREAKS[what]
    path = tmp_path / "run.mcap"
    path.write_bytes(broken(whole))
    with pytest.raises(RecordingError) as told:
        numbers_in(path)
    assert why in str(told.value)
    assert str(told.value).startswith(f"{path}: ")


@pytest.mark.parametrize("what", ["no footer", "cut in a chunk", "wrong octet in a chunk"])
def test_whole_chunks_are_saved(what: str, whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(BREAKS[what][0](whole))
    numbers = saved(path, tmp_path / "saved")
    assert sorted(set(numbers)) == numbers
    assert len(numbers) >= {"no footer": 20, "cut in a chunk": 7, "wrong octet in a chunk": 15}[what]


def test_a_file_that_is_whole_stays_as_it_is(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(whole)
    (found,) = mend(path, tmp_path / "saved", Options())
    assert (found.messages, found.damaged, found.cut, found.is_whole) == (20, 0, 0, True)


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(chance=st.randoms(use_true_random=False))
def test_no_damage_raises_anything_else(
    chance: random.Random, small: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    data = bytearray(small)
    for _ in range(chance.choice((1, 3, 30))):
        data[chance.randrange(8, len(data))] = chance.randrange(256)
    del data[chance.choice((len(data), chance.randrange(8, len(data)))) :]
    folder = tmp_path_factory.mktemp("damaged")
    (folder / "run.mcap").write_bytes(data)
    for work in (lambda: read_all(folder / "run.mcap"), lambda: mend(folder / "run.mcap", folder / "saved", Options())):
        with contextlib.suppress(RecordingError):
            work()


def read_all(path: Path) -> None:
    with Recording(path) as recording:
        for _ in recording.messages():
            pass


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = filled(tmp_path_factory.mktemp("small") / "run", Options("lz4"), 5)
    return (folder / "run_0.mcap").read_bytes()


def test_times_that_go_back_are_put_in_order(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run")
    topic = writer.add(told)
    for number, time in enumerate((5, 3, 4)):
        writer.write(topic, news(number), time, time, 0)
    writer.close()
    assert numbers_in(tmp_path / "run") == [1, 2, 0]


def foreign(path: Path, encoding: str, metadata: dict[str, str]) -> Path:
    """A file of another program."""
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("a/msg/B", "ros2msg", b"int32 x")
        channel = writer.register_channel("/b", encoding, schema, metadata)
        writer.add_message(channel, 1, b"\0\1\0\0\1\0\0\0", 1)
        writer.finish()  # type: ignore[no-untyped-call]  # the library's
    return path


@pytest.mark.parametrize(
    ("encoding", "metadata", "why"),
    [
        ("protobuf", {}, "its messages are protobuf, not cdr"),
        ("cdr", {}, "the recording has no contract of it, so another program has written it"),
        ("cdr", {"definition": "nonsense"}, "its contract is not understood: operation is missing"),
    ],
)
def test_what_cannot_be_decoded_is_told_and_copied(
    encoding: str, metadata: dict[str, str], why: str, tmp_path: Path
) -> None:
    path = foreign(tmp_path / "b.mcap", encoding, metadata)
    with Recording(path) as recording:
        (topic,) = recording.topics.values()
        assert topic.problem == why
        with pytest.raises(RecordingError, match="b: "):
            topic.decoder()
    (found,) = mend(path, tmp_path / "saved", Options())
    with Recording(str(tmp_path / "saved")) as recording:
        (topic,) = recording.topics.values()
        assert (topic.in_file, topic.encoding, found.messages) == ("/b", encoding, 1)


def test_what_cannot_be_a_row_of_a_table_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = foreign(tmp_path / "b.mcap", "protobuf", {})
    assert rc.main(["bag", "convert", str(path), "--to", "csv", "-o", str(tmp_path / "tables")]) == 1
    told = "rc bag convert: b: 1 message left out: its messages are protobuf, not cdr\n"
    assert capsys.readouterr() == ("", told)


def test_a_recording_without_messages_makes_no_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with open(tmp_path / "b.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()  # type: ignore[no-untyped-call]  # the library's
    assert rc.main(["bag", "convert", str(tmp_path / "b.mcap"), "--to", "csv", "-o", str(tmp_path / "tables")]) == 1
    assert capsys.readouterr() == ("", f"rc bag convert: {tmp_path / 'b.mcap'} has no messages\n")


@pytest.mark.parametrize("words", [("mend",), ("cut",), ("merge",), ("convert", "--to", "ros2msg")])
def test_attachments_and_metadata_are_copied(
    words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "b.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/b", "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.add_attachment(3, 4, "plan.json", "application/json", b"[1, 2]")
        writer.add_metadata("about", {"robot": "rescue"})
        writer.add_metadata("rosbag2", {"serialized_metadata": "of the file"})
        writer.finish()  # type: ignore[no-untyped-call]  # the library's
    said(capsys, "bag", words[0], path, *words[1:], "-o", tmp_path / "new")
    with Recording(tmp_path / "new") as recording:
        assert list(recording.extras()) == [
            Attached("plan.json", "application/json", b"[1, 2]", 4, 3),
            Note("about", {"robot": "rescue"}),
        ]
        assert recording.counts == {"b": 1}
    assert "attached: plan.json, 6 B" in said(capsys, "bag", "info", tmp_path / "new")


def test_a_folder_without_files_is_told(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"this folder has no files \*\.mcap"):
        Recording(tmp_path)
