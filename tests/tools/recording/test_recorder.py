"""Messages are recorded as they come, and read by us and by others."""

from __future__ import annotations

import resource
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from robocomp_py.contract.interface import Operation
from robocomp_py.contract.qos import DEFAULT_QOS, QoS
from robocomp_py.contract.types import INT32, STRING, Dictionary, Field
from robocomp_py.errors import ConfigurationError
from robocomp_py.testing.patience import wait_until
from robocomp_py.tools.recording.bag import BagWriter, Options, RecordingError
from robocomp_py.tools.recording.layout import Topic, qos_of
from robocomp_py.tools.recording.mend import mend
from robocomp_py.tools.recording.reader import Recording, values_by_topic
from robocomp_py.tools.recording.writer import Recorder, to_cdr
from robocomp_py.wire.cdr import TAIL, Cdr
from robocomp_py.wire.messagepack import MessagePack

from .recordings import LATCHED, NEWS, PICTURE, filled, news, numbers_in, seen, told


@pytest.mark.parametrize("compress", ["none", "lz4", "zstd"])
@pytest.mark.parametrize("schema", ["ros2msg", "omgidl"])
def test_what_is_recorded_is_read(compress: str, schema: str, tmp_path: Path) -> None:
    filled(tmp_path / "run", Options(compress, schema), 3)
    with Recording(tmp_path / "run") as recording:
        (topic,) = recording.topics.values()
        messages = list(recording.messages())
        values = [values_by_topic()(each) for each in messages]
    assert (topic.name, topic.operation, topic.publisher, topic.middleware) == ("hall/News/told", NEWS, "hall", "shm")
    assert (topic.qos, topic.problem, recording.counts) == (LATCHED, "", {"hall/News/told": 3})
    assert (recording.start, recording.end) == (0, 2 * 10**9)
    assert values == [(0, "hello"), (1, "hello"), (2, "hello")]
    assert [each[:3] for each in messages] == [(n * 10**9, max(0, n * 10**9 - 5), n + 1) for n in range(3)]


def test_parts_of_a_recording_are_read(tmp_path: Path) -> None:
    filled(tmp_path / "run", Options(), 5)
    with Recording(tmp_path / "run") as recording:
        found = list(recording.messages(["hall/News/told"], 1 * 10**9, 3 * 10**9))
        assert [each.sequence for each in found] == [2, 3]
        assert len(list(recording.messages(["/hall/News/told"]))) == 5


@pytest.mark.parametrize(
    ("name", "hint"), [("hall/News/tolt", "did you mean `hall/News/told`?"), ("arm", "it has hall/News/told")]
)
def test_a_topic_that_is_not_in_a_recording_is_told(tmp_path: Path, name: str, hint: str) -> None:
    filled(tmp_path / "run", Options(), 1)
    with Recording(tmp_path / "run") as recording, pytest.raises(RecordingError) as told:
        recording.messages([name])
    assert str(told.value) == f"{tmp_path / 'run'}: `{name}` is not in it; {hint}"


def test_the_folder_is_a_bag_of_ros(tmp_path: Path) -> None:
    filled(tmp_path / "run", Options(split_seconds=2), 4)
    with AnyReader([tmp_path / "run"], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        (connection,) = reader.connections
        found = [reader.deserialize(raw, connection.msgtype) for _, _, raw in reader.messages()]
        assert (connection.topic, connection.msgtype) == ("/hall/News/told", "house/msg/NewsTold")
        assert (reader.message_count, reader.duration) == (4, 3 * 10**9 + 1)
        (offered,) = connection.ext.offered_qos_profiles
        assert (offered.depth, offered.durability.name) == (3, "TRANSIENT_LOCAL")
    assert [(each.number, each.text) for each in found] == [(n, "hello") for n in range(4)]


def test_a_file_is_split_by_size_and_only_the_last_ones_are_kept(tmp_path: Path) -> None:
    folder = filled(tmp_path / "run", Options(split_octets=3_000_000, keep=2), 12, octets=1_000_000)
    assert [each.name for each in sorted(folder.iterdir())] == ["metadata.yaml", "run_1.mcap", "run_2.mcap"]
    assert numbers_in(folder) == list(range(4, 12))


def test_a_file_is_split_by_age(tmp_path: Path) -> None:
    folder = filled(tmp_path / "run", Options(split_seconds=3), 6)
    assert len(list(folder.glob("*.mcap"))) > 1
    assert numbers_in(folder) == list(range(6))


def test_a_folder_that_is_in_use_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes").touch()
    with pytest.raises(ConfigurationError, match="choose another folder with -o"):
        BagWriter(tmp_path)
    with pytest.raises(RecordingError, match=r"File exists|Not a directory"):
        BagWriter(tmp_path / "notes")


@pytest.mark.parametrize("qos", [QoS(), LATCHED, QoS(deadline=0.1, depth=1, lease=2.0)])
def test_the_qos_of_a_topic_is_kept(qos: QoS) -> None:
    assert qos_of(Topic("a/B/c", NEWS, qos=qos).metadata) == qos


@pytest.mark.parametrize("text", ["", "half", "{}", "[]", "[1]", '[{"reliability": 1}]', "[" * 9000])
def test_a_qos_that_is_not_understood_is_the_default(text: str) -> None:
    assert qos_of({"offered_qos_profiles": text}) == DEFAULT_QOS == qos_of({})


# While messages arrive.


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Recorder]:
    with Recorder(tmp_path / "run") as made:
        yield made


