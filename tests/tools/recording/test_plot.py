"""`rc plot`: numbers of a recording over time, and latencies."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robocomp_py.cli import rc
from robocomp_py.contract.interface import Operation
from robocomp_py.contract.types import BOOL, FLOAT32, FLOAT64, INT32, STRING, Enumeration, Field, Sequence, Struct
from robocomp_py.tools.drawing import thinned
from robocomp_py.tools.recording.bag import PLAIN, BagWriter, RecordingError
from robocomp_py.tools.recording.layout import Topic
from robocomp_py.tools.recording.reader import Recording
from robocomp_py.tools.recording.series import curves, delays
from robocomp_py.wire.cdr import Cdr

from ..commands import complained, said

ECHO = Struct("House::Echo", (Field("angle", FLOAT32), Field("distance", FLOAT64)))
MODE = Enumeration("House::Mode", (("idle", 0), ("busy", 7)))
STATE = Struct(
    "House::State",
    (
        Field("name", STRING),
        Field("mode", MODE),
        Field("moving", BOOL),
        Field("nearest", ECHO),
        Field("echoes", Sequence(ECHO)),
        Field("volts", Sequence(FLOAT32)),
    ),
)
REPORT = Operation[Any]("House::ReportPub", "told", (Field("state", STATE),))
COUNT = Operation[Any]("House::CountPub", "counted", (Field("number", INT32), Field("text", STRING)))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Ten messages of two topics, 0.1 s apart; those of one tell when they were sent, 1 to 10 ms before."""
    writer = BagWriter(tmp_path / "run", PLAIN)
    told, counted = writer.add(Topic("hall/ReportPub/told", REPORT)), writer.add(Topic("hall/CountPub/counted", COUNT))
    state, number = Cdr().encoder(REPORT.request), Cdr().encoder(COUNT.request)
    for n in range(10):
        at = 10**18 + n * 10**8
        echoes = [(0.0, each * 100.0 + n) for each in range(n)]
        values = ("hall", 7 if n % 2 else 0, n > 4, (0.5, float(n)), echoes, np.array([n, 2 * n], np.float32))
        writer.write(told, state((values,)), at, at - (n + 1) * 10**6, n)
        writer.write(counted, number((n * n, "x")), at, at, n)
    writer.close()
    return tmp_path / "run"


def drawn(run: Path, *wanted: str) -> dict[str, list[float]]:
    with Recording(run) as recording:
        return {each.path: each.values.tolist() for group in curves(recording, wanted) for each in group}


@pytest.mark.parametrize("path", ["state.nearest.distance", "nearest.distance"])
def test_a_path_names_a_number(path: str, run: Path) -> None:
    assert drawn(run, f"hall/ReportPub.{path}") == {"state.nearest.distance": [float(n) for n in range(10)]}


def test_times_are_seconds_since_the_recording_began(run: Path) -> None:
    with Recording(run) as recording:
        ((curve,),) = curves(recording, ["CountPub.number"], recording.start + 5 * 10**8)
    assert curve.topic == "hall/CountPub/counted"
    assert curve.times.tolist() == pytest.approx([0.5, 0.6, 0.7, 0.8, 0.9])
    assert curve.values.tolist() == [25, 36, 49, 64, 81]


def test_a_topic_or_a_struct_stands_for_its_numbers(run: Path) -> None:
    every = ["state.mode", "state.moving", "state.nearest.angle", "state.nearest.distance"]
    assert list(drawn(run, "ReportPub")) == every
    assert list(drawn(run, "ReportPub.state.nearest")) == every[2:]
    assert drawn(run, "ReportPub.mode", "ReportPub.moving") == {
        "state.mode": [0, 7] * 5,
        "state.moving": [0] * 5 + [1] * 5,
    }


def test_each_word_and_each_topic_is_a_part_of_the_picture(run: Path) -> None:
    with Recording(run) as recording:
        found = curves(recording, ["hall", "ReportPub.nearest.angle"])
    assert [[each.path for each in group] for group in found] == [
        ["number"],
        ["state.mode", "state.moving", "state.nearest.angle", "state.nearest.distance"],
        ["state.nearest.angle"],
    ]


def test_items_of_sequences_are_drawn_with_gaps(run: Path) -> None:
    found = drawn(run, "ReportPub.echoes[2].distance", "ReportPub.volts[1]")
    assert found["state.volts[1]"] == [2.0 * n for n in range(10)]
    third = found["state.echoes[2].distance"]
    assert all(map(math.isnan, third[:3]))
    assert third[3:] == [200.0 + n for n in range(3, 10)]


