"""Recordings are published again: to components that run, over every middleware that can tell."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli import rc
from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Interface, Operation, Pattern, Verb
from robocomp_py.contract.types import INT64, Field
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.census import take_census
from robocomp_py.tools.recording.bag import BagWriter
from robocomp_py.tools.recording.layout import Topic
from robocomp_py.transports.base import find_transport
from robocomp_py.wire.cdr import Cdr

from ...runtime.components import RELIABLE, Calculator, Diary
from ...runtime.running import make, running
from ..commands import TELLERS
from ..recording.test_bad_files import foreign
from ..talkers import Talker
from .recorded import CHANNEL, NEWS, complained, recorded, said


class Listener(Diary):
    component = Component("listener", (Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=RELIABLE),), period=0.005)

    def Everything_news(self, number: int, text: str) -> None:
        self.entries.append(f"{number} {text}")

    @property
    def heard(self) -> list[str]:
        return [each for each in self.entries if each[0].isdecimal()]


class Poked(Calculator):
    component = Component("poked", (Port(Verb.IMPLEMENTS, e.EVERYTHING),), period=0.005)

    def Everything_poke(self, number: int) -> None:
        self.entries.append(f"poked {number}")


def listening(middleware: str, instance: str = "talker", own: str = "listener") -> Any:
    """A component that hears the topics of an instance."""
    made = make(Listener, find_transport, f"middleware={middleware}", f"ports.Everything.from={instance}", name=own)
    return running(made)


@pytest.fixture(params=TELLERS)
def listener(request: pytest.FixtureRequest) -> Iterator[Any]:
    with listening(request.param) as worker:
        wait_until(lambda: any(each.role == "subscribes" for each in take_census([request.param]).ends))
        worker.middleware_used = request.param
        yield worker


AGAIN = [f"{number} again" for number in range(20)]


def test_a_recording_is_published_again(listener: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = json.loads(said(capsys, recorded(tmp_path / "run"), "--json"))
    wait_until(lambda: listener.heard == AGAIN)
    (topic,) = told["topics"]
    assert topic == {
        "channel": CHANNEL,
        "recorded_as": CHANNEL,
        "messages": 20,
        "middlewares": [listener.middleware_used],
        "failed": 0,
        "malformed": 0,
    }
    assert 0 <= told["late"]["median"] <= told["late"]["p99"] <= told["late"]["longest"]


def test_subscribers_of_any_instance_hear_it_if_the_middleware_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """DDS does not tell of them before something publishes."""
    with running(make(Listener, find_transport, "middleware=dds", name="listener")) as worker:
        said(capsys, recorded(tmp_path / "run"), "--middleware", "dds")
        wait_until(lambda: worker.heard == AGAIN)


@pytest.mark.parametrize("listener", ["zeromq"], indirect=True)
def test_a_part_is_published_at_another_rate(listener: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = recorded(tmp_path / "run")
    told = said(capsys, run, "--start", 0.05, "--for", 0.1, "--rate", 0.5, "--only", "news")
    wait_until(lambda: listener.heard == AGAIN[5:15])
    seconds = re.search(r"run: 10 messages in (\d+\.\d) s, late by .* ms \(99 % within .* ms, at most .* ms\)\n", told)
    assert seconds
    assert float(seconds[1]) >= 0.1
    assert f"  {CHANNEL}: 10 messages over zeromq\n" in told


def test_every_middleware_by_which_something_subscribes_gets_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with listening("shm", own="near") as near, listening("zenoh", own="far") as far:
        wait_until(lambda: len([each for each in take_census().ends if each.role == "subscribes"]) == 2)
        told = json.loads(said(capsys, recorded(tmp_path / "run"), "--json"))
        assert set(told["topics"][0]["middlewares"]) == {"shm", "zenoh"}
        for each in (near, far):
            wait_until(lambda each=each: each.heard == AGAIN)  # type: ignore[misc]
        said(capsys, tmp_path / "run", "--middleware", "shm")
        wait_until(lambda: near.entries.count("19 again") == 2)
        assert far.entries.count("0 again") == 1


def test_names_are_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with listening("shm", "ghost") as worker:
        wait_until(lambda: any(each.role == "subscribes" for each in take_census(["shm"]).ends))
        said(capsys, recorded(tmp_path / "run"), "--remap", "talker=ghost")
        wait_until(lambda: worker.heard == AGAIN)


def test_an_operation_that_was_renamed_hears_what_was_recorded_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    class Renamed(Diary):
        component = Component(
            "renamed",
            (Port(Verb.SUBSCRIBES, Interface(e.EVERYTHING.name, (replace(e.news, name="olds"),)), qos=RELIABLE),),
        )

        def Everything_olds(self, number: int, text: str) -> None:
            self.entries.append(f"{number} {text}")

    with running(make(Renamed, find_transport, "middleware=shm", "ports.Everything.from=talker")) as worker:
        wait_until(lambda: any(each.role == "subscribes" for each in take_census(["shm"]).ends))
        said(capsys, recorded(tmp_path / "run"), "--remap", "news=olds")
        wait_until(lambda: [each for each in worker.entries if each.endswith(" again")] == AGAIN)


def test_a_subscriber_that_appears_later_hears_the_rest(tmp_path: Path) -> None:
    """It is replayed over and over, until it is interrupted."""
    command = [sys.executable, "-m", "robocomp_py.cli.rc", "replay", str(recorded(tmp_path / "run")), "--loop"]
    with listening("shm") as worker:
        replay = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            wait_until(lambda: worker.entries.count("19 again") >= 2)
            with listening("zeromq", own="late") as late:
                wait_until(lambda: "3 again" in late.entries)
        finally:
            replay.send_signal(signal.SIGINT)
            out, _ = replay.communicate(timeout=3 * SOON)
    assert replay.returncode == 130
    assert re.search(r"news: \d+ messages over shm, zeromq\n", out)


def test_commands_are_sent_only_if_they_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = recorded(tmp_path / "run")
    with running(make(Poked, find_transport, "middleware=shm", name="poked")) as worker, listening("shm"):
        wait_until(lambda: any(each.role == "subscribes" for each in take_census(["shm"]).ends))
        assert rc.main(["replay", str(run)]) == 0
        why = "commands may move a robot; replay them with `--only poked/Everything/poke`"
        assert f"poked/Everything/poke is left out: {why}" in capsys.readouterr().err
        assert not [each for each in worker.entries if each.startswith("poked")]
        said(capsys, run, "--only", "poke")
        wait_until(
            lambda: [each for each in worker.entries if each.startswith("poked")] == [f"poked {n}" for n in range(20)]
        )


def test_a_live_publisher_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = recorded(tmp_path / "run", 2)
    with running(make(Talker, find_transport, "middleware=shm", name="talker")), listening("shm") as worker:
        wait_until(lambda: any(each.role == "subscribes" for each in take_census(["shm"]).ends))
        told = complained(capsys, run)
        assert f"{CHANNEL} is published by talker (process {os.getpid()}) now; stop it, publish under another" in told
        said(capsys, run, "--beside")
        wait_until(lambda: "1 again" in worker.entries)


def test_a_subscriber_with_another_contract_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old: Operation[Any] = Operation(e.NAME, "news", (Field("number", INT64),), (), (), Pattern.PUBLISH)
    writer = BagWriter(tmp_path / "run")
    writer.write(writer.add(Topic(CHANNEL, old)), bytes(Cdr().encoder(old.request)((1,))), 1, 1, 1)
    writer.close()
    with listening("shm"):
        wait_until(lambda: any(each.role == "subscribes" for each in take_census(["shm"]).ends))
        told = complained(capsys, tmp_path / "run", "--timeout", "0.1")
    assert f"listener (process {os.getpid()}) hears {CHANNEL} with another contract than the recorded one: " in told


def test_keys_pause_it_and_send_single_messages(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "robocomp_py.cli.rc", "replay", str(recorded(tmp_path / "run", 10)), "--paused"]
    with listening("shm") as worker:
        ours, its = pty.openpty()
        replay = subprocess.Popen(command, stdin=its, stdout=subprocess.PIPE, stderr=its, text=True)
        os.close(its)
        try:
            wait_until(lambda: b"paused" in os.read(ours, 1000))
            os.write(ours, b"s")
            wait_until(lambda: "0 again" in worker.entries)
            os.write(ours, b"s")
            wait_until(lambda: "1 again" in worker.entries)
            assert "2 again" not in worker.entries
            os.write(ours, b"+ ")
            wait_until(lambda: "9 again" in worker.entries)
            out, _ = replay.communicate(timeout=SOON)
        finally:
            replay.kill()
            replay.communicate()
            os.close(ours)
    assert replay.returncode == 0
    assert re.match(r".*run: 10 messages in ", out)


@pytest.mark.parametrize(
    ("arguments", "code", "why"),
    [
        (("--timeout", "0.1"), 1, f"nothing subscribes to {CHANNEL}; `rc list --channels` shows all"),
        (("--only", "nws"), 1, "`nws` is not in it; did you mean `news`?"),
        (("--remap", "talker"), 2, "--remap talker: write OLD=NEW, as in `world=ghost`"),
        (("--remap", "elephant=ghost"), 1, "`elephant` is not in it"),
        (("--remap", "talker=9"), 2, "--remap talker=9: write OLD=NEW"),
        (("--remap", f"{CHANNEL}=news"), 2, "--remap makes `news` of"),
        (("--start", "60"), 1, "run: it has no messages there; it takes 0.2 s"),
        (("--middleware", "zeromy"), 2, "did you mean `zeromq`"),
    ],
)
def test_what_is_wrong_is_told(
    arguments: tuple[str, ...], code: int, why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert why in complained(capsys, recorded(tmp_path / "run"), *arguments, code=code)


def test_a_pause_needs_a_terminal(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "robocomp_py.cli.rc", "replay", str(recorded(tmp_path / "run")), "--paused"]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, "rc replay: --paused needs a terminal, since a key ends the pause\n")


def test_files_of_others_and_broken_files_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "nowhere: no such file or folder" in complained(capsys, tmp_path / "nowhere")
    path = foreign(tmp_path / "b.mcap", "protobuf", {})
    told = complained(capsys, path)
    assert "b is left out: its messages are protobuf, not cdr" in told
    assert f"{path}: it has nothing to replay" in told
    (tmp_path / "c.mcap").write_bytes(path.read_bytes()[:-10])
    assert "it is still being written, or was interrupted; `rc bag mend`" in complained(capsys, tmp_path / "c.mcap")


@pytest.mark.parametrize("listener", ["shm"], indirect=True)
def test_a_file_that_is_damaged_in_its_middle_is_told_after_what_is_before(
    listener: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    writer = BagWriter(tmp_path / "run")
    news = writer.add(Topic(CHANNEL, NEWS, qos=RELIABLE))
    for number in range(20):
        writer.write(news, bytes(Cdr().encoder(NEWS.request)((number, "x" * 300_000))), number, number, number + 1)
    writer.close()
    path = tmp_path / "run" / "run_0.mcap"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    assert "run_0.mcap: it is damaged" in complained(capsys, tmp_path / "run", "--only", "news")
    wait_until(lambda: any(each.startswith("5 x") for each in listener.entries))
    assert not any(each.startswith("19 x") for each in listener.entries)


@pytest.mark.parametrize("listener", ["shm"], indirect=True)
def test_a_message_that_does_not_fit_its_contract_is_left_out(
    listener: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    writer = BagWriter(tmp_path / "run")
    news = writer.add(Topic(CHANNEL, NEWS))
    for number, data in enumerate([b"\0\1\0\0", bytes(Cdr().encoder(NEWS.request)((1, "whole")))]):
        writer.write(news, data, number, number, number + 1)
    writer.close()
    told = said(capsys, tmp_path / "run")
    wait_until(lambda: "1 whole" in listener.entries)
    assert f"{CHANNEL}: 1 message over shm; 1 do not fit their contract\n" in told
