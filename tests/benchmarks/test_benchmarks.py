"""The benchmarks run, print whole tables, and leave nothing behind. How fast anything is, is not judged here."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from benchmarks import counters, figures, goals, placement, query, results, versus
from benchmarks.goals import Finding, failed
from benchmarks.guard import Probe, compare
from benchmarks.pair import Pair
from benchmarks.parties import MIDDLEWARES
from benchmarks.query import Row
from benchmarks.rounds import Effort, Times, by_turns, difference, ratio
from benchmarks.tables import Table, as_text, fill
from robocomp_py.testing.patience import SOON, wait_until

ROOT = Path(__file__).parents[2]
BRIEF = ("--rounds", "1", "--seconds", "0.002")
SIZES = (64, 70_000)  # inside and beside the MessagePack; one packet of DDS and two
LONG = pytest.mark.tool  # needs nothing but time: `make test` has less of it than `make test-tools`
TABLE = Table("query", "title", ("", "array", "p50"), [("dds", "64 B", "70 µs")])


def start(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-X", "faulthandler", "-m", "benchmarks", *BRIEF, *arguments]
    return subprocess.Popen(
        command, cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    )


def is_alone(group: int) -> bool:
    """Whether no process of that group is left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    return False


def run(folder: Path, *arguments: str) -> tuple[str, dict[str, Any]]:
    file = folder / "found.json"
    with start("--json", str(file), *arguments) as process:
        out, errors = process.communicate(timeout=SOON * 10)
    assert process.returncode == 0, out + errors
    wait_until(lambda: is_alone(process.pid), what="nothing is left")
    return out, json.loads(file.read_text())


@LONG
def test_every_size_of_every_middleware_gets_its_row(tmp_path: Path) -> None:
    _, found = run(tmp_path, "--what", "query,publish", "--sizes", ",".join(map(str, SIZES)))
    for what in ("query", "publish"):
        rows = found[what]
        assert [(row["middleware"], row["size"]) for row in rows] == [
            (each, size) for each in MIDDLEWARES for size in SIZES
        ]
        assert not any(row["failure"] for row in rows)
        assert all(row["ours"] and bool(row["raw"]) == (row["middleware"] != "inproc") for row in rows)


@LONG
def test_a_failure_at_one_size_does_not_hide_the_figures_of_smaller_ones() -> None:
    starts: list[int] = []

    def measure(size: int, pairs: list[Pair], effort: Effort) -> int:
        if size == 64:
            starts.append(effort.rounds)
        if size == 1024 and len(starts) == 2:
            raise TimeoutError("no answer")
        return len(starts)

    found = query.by_starts("inproc", 10, (64, 1024, 4096), Effort(10, 0.002), measure)
    assert found == [(64, [1, 2, 3], ""), (1024, [1], "no answer"), (4096, [1], "no answer")]
    assert starts == [4, 4, 2]


@LONG
def test_small_messages_are_measured_in_every_place_and_the_affinity_is_restored(tmp_path: Path) -> None:
    cores = os.sched_getaffinity(0)
    rows = placement.run(["zeromq"], Effort(1, 0.002), lambda _: None)
    assert os.sched_getaffinity(0) == cores
    places = placement.PLACES if len(cores) > 1 else {}
    assert [(row.what, row.where) for row in rows] == [
        (what, where) for where in places for what in ("query", "publish")
    ]
    assert as_text(placement.table(rows))


@LONG
def test_counters_are_measured_beside_the_same_query_without_them(tmp_path: Path) -> None:
    _, found = run(tmp_path, "--what", "counters", "--only", "inproc,zeromq,shm")
    assert {row["middleware"] for row in found["counters"]} == {"inproc", "zeromq", "shm"}
    assert all(row["counted"] > 0 and row["uncounted"] > 0 and not row["failure"] for row in found["counters"])


def test_within_one_process_counters_may_take_a_fifth_of_a_microsecond_and_else_a_fiftieth() -> None:
    rows = [counters.Row("inproc", 5.2, 5.0, 0.2, 1.04), counters.Row("inproc", 5.3, 5.0, 0.3, 1.06)]
    rows += [counters.Row("shm", 25.4, 25.0, 0.4, 1.016), counters.Row("shm", 25.6, 25.0, 0.6, 1.024)]
    rows += [counters.Row("zeromq", failure="gone")]
    assert [each.met for each in counters.findings(rows)] == [True, False, True, False, False]
    assert counters.table(rows).rows[1][3:] == ("+0.30 µs", "1.060 ×", "≤ +0.2 µs: missed")