def test_all_that_arrives_is_written(recorder: Recorder) -> None:
    one, other = recorder.track(told), recorder.track(seen)
    pixels = Cdr().encoder(PICTURE.request)((np.arange(200, dtype=np.uint8),))
    for number in range(100):
        one.put(news(number), stamp=number, sequence=number + 1)
        other.put(pixels)
    recorder.close()
    assert (recorder.error, one.written, other.written, one.dropped) == (None, 100, 100, 0)
    with Recording(recorder.folder) as recording:
        found = list(recording.messages(["hall/News/told"]))
        assert [(each.publish_time, each.sequence) for each in found] == [(0 or found[0].log_time, 1)] + [
            (n, n + 1) for n in range(1, 100)
        ]
        assert recording.counts == {"hall/News/told": 100, "hall/Camera/seen": 100}


def test_what_is_written_can_be_saved_a_second_later(recorder: Recorder) -> None:
    track = recorder.track(told)
    track.put(news(1))
    wait_until(lambda: recorder.octets > 500)
    (file,) = recorder.folder.glob("*.mcap")
    assert b"hello" in file.read_bytes()


def test_payloads_of_other_codecs_are_recorded_as_cdr(recorder: Recorder) -> None:
    dictionary = Operation[Any]("House::Sizes", "told", (Field("sizes", Dictionary(STRING, INT32)),))
    values = ({"a": 1, "b": 2},)
    tracks, roomy = [], Cdr(40)
    for number, codec in enumerate((MessagePack(), roomy, Cdr(columns=True), Cdr())):
        track = recorder.track(Topic(f"x{number}/Sizes/told", dictionary), to_cdr(codec, dictionary.request))
        payload = codec.encoder(dictionary.request)(values)
        track.put(payload[: -len(TAIL)] if codec is roomy else payload)  # as publications are sent
        tracks.append(track)
    recorder.close()
    assert [(each.written, each.malformed) for each in tracks] == [(1, 0)] * 4
    with Recording(recorder.folder) as recording:
        assert [values_by_topic()(each) for each in recording.messages()] == [values] * 4


def test_messages_that_cannot_be_decoded_are_counted(recorder: Recorder) -> None:
    track = recorder.track(told, to_cdr(MessagePack(), NEWS.request))
    track.put([b"nonsense"])
    recorder.close()
    assert (track.written, track.malformed, recorder.error) == (0, 1, None)


def test_what_does_not_fit_into_the_queue_is_counted(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run", limit=4000) as recorder:
        held = recorder.track(seen, lambda payload: wait_until(lambda: big.dropped > 0) or payload)
        big = recorder.track(told)
        held.put(news(0))
        for number in range(100):
            big.put(news(number, "x" * 1000))
    assert 0 < big.dropped < 100
    assert big.dropped + big.written == 100
    assert (recorder.error, held.written) == (None, 1)


def test_a_recording_whose_folder_is_removed_ends_with_an_error(recorder: Recorder) -> None:
    track = recorder.track(told)
    track.put(news(1))
    wait_until(lambda: track.written == 1)
    shutil.rmtree(recorder.folder)
    wait_until(lambda: recorder.error is not None)
    assert "No such file" in str(recorder.error)
    track.put(news(2))
    assert track.dropped == 1


def test_a_full_disk_ends_the_recording_and_what_is_lost_is_counted(recorder: Recorder, tmp_path: Path) -> None:
    track = recorder.track(told)
    track.put(news(0))
    wait_until(lambda: recorder.octets > 500)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
        for number in range(1, 40):
            track.put(news(number, "x" * 100_000))
        wait_until(lambda: recorder.error is not None)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "File too large" in str(recorder.error)
    track.put(news(40))
    recorder.close()
    assert track.received == 41
    assert track.written + track.dropped == 41
    assert track.dropped > 0
    (saved,) = mend(recorder.folder, tmp_path / "whole", Options())
    assert numbers_in(tmp_path / "whole") == list(range(saved.messages))
    assert saved.messages > 0
