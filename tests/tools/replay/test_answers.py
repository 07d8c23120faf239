"""Queries of a recording are served with the responses that were recorded."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli import rc
from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Pattern, Verb
from robocomp_py.errors import RemoteFailure, RobocompError
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.access import Access
from robocomp_py.tools.census import take_census
from robocomp_py.tools.recording.bag import Options
from robocomp_py.tools.recording.calls import calls_topic, info_octets, joined
from robocomp_py.tools.recording.reader import Recording
from robocomp_py.tools.recording.writer import Recorder
from robocomp_py.tools.replay.answers import Answers, answers_of
from robocomp_py.transports.base import find_transport
from robocomp_py.wire.cdr import Cdr

from ...runtime.components import Calculator, Diary, EverythingProxy
from ...runtime.running import make, running
from .recorded import complained, recorded

CHANNEL = "calculator/Everything/divide"


class Pupil(Diary):
    """Asks all the time, and notes each answer that is new."""

    component = Component("pupil", (Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),), period=0.005)
    everything_proxy: EverythingProxy
    answers: tuple[Any, ...] = ()
    reason = ""

    def compute(self) -> None:
        try:
            answer = self.everything_proxy.divide(1, 1)
            self.everything_proxy.poke(1)
        except RobocompError:
            return  # the replay has ended
        try:
            self.everything_proxy.work("unrecorded")
        except RemoteFailure as exc:
            self.reason = exc.reason
        if answer not in self.answers:
            self.answers = (*self.answers, answer)


def answered(folder: Path, *responses: tuple[int, int] | None) -> Path:
    """A recording of calls, a second apart; None is a call that failed. And of a command."""
    encode, clock = Cdr().encoder, iter(range(10**18, 2 * 10**18, 10**9))
    with Recorder(folder, Options(), now=lambda: next(clock)) as recorder:
        divide = calls_topic(CHANNEL, e.divide, Pattern.QUERY, "calculator", "shm")
        track = recorder.track(divide, joined(e.divide))
        for each in responses:
            info = info_octets("pupil", "shm", 1, 0.1, "ok" if each else "timeout", "")
            response = encode(e.divide.response)(each) if each else b""
            track.put([info, encode(e.divide.request)((7, 2)), response])
        poke = calls_topic("calculator/Everything/poke", e.poke, Pattern.COMMAND, "calculator", "shm")
        info = info_octets("pupil", "shm", 1, 0.1, "ok", "")
        recorder.track(poke, joined(e.poke)).put([info, encode(e.poke.request)((3,)), b""])
    assert recorder.error is None
    return folder


def asking(over: str, whom: str = "calculator", name: str = "pupil") -> Any:
    made = make(Pupil, find_transport, f"middleware={over}", f"ports.everything.from={whom}", name=name)
    return running(made, ready=False)


@pytest.mark.parametrize("over", ["shm", "zeromq"])
def test_a_client_gets_the_newest_response_that_was_recorded(over: str, tmp_path: Path) -> None:
    told: list[str] = []
    with Recording(answered(tmp_path / "run", (3, 1), None, (4, 0))) as recording, asking(over) as worker:
        (answer,) = answers_of(recording, [], [])
        with Access() as access:
            answers = Answers(access, [answer], told.append)
            answers.begin(recording, recording.start, None)
            wait_until(lambda: answers.look(take_census([over])) and worker.answers == ((3, 1),), 6 * SOON)
            for each in recording.messages([answer.topic.name]):
                assert answers.note(each.topic.name, each.data)
            wait_until(lambda: worker.answers == ((3, 1), (4, 0)), 6 * SOON)
    assert worker.reason == "the recording has no response"  # of `work`
    assert (list(answer.ways), told) == ([over], [])
    assert answer.answered >= 2


def test_an_interface_that_is_called_and_was_not_recorded_is_told_once(tmp_path: Path) -> None:
    told: list[str] = []
    with (
        Recording(answered(tmp_path / "run", (3, 1))) as recording,
        asking("shm"),
        asking("shm", "absent", "lost"),
        Access() as access,
    ):
        answers = Answers(access, answers_of(recording, [], []), told.append)
        answers.begin(recording, recording.start, None)
        wait_until(lambda: answers.look(take_census(["shm"])) and told, 6 * SOON)
        answers.look(take_census(["shm"]))
    assert told == ["absent/Everything is not served: lost calls it, and no query of it was recorded"]


def test_a_replay_answers_queries_and_no_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = answered(tmp_path / "run", (3, 1), (4, 0))
    with asking("shm"):
        assert rc.main(["replay", str(run), "--answer", "--json", "--timeout", "60"]) == 0
    out, err = capsys.readouterr()
    (query,) = json.loads(out)["queries"]
    assert (query["channel"], query["middlewares"]) == (CHANNEL, ["shm"])
    assert "poke/calls is left out: calls are not made again" in err


def test_a_server_that_runs_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = answered(tmp_path / "run", (3, 1))
    with running(make(Calculator, find_transport, "middleware=shm")):
        told = complained(capsys, run, "--answer", "--middleware", "shm")
    assert f"{CHANNEL} is served by calculator (process " in told
    assert "stop it, or leave it out by --only or --remap" in told


def test_what_cannot_be_answered_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = complained(capsys, recorded(tmp_path / "topics"), "--answer")
    assert "it has no queries; `rc record --calls` records them" in told
    run = answered(tmp_path / "run", (3, 1))
    assert "its queries are left out by --only" in complained(capsys, run, "--answer", "--only", "poke")
    assert f"nothing calls {CHANNEL}" in complained(capsys, run, "--answer", "--timeout", "0.1")
