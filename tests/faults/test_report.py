"""What was found is written to a page, and stays there until it is found again."""

from __future__ import annotations

from pathlib import Path

from .checker import Violation
from .report import Found, table, write_page
from .rows import Figure, Result, Row, Run


def nothing(run: Run) -> Result:
    return Result()


KILL = Row("kill", "kill -9", "0 hangs", ("zeromq", "dds"), 1.0, nothing)
STOP = Row("stop", "SIGSTOP", "in time", ("zeromq",), 1.0, nothing)


def found(row: Row, transport: str, seconds: float, *violations: Violation, timed: bool = True) -> Found:
    result = Result([Figure("slowest", seconds, "s", 1.0, timed=True)], list(violations))
    return Found(row, transport, result, "", 1.0, timed)


def test_a_miss_is_named_and_times_count_only_where_they_are_judged() -> None:
    assert found(KILL, "dds", 0.5).misses == []
    assert found(KILL, "dds", 2.0).misses == ["slowest 2 s (≤ 1)"]
    assert found(KILL, "dds", 2.0, timed=False).misses == []
    broken = found(KILL, "dds", 0.5, Violation("once", "c-1 was executed 2 times"), timed=False)
    assert broken.misses == ["once: c-1 was executed 2 times"]
    assert "MISSED" in table([broken])
    assert Found(KILL, "dds", None, "RuntimeError: it ended", 1.0, False).misses == ["RuntimeError: it ended"]


def test_a_page_keeps_what_was_not_run_again(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- written by `make faults` -->\n<!-- end of what `make faults` writes -->\nafter\n")
    write_page([found(STOP, "zeromq", 0.5), found(KILL, "dds", 0.25)], [KILL, STOP], 1, page)
    write_page([found(KILL, "dds", 2.0), found(KILL, "zeromq", 0.75)], [KILL, STOP], 2, page)
    lines = page.read_text().splitlines()
    assert lines[0] == "before"
    assert lines[-1] == "after"
    assert [line for line in lines if "slowest" in line] == [
        "| kill | zeromq | slowest 0.75 s (≤ 1) |",
        "| kill | dds | slowest 2 s (≤ 1); **missed:** slowest 2 s (≤ 1) |",
        "| stop | zeromq | slowest 0.5 s (≤ 1) |",
    ]
    assert "| kill | kill -9 | 0 hangs |" in lines
    assert "seed 2," in page.read_text()


def test_a_page_leaves_out_figures_that_must_be_0_and_are(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- written by `make faults` --><!-- end of what `make faults` writes -->")
    lost = [
        Found(KILL, name, Result([Figure("lost", n, limit=0)]), "", 1.0, True) for n, name in enumerate(KILL.transports)
    ]
    write_page(lost, [KILL], 1, page)
    assert "| kill | zeromq | kept |" in page.read_text()
    assert "| kill | dds | lost 1 (≤ 0); **missed:** lost 1 (≤ 0) |" in page.read_text()
