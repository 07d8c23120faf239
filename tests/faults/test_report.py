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
        "| kill | slowest (≤ 1) | 0.75 s | **missed:** 2 s |",
        "| stop | zeromq | slowest 0.5 s (≤ 1) |",
    ]
    assert "| kill | kill -9 | 0 hangs |" in lines
    assert "seed 2," in page.read_text()


def test_a_page_omits_figures_that_are_0_as_required(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- written by `make faults` --><!-- end of what `make faults` writes -->")
    lost = [
        Found(KILL, name, Result([Figure("lost", n, limit=0)]), "", 1.0, True) for n, name in enumerate(KILL.transports)
    ]
    write_page(lost, [KILL], 1, page)
    assert "| kill | | kept | |" in page.read_text()
    assert "| kill | lost (≤ 0) | | **missed:** 1 |" in page.read_text()


def test_a_page_has_only_figures_with_a_limit_and_names_each_limit_once_if_it_is_the_same(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- written by `make faults` --><!-- end of what `make faults` writes -->")
    limits = {"zeromq": 1.0, "dds": 2.5}
    measured = [
        Found(
            KILL,
            name,
            Result([Figure("kills", 9), Figure("slowest", 0.5, "s", limits[name]), Figure("growth", 3, "MB", 30)]),
            "",
            1.0,
            True,
        )
        for name in KILL.transports
    ]
    for _ in range(2):  # the second time from what is on the page
        write_page(measured, [KILL], 1, page)
        measured = []
        lines = [line for line in page.read_text().splitlines() if line.startswith("| kill |")]
        assert lines == [
            "| kill | kill -9 | 0 hangs |",
            "| kill | slowest | 0.5 s (≤ 1) | 0.5 s (≤ 2.5) |",
            "| kill | growth (≤ 30) | 3 MB | 3 MB |",
        ]
