"""Recordings that end by a kill or on a full disk: what was written is read by us and by others."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from robocomp_py.testing.patience import wait_until
from robocomp_py.tools.recording.bag import Options
from robocomp_py.tools.recording.mend import mend
from robocomp_py.tools.recording.writer import Recorder
from tests.docs.pages import ROOT

from ..commands import complained, said
from .endless import SPLIT
from .recordings import filled, news, numbers_in, told


def numbers_of_rosbags(path: Path) -> list[int]:
    with AnyReader([path], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        return [reader.deserialize(raw, each.msgtype).number for each, _, raw in reader.messages()]


def killed(folder: Path, keep: int, octets: int) -> Path:
    """What a recorder has left that was killed when it had written so much."""
    command = [sys.executable, "-m", "tests.tools.recording.endless", str(folder), str(keep)]
    recorder = subprocess.Popen(command, cwd=ROOT)
    try:
        wait_until(lambda: written(folder) >= octets or recorder.poll() is not None)
        assert recorder.poll() is None
    finally:
        recorder.kill()
        recorder.wait()
    return folder


def written(folder: Path) -> int:
    """Octets of all files so far, those that are gone included, about."""
    files = list(folder.glob("*.mcap")) if folder.is_dir() else []
    newest = max((int(each.stem.rpartition("_")[2]) for each in files), default=0)
    return max(newest * SPLIT, sum(each.stat().st_size for each in files if each.exists()))


@pytest.mark.parametrize("keep", [0, 3])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_killed_recording_is_mended(keep: int, seed: int, tmp_path: Path) -> None:
    run = killed(tmp_path / "run", keep, random.Random(seed).randrange(100_000, 8_000_000))
    found = mend(run, tmp_path / "whole", Options())
    assert all(each.is_whole for each in found[:-1])
    assert sum(each.damaged for each in found) == 0
    numbers = numbers_in(tmp_path / "whole")
    assert numbers == list(range(numbers[0], numbers[0] + sum(each.messages for each in found)))
    assert keep or numbers[0] == 0
    assert numbers_of_rosbags(tmp_path / "whole") == numbers


@pytest.mark.parametrize("octets", [0, 3])
def test_a_recording_that_was_killed_while_a_file_began_is_mended(octets: int, tmp_path: Path) -> None:
    run = killed(tmp_path / "run", 0, 3_000_000)
    newest = max(run.glob("*.mcap"), key=lambda each: int(each.stem.rpartition("_")[2]))
    following = run / f"run_{int(newest.stem.rpartition('_')[2]) + 1}.mcap"
    following.write_bytes(newest.read_bytes()[:octets])
    *found, last = mend(run, tmp_path / "whole", Options())
    assert (last.path, last.messages, last.cut, last.is_whole) == (following, 0, octets, False)
    assert numbers_in(tmp_path / "whole") == list(range(sum(each.messages for each in found)))


def test_the_files_of_a_killed_ring_that_have_an_end_are_a_bag(tmp_path: Path) -> None:
    run = killed(tmp_path / "run", 2, 6_000_000)
    metadata = json.loads((run / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    files = metadata["relative_file_paths"]
    assert len(files) <= 2
    assert all((run / each).exists() for each in files)
    numbers = numbers_of_rosbags(run)
    assert numbers == list(range(numbers[0], numbers[0] + metadata["message_count"]))


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "disk"
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m,mode=0700", "tmpfs", str(folder)], check=True)
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


@pytest.mark.tool
@pytest.mark.parametrize("compress", ["none", "lz4"])
def test_a_full_disk_ends_a_recording_and_all_that_was_written_is_saved(
    compress: str, small_disk: Path, tmp_path: Path
) -> None:
    chance = random.Random(1)
    with Recorder(small_disk / "run", Options(compress)) as recorder:
        track = recorder.track(told)
        for number in range(100):
            track.put(news(number, chance.randbytes(50_000).hex()))
        wait_until(lambda: recorder.error is not None)
    assert "run_0.mcap: No space left on device" in str(recorder.error)
    assert track.written + track.dropped == 100
    (found,) = mend(small_disk / "run", tmp_path / "whole", Options())
    numbers = numbers_in(tmp_path / "whole")
    assert numbers == list(range(found.messages))
    assert 15 < found.messages < 100
    assert numbers_of_rosbags(tmp_path / "whole") == numbers


@pytest.mark.tool
def test_a_full_disk_keeps_the_earlier_files_of_a_recording(small_disk: Path) -> None:
    with Recorder(small_disk / "run", Options(split_octets=1_000_000)) as recorder:
        track = recorder.track(told)
        for number in range(100):
            track.put(news(number, "x" * 100_000))
        wait_until(lambda: recorder.error is not None)
    numbers = numbers_of_rosbags(small_disk / "run")
    assert len(numbers) >= 20
    assert numbers == list(range(len(numbers)))


@pytest.mark.tool
@pytest.mark.parametrize(
    "words", [("cut",), ("mend",), ("merge",), ("convert", "--to", "omgidl"), ("convert", "--to", "csv")]
)
def test_a_new_recording_that_does_not_fit_is_told(
    words: tuple[str, ...], small_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = filled(tmp_path / "run", Options(), 10, octets=1_000_000)
    told = complained(capsys, "bag", words[0], run, *words[1:], "-o", small_disk / "new")
    assert f"rc bag {words[0]}: {small_disk / 'new'}" in told
    assert "No space left on device" in told


def test_a_recording_may_grow_while_it_is_mended(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Recorder(tmp_path / "run") as recorder:
        track = recorder.track(told)
        for number in range(100):
            track.put(news(number, "x" * 50_000))
        wait_until(lambda: recorder.octets > 2_000_000)
        assert "it had no end" in said(capsys, "bag", "mend", tmp_path / "run", "-o", tmp_path / "whole")
    numbers = numbers_in(tmp_path / "whole")
    assert numbers == list(range(len(numbers)))
    assert len(numbers) > 20
    assert numbers_in(tmp_path / "run") == list(range(100))