@LONG
def test_ice_is_measured_if_it_is_named(tmp_path: Path) -> None:
    _, found = run(tmp_path, "--what", "query", "--only", "ice", "--sizes", "64")
    [row] = found["query"]
    assert (row["middleware"], row["failure"]) == ("ice", "")
    assert row["ours"]
    assert row["raw"]


@LONG
def test_start_cpu_threads_and_layers_are_measured_in_their_parts(tmp_path: Path) -> None:
    out, found = run(tmp_path, "--what", "start,cpu,threads,layers", "--only", "zeromq")
    begun = found["start"][0]
    assert 0 < begun["interpreter"] < begun["ready"]
    assert 0 < begun["share"] <= begun["memory"]
    assert found["cpu"][0]["publisher"] is not None
    assert [(row["what"], row["size"]) for row in found["threads"]] == [
        ("query", 64),
        ("query", 1_000_000),
        ("publish", 64),
    ]
    assert [row["size"] for row in found["layers"]] == [64, 1_000_000]
    assert "+ codec" in out


@LONG
def test_loaned_messages_arrive(tmp_path: Path) -> None:
    _, found = run(tmp_path, "--what", "loans")
    assert [row["middleware"] for row in found["loans"]] == [each for each in ("shm", "inproc") if each in MIDDLEWARES]


@LONG
def test_pictures_are_measured(tmp_path: Path) -> None:
    _, found = run(tmp_path, "--what", "pictures", "--rounds", "1")
    assert [row["scene"] for row in found["pictures"]] == ["plain", "textured"]
    assert all(row["ours"] > 0 and row["bare"] > 0 for row in found["pictures"])


@LONG
def test_simulation_is_measured(tmp_path: Path) -> None:
    _, found = run(tmp_path, "--what", "simulation", "--rounds", "2")
    rows = {row["what"]: row for row in found["simulation"]}
    assert len(rows) == 12
    assert [name.partition(":")[0] for name, row in rows.items() if row["bare"]] == [
        "tick, 20 boxes that fall",
        "tick, 20 boxes at rest",
        "laser, 360 rays",
        "laser, 1080 rays",
        "add a node, 341 shapes",
        "remove a node, 341 shapes",
        "step of an environment, 61 shapes, 90 rays and a pose with speeds, physics off",
        "step of an environment, 61 shapes, 90 rays and a pose with speeds, physics on",
    ]
    assert all(row["ours"] > 0 for row in rows.values())


@LONG
def test_a_long_simulation_tells_its_memory() -> None:
    command = [sys.executable, "-m", "benchmarks.soak", "--hours", "0.05", "--tick", "0.02"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600.0)
    found = json.loads(done.stdout)
    assert len(found["resident"]) == 10
    assert found["hours"] == pytest.approx(0.05)
    assert found["growth"] < 10
    assert done.returncode == (0 if found["growth"] <= 2 else 1)


@LONG
def test_other_frameworks_have_figures_or_are_said_to_be_missing(tmp_path: Path) -> None:
    out, found = run(tmp_path, "--what", "peers", "--path", "zeromq", "--sizes", "64")
    ours, *others = found["peers"]
    assert ours["times"]["64"]
    assert len(others) == len(versus.PEERS)
    for row in others:
        assert bool(row["times"]) != row["failure"].startswith("not installed"), row
        assert row["name"] in out


@LONG
def test_a_framework_that_ends_does_not_keep_the_others_from_being_measured() -> None:
    def missing() -> str:
        raise LookupError("it")

    peers = [
        versus.Peer("one that ends", lambda: "1.0", "", lambda _: [(sys.executable, "-c", "1 / 0")]),
        versus.Peer("one that is missing", missing, "pip install it", lambda _: []),
    ]
    rows = versus.run("zeromq", peers, (64,), Effort(1, 0.002), lambda _: None)
    assert rows[0].times[64].p50 > 0
    assert "ZeroDivisionError" in rows[1].failure
    assert rows[2].failure == "not installed: pip install it"
    assert "one that is missing" in as_text(versus.table(rows))