@pytest.mark.parametrize(
    ("word", "why"),
    [
        ("Reports", "`Reports` is not in it; did you mean `ReportPub`?"),
        ("ReportPub.neerest", "unknown field `neerest`; did you mean `nearest`?"),
        ("ReportPub.a b", "`a b` is no path; write it as a.b, or a.b[0]"),
        ("ReportPub.name", "`state.name` is string, and only numbers are drawn"),
        ("ReportPub.name.first", "`state.name` is string, and has no fields"),
        ("ReportPub.nearest[0]", "`state.nearest` is House.Echo, and has no item 0"),
        ("ReportPub.echoes", "only numbers are drawn; write one of its numbers as state.echoes[0].angle"),
        ("ReportPub.echoes.distance", "`state.echoes` is a sequence; write state.echoes[0].distance"),
        (
            "ReportPub.volts",
            "`state.volts` is sequence<float32>, and only numbers are drawn; write one of its numbers as",
        ),
    ],
)
def test_what_is_no_number_is_told(word: str, why: str, run: Path) -> None:
    with Recording(run) as recording, pytest.raises(RecordingError, match=re.escape(why)):
        curves(recording, [word])


def test_delays_are_those_of_messages_that_tell_when_they_were_sent(run: Path) -> None:
    with Recording(run) as recording:
        found = delays(recording)
    assert found["hall/ReportPub/told"].tolist() == pytest.approx([n / 1000 for n in range(1, 11)])
    assert found["hall/CountPub/counted"].tolist() == []


@pytest.mark.parametrize(("ending", "begin"), [("svg", b"<?xml"), ("png", b"\x89PNG"), ("pdf", b"%PDF")])
def test_a_picture_is_written(ending: str, begin: bytes, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = run.parent / f"out.{ending}"
    shown = said(capsys, "plot", run, "CountPub", "ReportPub.nearest", "-o", picture)
    assert f"{picture}: hall/CountPub/counted number: 10 values, 0 to 81, mean 28.5\n" in shown
    content = picture.read_bytes()
    assert content.startswith(begin)
    if ending == "svg":
        text = content.decode()
        assert all(each in text for each in ("hall/CountPub/counted", "hall/ReportPub/told", "state.nearest.angle"))
        assert "seconds since 2001-09-09" in text
        said(capsys, "plot", run, "CountPub", "ReportPub.nearest", "-o", picture)
        assert picture.read_bytes() == content


def test_latencies_are_drawn_and_told(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = run.parent / "latency.svg"
    assert rc.main(["plot", str(run), "--latency", "--json", "-o", str(picture)]) == 0
    shown = capsys.readouterr()
    (told,) = map(json.loads, shown.out.splitlines())
    assert (told["topic"], told["messages"]) == ("hall/ReportPub/told", 10)
    assert [told[name] for name in ("p50_s", "p99_s", "longest_s")] == pytest.approx([0.005, 0.01, 0.01])
    assert "hall/CountPub/counted: no message tells when it was sent, so it is left out" in shown.err
    assert "hall/ReportPub/told: 10 messages, p50 5.00 ms, p99 10" in picture.read_text()


@pytest.mark.parametrize(
    ("arguments", "code", "why"),
    [
        (("CountPub", "-o", "out.jpg"), 2, "out.jpg: pictures are written as .svg, .png, .pdf; use one of these"),
        (
            ("-o", "out.svg"),
            2,
            "name the topics to draw, or use --latency; run has hall/CountPub/counted, hall/ReportPub/",
        ),
        (("CountPub", "-o", "no/out.svg"), 1, "no/out.svg: No such file or directory"),
        (("CountPub", "--latency", "-o", "out.svg"), 1, "run: it has no message that tells when it was sent"),
        (
            ("ReportPub.volts[2]", "-o", "out.svg"),
            1,
            "no message of hall/ReportPub/told has a number at `state.volts[2]`",
        ),
    ],
)
def test_what_is_wrong_is_told(
    arguments: tuple[str, ...],
    code: int,
    why: str,
    run: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(run.parent)
    assert why in complained(capsys, "plot", "run", *arguments, code=code)


def test_a_missing_matplotlib_is_told(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    why = "rc plot: plots need matplotlib: pip install 'robocomp-py[plot]'"
    assert why in complained(capsys, "plot", run, "CountPub", "-o", run.parent / "out.svg", code=2)


def test_long_curves_keep_their_peaks() -> None:
    times, values = np.arange(100_000.0), np.zeros(100_000)
    values[777], values[55_555], values[90_000:95_000] = 3.0, -2.0, np.nan
    some, found = thinned(times, values, most=1000)
    assert len(some) <= 1000
    assert (np.diff(some) > 0).all()
    assert (found[some == 777], found[some == 55_555]) == (3.0, -2.0)
    assert np.isnan(found).any()
