"""The benchmarks run, print whole tables, and leave nothing behind. How fast anything is, is not judged here."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.parties import MIDDLEWARES
from benchmarks.query import Row
from benchmarks.rounds import Times, by_turns, ratio
from benchmarks.tables import Table, fill
from robocomp_py.testing.patience import SOON, wait_until

ROOT = Path(__file__).parents[2]
BRIEF = ("--rounds", "1", "--seconds", "0.005")
SIZES = (64, 70_000)  # inside and beside the MessagePack; one packet of DDS and two
TABLE = Table("query", "title", ("", "array", "p50"), [("dds", "64 B", "70 µs")])


def start(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "benchmarks", *BRIEF, *arguments]
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


@pytest.mark.parametrize("middleware", MIDDLEWARES)
def test_every_size_of_every_middleware_gets_its_row(middleware: str, tmp_path: Path) -> None:
    sizes = ",".join(map(str, SIZES))
    out, found = run(tmp_path, "--what", "query,publish", "--only", middleware, "--sizes", sizes)
    assert out.count("64 B") == 3  # query, latency, throughput
    for what in ("query", "publish"):
        assert [(row["middleware"], row["size"]) for row in found[what]] == [(middleware, size) for size in SIZES]
        assert all(row["ours"] and bool(row["raw"]) == (middleware != "inproc") for row in found[what])


def test_components_are_started_and_time_is_told_apart(tmp_path: Path) -> None:
    out, found = run(tmp_path, "--what", "start,layers", "--only", "zeromq")
    assert 0 < found["start"][0]["interpreter"] < found["start"][0]["ready"]
    assert [row["size"] for row in found["layers"]] == [64, 1_000_000]
    assert "ready" in out
    assert "+ codec" in out


def test_ctrl_c_ends_all_of_it() -> None:
    with start("--what", "query", "--only", "dds,zenoh", "--rounds", "100") as process:
        assert process.stderr
        assert any("1 KB" in line for line in process.stderr)  # the second size: both processes are at work
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        out, errors = process.communicate(timeout=SOON * 3)
    assert process.returncode == 130, out + errors
    assert "interrupted" in errors
    wait_until(lambda: is_alone(process.pid), what="nothing is left")


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


def test_the_page_on_performance_has_a_place_for_every_table() -> None:
    page = (ROOT / "docs" / "performance.md").read_text(encoding="utf-8")
    names = ("machine", "start", "query", "latency", "throughput", "layers", "package_codec", "memory", "languages")
    for name in names:
        assert f"<!-- measured: {name} -->" in page


def test_ratios_are_taken_within_rounds() -> None:
    quiet_then_busy = [[10.0], [100.0], [1000.0]]
    assert ratio([[20.0], [200.0], [2000.0]], quiet_then_busy) == 2.0


def test_who_was_last_in_a_round_begins_the_next() -> None:
    turns: list[str] = []
    by_turns([lambda: turns.append("ours") or [0.0], lambda: turns.append("raw") or [0.0]], rounds=2)
    assert turns == ["ours", "raw", "raw", "ours"]


@pytest.mark.parametrize(("raw", "allowed"), [(40.0, 65.0), (100.0, 135.0)])
def test_small_queries_may_cost_a_third_or_25_microseconds_more(raw: float, allowed: float) -> None:
    row = Row("dds", 64, Times(1.0, 1.0), Times(raw, raw), 1.0)
    assert row.allowed == pytest.approx(allowed)