@LONG
@pytest.mark.parametrize("middleware", ["zeromq", "dds", "zenoh", "shm"])
def test_a_recorder_is_measured(middleware: str, tmp_path: Path) -> None:
    out, found = run(tmp_path, "--what", "record", "--only", middleware, "--seconds", "0.01")
    assert [(row["middleware"], row["compress"]) for row in found["record"]] == [
        (middleware, "none"),
        (middleware, "lz4"),
    ]
    assert all(row["sent"] > 0 and row["memory"] > 10 for row in found["record"])
    assert "rc record: 6 MB at 30 Hz and 200 B at 1000 Hz" in out


@LONG
def test_ctrl_c_ends_all_of_it() -> None:
    with start("--what", "query", "--only", "dds", "--rounds", "100") as process:
        assert process.stderr
        assert any("1 KB" in line for line in process.stderr)  # the second size: both processes are at work
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        try:
            out, errors = process.communicate(timeout=SOON * 9)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGABRT)  # each tells where it is
            out, errors = process.communicate()
    assert process.returncode == 130, out + errors
    assert "interrupted" in errors
    wait_until(lambda: is_alone(process.pid), what="nothing is left")


# Tables and the page.


def test_a_table_replaces_what_stood_between_its_marks() -> None:
    page = (
        "before\n<!-- measured: query -->\nold\n<!-- end -->\nbetween\n<!-- measured: start -->\nkept\n<!-- end -->\n"
    )
    filled = fill(page, [TABLE])
    assert "old" not in filled
    assert "| dds | 64 B | 70 µs |" in filled
    assert filled.startswith("before\n<!-- measured: query -->\n")
    assert filled.endswith("between\n<!-- measured: start -->\nkept\n<!-- end -->\n")
    assert fill(filled, [TABLE]) == filled
    assert fill(page.replace("old\n", ""), [TABLE]) == filled


def test_a_page_without_a_place_for_a_table_is_refused() -> None:
    with pytest.raises(ValueError, match="measured: query"):
        fill("no marks", [TABLE])


def test_the_stored_results_have_every_table() -> None:
    files = [file for folder in (".", "scale") for file in (ROOT / "benchmarks" / folder).glob("*.py")]
    code = "".join(file.read_text(encoding="utf-8") for file in files)
    names = set(re.findall(r'(?:Table|_beside)\(\s*"([\w-]+)"', code))
    names -= {"check"}  # which the guard prints, and does not store
    assert {"machine", "summary", "query", "peers", "scale-idle"} <= names
    assert {table.name for table in results.tables(results.load())} == names


def test_a_part_that_is_stored_replaces_its_own_figures_and_names_another_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def machine(processor: str) -> Table:
        return Table("machine", "machine", ("", ""), [("processor", processor)])

    def of(figure: str) -> list[Table]:
        return [Table("query", "query", ("", "p50"), [("dds", figure)])]

    start = Table("start", "start", ("", "s"), [("dds", "0.4")])
    quick, slow = (
        Finding("small", "dds", "64 B", "1.0 ×", met=True),
        Finding("small", "dds", "64 B", "2.0 ×", met=False),
    )
    other = Finding("start", "dds", "", "0.4 s", met=True)
    monkeypatch.setattr(results, "FILE", tmp_path / "results.json")
    results.store([machine("A"), *of("70"), start], [quick, other], {"query": [], "publish": [], "peers": []})
    results.replace([machine("A"), *of("80")], [slow], {"query": []})
    assert results.tables(results.load())[:3] == [machine("A"), *of("80"), start]
    assert [each["shown"] for each in results.load()["findings"]] == ["2.0 ×", "0.4 s"]
    results.replace([machine("B"), *of("90")], [slow], {"query": []})
    assert [each.note for each in results.tables(results.load())[:3]] == ["", "Measured on another machine: B.", ""]


def test_the_page_on_performance_and_its_figures_show_the_stored_results() -> None:
    for path, text in results.files(results.load()).items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name}: `make bench ARGS=--draw`"
        assert path == results.PAGE or path.name in results.PAGE.read_text(encoding="utf-8")


