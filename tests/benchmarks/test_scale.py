"""What a growing network costs is measured, beside the bare library. How much it is, is not judged here."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from benchmarks.query import Row
from benchmarks.rounds import Times
from benchmarks.scale import charts, scale
from benchmarks.scale.arrivals import Arrivals
from benchmarks.scale.clients import Clients, fairness
from benchmarks.scale.crowd import Control, Member, together
from benchmarks.scale.fanout import Fanout
from benchmarks.scale.idle import Idle
from benchmarks.scale.mixed import Mixed
from benchmarks.tables import as_text

from .test_benchmarks import LONG, run

ROWS: list[Any] = [
    *(Idle("zeromq", party, number, 30.0 + number, number, 0.01) for number in (1, 256) for party in ("ours", "raw")),
    *(
        Clients("zeromq", party, number, 1000.0 / factor, 100.0 * number * factor, 0.95)
        for number in (2, 32)
        for party, factor in (("ours", 1.5), ("raw", 1))
    ),
    *(
        Mixed("zeromq", party, number, 200.0, 200.0 * ratio, ratio)
        for number in (1, 4)
        for party, ratio in (("ours", 1.5 * number), ("raw", 1.2))
    ),
    *(
        Fanout("zeromq", party, number, size, 1.0 * factor, 2.0, 300.0)
        for size in (1024, 1_000_000)
        for number in (1, 16)
        for party, factor in (("ours", 1.4), ("raw", 1))
    ),
    *(Arrivals("zeromq", number, waits, 100, 90, 4, 5) for number in (16, 256) for waits in (False, True)),
    *(Row("zeromq", size, Times(60.0, 90.0), Times(50.0, 80.0), 1.2, 10.0) for size in (64, 1024)),
]


@LONG
def test_every_part_is_measured_beside_the_bare_library(tmp_path: Path) -> None:
    out, found = run(tmp_path, "--what", "scale", "--only", "zeromq")
    rows = found["scale"]
    for part, numbers in (("idle", (1, 16)), ("clients", (1, 2)), ("mixed", (1, 4))):
        assert sorted((row["number"], row["party"]) for row in rows if row.get("part") == part) == [
            (number, party) for number in numbers for party in ("ours", "raw")
        ]
    assert {(row["size"], row["number"], row["party"]) for row in rows if row.get("part") == "fanout"} == {
        (size, number, party) for size in (1024, 1_000_000) for number in (1, 4) for party in ("ours", "raw")
    }
    arrived = [row for row in rows if row.get("part") == "arrivals"]
    assert [(row["number"], row["waits"]) for row in arrived] == [
        (n, waits) for n in (16, 64) for waits in (False, True)
    ]
    assert all(row["sent"] == row["heard"] for row in arrived if row["waits"])
    assert [row["size"] for row in rows if "ratio" in row] == [64, 1024]
    assert "Jain's index" in out


def test_fairness_is_one_if_all_have_as_much() -> None:
    assert fairness([7, 7, 7]) == pytest.approx(1.0)
    assert fairness([9, 0, 0]) == pytest.approx(1 / 3)
    assert fairness([0, 0]) == 0.0


def test_ours_and_the_bare_library_are_in_one_row_and_what_was_not_measured_is_a_dash() -> None:
    idle, clients, mixed, fanout, sizes, arrivals = scale.tables([*ROWS, Idle("shm", "ours", 1, 35.0, 13, 0.02)])
    assert idle.rows[0] == ("zeromq", "1", "31.0 MB", "31.0 MB", "1", "1", "0.01 s", "0.01 s")
    assert idle.rows[-1] == ("shm", "1", "35.0 MB", "–", "13", "–", "0.02 s", "–")
    assert clients.rows[-1][:4] == ("zeromq", "32", "667", "1,000")
    assert mixed.rows[0] == ("zeromq", "1", "200 µs", "200 µs", "300 µs", "240 µs", "1.50 ×", "1.20 ×")
    assert fanout.rows[0][1] == "1 × 1 KB"
    assert sizes.rows[0][4] == "1.20 ×"
    assert arrivals.rows[0] == ("zeromq", "16, at once", "100", "90", "5", "4", "1")
    for each in (idle, clients, mixed, fanout, sizes, arrivals):
        assert as_text(each)


def test_each_goal_is_judged_at_the_largest_number() -> None:
    found = {(each.goal, each.case): each for each in scale.findings(ROWS)}
    assert (found["publications", ""].shown, found["publications", ""].met) == ("286 MB, 256, 0.01 s", False)
    assert (found["clients", ""].shown, found["clients", ""].met) == ("1.00 ×, 1.50 ×, 0.95", True)
    assert (found["mixed", ""].shown, found["mixed", ""].met) == ("1.50 ×, 300 µs", True)
    assert (found["fanout", "16 × 1 MB"].shown, found["fanout", "16 × 1 MB"].met) == ("1.40 ×, 1.00 ×", False)
    assert (found["arrivals", "256 topics"].shown, found["arrivals", "256 topics"].met) == ("1 of 100", False)


def test_there_is_a_figure_for_each_part() -> None:
    drawn = charts.drawn([asdict(row) for row in ROWS])
    for name, text in drawn.items():
        assert name.startswith("performance-scale-")
        ElementTree.fromstring(text)
    assert len(drawn) == 10
    assert "stroke-dasharray" in drawn["performance-scale-memory.svg"]
    assert "100 MB" in drawn["performance-scale-memory.svg"]
    assert charts.drawn([]) == {}


def fail(control: Control) -> None:
    raise SystemExit(1)


def answer(control: Control, more: int) -> None:
    while True:
        control.send(control.recv() + more)


def test_members_tell_what_they_find_and_one_that_ends_is_an_error() -> None:
    one, other = Member(answer, 1), Member(answer, 2)
    with together(one, other):
        one.say(10)
        other.say(10)
        assert (one.told(), other.told()) == (11, 12)
    ended = Member(fail)
    with together(ended), pytest.raises(RuntimeError, match="a process ended"):
        ended.told()
