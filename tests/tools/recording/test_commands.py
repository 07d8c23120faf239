"""`rc record` and `rc bag`, against components that run."""

from __future__ import annotations

import csv
import itertools
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from robocomp_py.cli import rc
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.access import Access
from robocomp_py.tools.census import take_census
from robocomp_py.tools.network import Network
from robocomp_py.tools.recording.bag import Options
from robocomp_py.tools.recording.edit import Once
from robocomp_py.tools.recording.layout import Topic
from robocomp_py.tools.recording.reader import Recording, values_by_topic
from robocomp_py.tools.recording.session import Session, Track
from robocomp_py.tools.recording.writer import Convert, Recorder
from robocomp_py.transports.base import find_transport

from ...runtime.running import make, running
from ..commands import TELLERS, complained, said
from ..talkers import Talker
from .recordings import filled, numbers_in

CHANNEL = "talker/Everything/news"


@pytest.fixture(params=TELLERS)
def talker(request: pytest.FixtureRequest) -> Iterator[str]:
    """Something that publishes, and the middleware over which it does."""
    with running(make(Talker, find_transport, f"middleware={request.param}", name="talker")):
        wait_until(lambda: CHANNEL in take_census([request.param]).channels)
        yield request.param


def test_a_topic_is_recorded_and_read_by_us_and_by_ros(
    talker: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number, seconds in enumerate((0.7, 2.8, 11.2)):  # on a busy machine, nothing may come in a short time
        run = tmp_path / f"run{number}"
        told = json.loads(said(capsys, "record", "news", "--for", seconds, "-o", run, "--json"))
        (topic,) = told["topics"]
        if topic["messages"]:
            break
    assert (topic["channel"], topic["unreadable"]) == (CHANNEL, 0)
    with Recording(run) as recording:
        messages = list(recording.messages())
        values = [values_by_topic()(each) for each in messages]
        assert recording.topics[CHANNEL].publisher == "talker"
        assert recording.topics[CHANNEL].middleware == talker
    assert len(messages) == topic["messages"] > 0
    sequences = [each.sequence for each in messages]
    assert sequences == sorted(set(sequences))
    assert values == [(values[0][0] + each - sequences[0], "hello") for each in sequences]
    missing = sequences[-1] + 1 - sequences[0] - len(messages)  # none, unless the machine is very busy
    assert topic["lost"] + topic["dropped"] >= missing
    assert all(0 <= each.log_time - each.publish_time < 60e9 for each in messages)
    with AnyReader([run], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        found = [reader.deserialize(raw, each.msgtype).number for each, _, raw in reader.messages()]
    assert found == [number for number, _ in values]


def test_a_topic_that_appears_later_is_recorded(tmp_path: Path) -> None:
    told: list[str] = []
    with Recorder(tmp_path / "run") as recorder, Access() as access:
        session = Session(recorder, access, lambda: take_census(["shm"]), ["news"], told.append)
        session.look()
        assert session.followed == []
        with running(make(Talker, find_transport, "middleware=shm", name="talker")):
            wait_until(lambda: session.look() or any(each.track.written for each in session.followed))
    assert told == [f"{CHANNEL} over shm"]
    assert numbers_in(tmp_path / "run")


def test_a_recording_without_topics_ends_and_leaves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = complained(capsys, "record", "elephant", "--timeout", "0.1", "-o", tmp_path / "run")
    assert "rc record: nothing publishes `elephant`; `rc list --topics` shows all topics" in told
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("talker", ["shm"], indirect=True)
def test_a_misspelt_topic_is_told_with_what_was_meant(
    talker: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = complained(capsys, "record", "nws", "--timeout", "0.1", "-o", tmp_path / "run")
    assert "rc record: nothing publishes `nws`; did you mean `news`?" in told


@pytest.mark.parametrize("talker", ["shm"], indirect=True)
def test_a_misspelt_topic_beside_a_right_one_is_told_once(
    talker: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rc.main(["record", CHANNEL, "nws", "elephant", "--for", "0.5", "-o", str(tmp_path / "run")]) == 0
    told = capsys.readouterr().err
    assert told.count("rc record: nothing publishes `nws` so far; did you mean `news`?") == 1
    assert "elephant" not in told


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
@pytest.mark.parametrize("talker", ["shm"], indirect=True)
def test_what_an_ended_recorder_has_written_is_there(
    number: signal.Signals, talker: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [sys.executable, "-m", "robocomp_py.cli.rc", "record", "-o", str(tmp_path / "run")]
    file = tmp_path / "run" / "run_0.mcap"
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as recorder:
        try:
            wait_until(lambda: file.exists() and file.stat().st_size > 1500, SOON * 3)
            recorder.send_signal(number)
            out, _ = recorder.communicate(timeout=SOON * 3)
        finally:
            recorder.kill()
    if number == signal.SIGINT:
        assert recorder.returncode == 130
        assert re.search(r"run: [1-9]\d* messages of 1 topic", out)
        assert numbers_in(tmp_path / "run")
        return
    assert "`rc bag mend` makes a readable copy" in complained(capsys, "bag", "info", tmp_path / "run")
    assert "messages saved; it had no end" in said(capsys, "bag", "mend", tmp_path / "run", "-o", tmp_path / "whole")
    numbers = numbers_in(tmp_path / "whole")
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


@pytest.mark.parametrize(
    ("arguments", "code", "why"),
    [
        (("record", "--keep", "3"), 2, "--keep needs --split, as in `--split 1GB --keep 10`"),
        (("record", "-o", "."), 2, "is there already; choose another folder with -o"),
        (("bag", "info", "nowhere"), 1, "nowhere: no such file or folder"),
        (("bag", "info", "rum"), 1, "rum: no such file or folder; did you mean `run`?"),
        (("bag", "cut", "run", "-o", "part", "--only", "nws"), 1, "`nws` is not in it; did you mean `News`?"),
        (("bag", "cut", "run", "-o", "run"), 2, "run is there already; choose another folder with -o"),
        (("bag", "merge", "run", "nowhere", "-o", "both"), 1, "nowhere: no such file or folder"),
    ],
)
def test_what_is_wrong_is_told(
    arguments: tuple[str, ...],
    code: int,
    why: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    filled(tmp_path / "run", Options(), 2)
    assert why in complained(capsys, *arguments, code=code)


@pytest.mark.parametrize("text", ["1", "GB", "0s", "1TB", "-1GB", "1e3s"])
def test_a_wrong_size_is_usage(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        rc.main(["record", f"--split={text}"])
    assert ended.value.code == 2
    assert "is neither a size nor a time" in capsys.readouterr().err


# Of recordings that are there.


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Six messages, a second apart."""
    return filled(tmp_path / "run", Options(), 6)


def test_a_recording_is_described(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shown = said(capsys, "bag", "info", run)
    assert re.search(r"run: 1 file, .* kB, 6 messages, 5.0 s", shown)
    assert re.search(r"hall/News/told +6 +1.0 Hz +house/msg/NewsTold +hall +shm", shown)
    described = json.loads(said(capsys, "bag", "info", run, "--json"))
    assert (described["start"], described["end"], described["topics"][0]["messages"]) == (0, 5 * 10**9, 6)


def test_a_part_is_cut_out(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cut = ("--start", 2, "--for", 3, "--only", "News", "--compress", "zstd")
    told = json.loads(said(capsys, "bag", "cut", run, "-o", tmp_path / "part", *cut, "--json"))
    assert (told["folder"], told["messages"] > 0) == (str(tmp_path / "part"), True)
    assert numbers_in(tmp_path / "part") == [2, 3, 4]


def test_a_part_without_messages_is_told(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = complained(capsys, "bag", "cut", run, "-o", tmp_path / "part", "--start", 100)
    assert told.endswith("part has no messages: none was in this part of the recording\n")


def test_recordings_are_merged_in_the_order_of_their_times_without_what_both_have(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, cut in (("early", ("--for", 4)), ("late", ("--start", 3))):
        said(capsys, "bag", "cut", run, "-o", tmp_path / name, *cut)
    told = complained(capsys, "bag", "merge", tmp_path / "late", tmp_path / "early", "-o", tmp_path / "both", code=0)
    assert numbers_in(tmp_path / "both") == [0, 1, 2, 3, 4, 5]
    assert told == "rc bag merge: 1 message of several recordings written once\n"


def test_messages_of_the_same_time_and_number_with_other_data_are_not_one(tmp_path: Path) -> None:
    """Two runs in simulated time may have such messages."""
    with Recording(filled(tmp_path / "run", Options(), 3)) as recording:
        one = list(recording.messages())
    other = [each._replace(data=each.data[:-1] + b"?") for each in one]
    once = Once()
    new = [[once.is_new(each, number) for each in messages] for number, messages in enumerate((one, other, one))]
    assert new == [[True] * 3, [True] * 3, [False] * 3]
    assert once.repeated == 3


def test_names_of_types_are_converted(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said(capsys, "bag", "convert", run, "--to", "omgidl", "-o", tmp_path / "named")
    with Recording(tmp_path / "named") as recording:
        (topic,) = recording.topics.values()
    assert (topic.type, topic.schema_encoding) == ("House::NewsTold", "omgidl")
    said(capsys, "bag", "convert", tmp_path / "named", "--to", "ros2msg", "-o", tmp_path / "back")
    assert numbers_in(tmp_path / "back") == list(range(6))


def test_a_full_disk_is_told_with_the_folder_of_the_tables(run: Path, tmp_path: Path) -> None:
    """What is left is written when the files are closed."""
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100)); "
    command = ["bag", "convert", str(run), "--to", "csv", "-o", str(tmp_path / "tables")]
    code = f"{limit}from robocomp_py.cli import rc; raise SystemExit(rc.main({command!r}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (1, f"rc bag convert: {tmp_path}/tables: File too large\n")


def test_a_table_is_written(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said(capsys, "bag", "convert", run, "--to", "csv", "-o", tmp_path / "tables")
    with open(tmp_path / "tables" / "hall.News.told.csv", newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["log_time", "publish_time", "sequence", "number", "text"]
    assert rows[3] == ["2000000000", "1999999995", "3", "2", "hello"]
    assert len(rows) == 7


def test_the_first_topic_is_looked_for_often_however_long_a_look_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first look imports what a middleware needs, and may come before others have told of their topics."""
    looks: list[int] = []

    def census() -> Network:
        looks.append(1)
        return Network(())

    monkeypatch.setattr(time, "thread_time", itertools.count(step=1000).__next__)
    with Access() as access:
        session = Session(Untouched(), access, census, ("news",), print)
        wait_until(lambda: bool(session.look() or len(looks) > 1))


class Untouched:
    def track(self, topic: Topic, convert: Convert) -> Track:
        raise AssertionError("there is no topic")