def test_a_figure_shows_ours_and_raw_over_the_size() -> None:
    row = {"middleware": "shm", "size": 64, "ours": {"p50": 10.0, "p99": 20.0}, "raw": {"p50": 9.0, "p99": 11.0}}
    large = row | {"size": 1024, "ours": {"p50": 90.0, "p99": 99.0, "percentiles": [[5, 80.0]]}}
    published = [
        {**row, **{party: {"latency": row[party], "rate": 100.0} for party in ("ours", "raw")}},
    ]
    drawn = figures.drawn(
        {"query": [row, large], "publish": [*published, {**published[0], "size": 1024}],
         "peers": [{"name": "other", "times": {"64": row["raw"], "1024": row["ours"]}}]}
    )  # fmt: skip
    for text in drawn.values():
        ElementTree.fromstring(text)
    assert "shm, ours" in drawn["performance-query.svg"]
    assert "stroke-dasharray" in drawn["performance-query.svg"]
    assert "other" in drawn["performance-peers.svg"]
    assert "99 %" in drawn["performance-spread.svg"]


def test_the_summary_has_the_best_and_the_worst_of_each_goal() -> None:
    found = [
        Finding("small", "dds", "64 B", "1.10 ×", met=True, ratio=1.1),
        Finding("small", "dds", "1 KB", "1.30 ×", met=False, ratio=1.3),
        Finding("idle", "dds", "", "0.10 %", met=True, value=0.1),
        failed("start", "dds"),
    ]
    rows = {row[0]: row[2:] for row in goals.table(found).rows}
    assert rows[goals.GOALS["small"].what] == ("1.10 × (dds 64 B)", "1.30 × (dds 1 KB)", "1 of 2")
    assert rows[goals.GOALS["idle"].what] == ("0.10 % (dds)", "0.10 % (dds)", "yes")
    assert rows[goals.GOALS["start"].what] == ("failed (dds)", "failed (dds)", "0 of 1")
    assert rows[goals.GOALS["loan"].what] == ("", "", "not measured")


# Figures.


def test_ratios_are_taken_within_rounds() -> None:
    quiet_then_busy = [[10.0], [100.0], [1000.0]]
    assert ratio([[20.0], [200.0], [2000.0]], quiet_then_busy) == 2.0
    assert difference([[20.0], [200.0], [2000.0]], quiet_then_busy) == 100e6


def test_the_last_party_of_a_round_begins_the_next() -> None:
    turns: list[str] = []
    by_turns([lambda: turns.append("ours") or [0.0], lambda: turns.append("raw") or [0.0]], rounds=2)
    assert turns == ["ours", "raw", "raw", "ours"]


@pytest.mark.parametrize(
    ("size", "times", "more", "met"),
    [
        (64, 1.14, 30.0, True),
        (1024, 1.30, 11.0, True),
        (64, 1.30, 13.0, False),
        (1_000_000, 1.09, 90.0, True),
        (6_000_000, 1.11, 5.0, False),
    ],
)
def test_small_queries_may_take_12_microseconds_longer_and_large_ones_a_tenth(
    size: int, times: float, more: float, met: bool
) -> None:
    assert Row("dds", size, Times(1.0, 1.0), Times(1.0, 1.0), times, more).met is met


# The guard.


def probe(*ratios: float | None) -> Probe:
    """One that finds these, one after the other; None is a failure."""
    rest = iter(ratios)

    def measure(effort: Effort) -> list[Finding]:
        return [Finding("small", "dds", "64 B", "", met=True, ratio=next(rest))]

    return Probe("query", "dds", measure)


BEFORE = {"small · dds · 64 B": 1.0, "small · zeromq · 64 B": 1.0}


def test_a_ratio_that_stays_too_large_has_regressed() -> None:
    (row,) = compare(BEFORE, [probe(1.5, 1.6, 1.4, 1.7)], Effort(1, 0.0))
    assert row.regressed
    assert row.found == 1.4


def test_a_ratio_that_was_too_large_by_chance_has_not_regressed() -> None:
    (row,) = compare(BEFORE, [probe(1.5, 1.1)], Effort(1, 0.0))
    assert not row.regressed


def test_what_cannot_be_measured_any_more_has_regressed() -> None:
    (row,) = compare(BEFORE, [probe(None, None, None, None)], Effort(1, 0.0))
    assert row.regressed


def test_a_measurement_without_a_baseline_is_reported_and_has_not_regressed() -> None:
    (row,) = compare({}, [probe(9.0)], Effort(1, 0.0))
    assert row.found == 9.0
    assert not row.regressed
