"""Calls and log records are recorded beside topics, and read by us and by others."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.access import Access
from robocomp_py.tools.census import take_census
from robocomp_py.tools.recording.bag import Options
from robocomp_py.tools.recording.reader import Recording, values_by_topic
from robocomp_py.tools.recording.session import Session
from robocomp_py.tools.recording.tellers import Tellers
from robocomp_py.tools.recording.writer import Recorder
from robocomp_py.transports.base import find_transport

from ...runtime.components import Calculator
from ...runtime.running import make, running
from ...runtime.test_telling import Asking
from ..commands import complained, said
from .recorded import calls_and_logs

CALLS, LOGS = "calculator/Everything/divide/calls", "rosout"


class Chatty(Asking):
    """Calls, and tells of it in its log."""

    def compute(self) -> None:
        super().compute()
        self.log.warning("asked again")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return calls_and_logs(tmp_path / "run", Options())


def test_calls_and_log_records_are_read_by_ros(run: Path) -> None:
    with AnyReader([run], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        found = [
            (each.topic, each.msgtype, reader.deserialize(raw, each.msgtype)) for each, _, raw in reader.messages()
        ]
    (_, kind, fine), (_, _, failed), (topic, log_kind, log) = found
    assert (kind, log_kind, topic) == ("conformance/msg/EverythingDivideCall", "rcl_interfaces/msg/Log", "/rosout")
    assert (fine.info.caller, fine.info.took, fine.info.status) == ("pupil", 0.25, "ok")
    assert [(each.dividend, each.divisor) for each in fine.request] == [(7, 2)]
    assert [(each.ret, each.remainder) for each in fine.response] == [(3, 1)]
    assert (failed.info.status, failed.info.error, failed.response) == ("timeout", "no answer", [])
    assert (log.stamp.nanosec, log.level, log.name, log.msg, log.line) == (5, 30, "desk/arm.driver", "hot", 3)


def test_calls_and_log_records_are_read_by_mcap(run: Path) -> None:
    (path,) = run.glob("*.mcap")
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        fine, failed, log = [each.decoded_message for each in reader.iter_decoded_messages()]
    assert (fine.request[0].dividend, fine.response[0].remainder, len(failed.response)) == (7, 1, 0)
    assert (log.name, log.msg) == ("desk/arm.driver", "hot")


def test_a_recording_of_calls_is_described_drawn_and_not_sent_again(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = said(capsys, "bag", "info", run)
    assert "conformance/msg/EverythingDivideCall" in told
    picture = tmp_path / "took.svg"
    told = said(capsys, "plot", run, "divide", "--latency", "--json", "-o", picture)
    assert json.loads(told) == {"topic": CALLS, "messages": 2, "p50_s": 0.25, "p99_s": 0.75, "longest_s": 0.75}
    told = said(capsys, "plot", run, "calls.info.took", "-o", tmp_path / "line.svg")
    assert "calls info.took: 2 values, 0.25 to 0.75, mean 0.5" in told
    told = complained(capsys, "replay", run)
    assert f"{CALLS} is left out: calls are not made again; --answer serves queries" in told
    assert f"{LOGS} is left out: log records are not sent again" in told


@pytest.fixture(params=["shm", "zeromq"])
def pair(request: pytest.FixtureRequest) -> Iterator[str]:
    """The middleware of a client and a server."""
    over = f"middleware={request.param}"
    with (
        running(make(Calculator, find_transport, over)),
        running(make(Chatty, find_transport, over, "ports.everything.from=calculator", name="pupil")),
    ):
        yield request.param


def recorded(folder: Path, over: str, wanted: list[str], **what: bool) -> tuple[dict[str, list[Any]], list[str]]:
    """What a recording of calls and logs holds once each of its topics has some, and what was said."""
    told: list[str] = []
    with Recorder(folder) as recorder, Access() as access:
        tellers = Tellers(recorder, access, wanted, told.append, **{"calls": False, "logs": False, **what})
        session = Session(recorder, access, lambda: take_census([over]), ["none/such"], told.append, tellers.look)
        try:
            wait_until(lambda: session.look() or _is_enough(tellers, what), 6 * SOON)
        finally:
            tellers.close()
    assert not any(each.unreadable or each.unknown for each in tellers.all)
    with Recording(folder) as recording:
        values = values_by_topic()
        found: dict[str, list[Any]] = {name: [] for name in recording.topics}
        for each in recording.messages():
            found[each.topic.name].append(values(each))
    return found, told


def _is_enough(tellers: Tellers, what: dict[str, bool]) -> bool:
    written = [track.written for _, track in tellers.tracks]
    return len(written) >= sum(what[each] for each in ("calls", "logs") if each in what) and min(written) >= 4


def test_what_components_call_and_log_is_recorded(pair: str, tmp_path: Path) -> None:
    found, told = recorded(tmp_path / "run", pair, ["divide"], calls=True, logs=True)
    assert set(found) == {CALLS, LOGS}
    infos = [info for info, _, _ in found[CALLS]]
    assert {(caller, middleware, status) for caller, middleware, _, _, status, _ in infos} == {
        ("pupil", pair, "ok"),
        ("pupil", pair, "thrown"),
    }
    fine = [call for call in found[CALLS] if call[0][4] == "ok"]
    assert ([(7, 2)], [(3, 1)]) in [(request, response) for _, request, response in fine]
    assert ("pupil", 30, "asked again") in [(name, level, text) for _, level, name, text, *_ in found[LOGS]]
    assert f"calls of pupil over {pair}" in told


def test_servers_tell_if_they_are_asked(pair: str, tmp_path: Path) -> None:
    found, _ = recorded(tmp_path / "run", pair, ["divide"], calls=True, served=True)
    assert {info[0] for info, _, _ in found[CALLS]} == {"calculator"}


def test_wrong_options_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert complained(capsys, "record", "--served", code=2) == "rc record: --served is for --calls\n"
    folder = tmp_path / "run"
    told = complained(capsys, "record", "elephant", "--calls", "--logs", "--timeout", "0.1", "-o", folder)
    assert "nothing publishes `elephant`, and no component reports calls or log records" in told
