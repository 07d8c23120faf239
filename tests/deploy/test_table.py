"""The table of processes: what stands in it, and that it stays readable on any terminal."""

from __future__ import annotations

import pytest

from robocomp_py import __version__
from robocomp_py.deploy.agents import Life
from robocomp_py.deploy.policy import State
from robocomp_py.deploy.snapshot import HostStatus
from robocomp_py.deploy.table import duration, memory, milliseconds, ports, summary, table, text

from .networks import process, snapshot


def shown(*processes: object, **options: object) -> list[str]:
    return [text(line) for line in table(snapshot(*processes), **options)]  # type: ignore[arg-type]


def test_a_line_says_all_of_a_process() -> None:
    assert shown(process("laser"), process("left/arm", restarts=2, pid=12, memory=1_234_000_000)) == [
        "instance  state   pid  uptime  restarts   cpu  memory  calls/s   worst",
        "laser     ready  4711    1:01         0  25 %   45 MB       20  1.2 ms",
        "left/arm  ready    12    1:01         2  25 %  1.2 GB       20  1.2 ms",
    ]


def test_values_that_no_process_reports_have_no_column() -> None:
    quiet = process("laser", pid=None, uptime=None, cpu=None, memory=None, calls=0.0, worst=0.0)
    assert shown(quiet) == ["instance  state  restarts", "laser     ready         0"]


def test_a_component_in_an_emergency_or_too_slow_is_reported() -> None:
    usual, slow = Life("compute", 0, 0, 0, __version__), Life("compute", 40, 2, 0, __version__)
    alarmed = Life("emergency", 0, 0, 0, "0.0.9")
    quiet = {"pid": None, "uptime": None, "cpu": None, "memory": None, "calls": None, "worst": None}
    lines = shown(
        process("laser", lives={"laser": usual}, **quiet),
        process("arm", lives={"arm": alarmed}, **quiet),
        process("home", instances=("base", "world"), lives={"base": slow, "world": alarmed}, **quiet),
    )
    assert [line.rstrip() for line in lines] == [
        "instance  state      restarts  overruns  missed  version",
        "laser     ready             0",
        "arm       emergency         0                    0.0.9",
        "home      ready             0        40       2  0.0.9",
        "  base    ready",
        "  world   emergency",
    ]
    both = snapshot(process("laser", lives={"laser": usual}), process("arm", lives={"arm": alarmed}))
    assert text(summary(both)) == "home: 2 components, 2 ready, 1 in emergency, up 3:07"


def test_the_ports_of_both_ends_of_a_way_are_told() -> None:
    way = {"client": "visitor", "port": "Hello1", "provider": "host", "verb": "requires", "interface": "Hello",
           "operation": "greet", "middleware": "shm"}  # fmt: skip
    heard = way | {"client": "eyes", "port": "HelloPub", "verb": "subscribesTo", "interface": "HelloPub"}
    assert [text(line) for line in ports([way, way | {"client": "guest", "port": "Hello"}, heard])] == [
        "instance  port                   peers           over",
        "eyes      subscribesTo HelloPub  host            shm",
        "guest     requires Hello         host            shm",
        "host      implements Hello       visitor, guest  shm",
        "host      publishes HelloPub     eyes            shm",
        "visitor   requires Hello1        host            shm",
    ]
    assert ports([]) == []


def test_hosts_are_shown_if_there_are_any() -> None:
    hosts = (HostStatus("onboard", "192.168.1.10", True, ""),)
    lines = [text(line) for line in table(snapshot(process("a", host="onboard"), process("b"), hosts=hosts))]
    assert [line.split()[:3] for line in lines] == [["instance", "host", "state"], ["a", "onboard", "ready"],
                                                    ["b", "here", "ready"]]  # fmt: skip


def test_instances_that_share_a_process_stand_below_it() -> None:
    home = process("home", instances=("laser", "base"), ended=("laser",))
    assert [line.split()[:2] for line in shown(home)][1:] == [["home", "ready"], ["laser", "ended"], ["base", "ready"]]
    assert shown(home)[2].startswith("  laser ")


def test_why_something_is_as_it_is_stands_at_the_end() -> None:
    again = process("a", State.RESTARTING, pid=None, how="ended with exit code 3", next_start=3.72)
    waits = process("b", State.STARTING, status="waiting for Laser of world")
    works = process("c", status="12 scans/s")
    lines = shown(again, waits, works)
    assert lines[1].endswith("  ended with exit code 3; again in 3.7 s")
    assert lines[2].endswith("  waiting for Laser of world")
    assert lines[3].endswith("  12 scans/s")


def test_a_full_table_omits_healthy_processes_and_says_how_many() -> None:
    many = [process(f"n{number}") for number in range(500)]
    many[400] = process("broken", State.FAILED)
    many[450] = process("slow", State.STARTING)
    many[7] = process("shaky", restarts=9)
    lines = shown(*many, height=8)
    assert len(lines) == 8
    assert [line.split()[0] for line in lines[1:-1]] == ["n0", "n1", "n2", "shaky", "broken", "slow"], "in their order"
    assert lines[-1] == "... and 494 more: 494 ready"


@pytest.mark.parametrize("height", range(2, 12))
def test_no_more_lines_are_taken_than_there_are(height: int) -> None:
    shared = process("home", State.FAILED, instances=("laser", "base"))
    assert len(shown(*(process(f"n{n}") for n in range(4)), shared, process("x"), height=height)) <= height


@pytest.mark.parametrize("width", [10, 20, 40, 60, 72, 80, 100, 120])
def test_lines_are_as_long_as_the_terminal_at_most_and_tell_the_state_as_long_as_they_can(width: int) -> None:
    rows = [process("left/wrist/joint"), process("arm", State.FAILED, how="ended with exit code 3", pid=None)]
    lines = shown(*rows, width=width)
    assert max(map(len, lines)) <= max(width, len("l~  failed"))
    assert all(state in line for state, line in zip(("state", "ready", "failed"), lines, strict=True))


def test_the_summary_counts_what_is_how() -> None:
    home = process("home", instances=("laser", "base"), ended=("laser",))
    now = snapshot(home, process("arm", State.FAILED), process("eye"))
    assert text(summary(now)) == "home: 4 components, 1 failed, 2 ready, 1 ended, up 3:07"


def test_the_summary_says_why_a_network_stops_and_which_host_is_lost() -> None:
    host = HostStatus("onboard", "192.168.1.10", False, "no route to host")
    now = snapshot(process("arm"), hosts=(host,), stopping=True, why="time limit reached")
    assert text(summary(now)) == (
        "home: 1 component, 1 ready, up 3:07; stopping: time limit reached; "
        "host onboard is out of reach: no route to host"
    )


@pytest.mark.parametrize("state", list(State))
def test_every_state_can_be_shown(state: State) -> None:
    assert str(state) in shown(process("a", state), process("b"), height=3)[1]
    assert f"1 {state}" in text(summary(snapshot(process("a", state))))


def test_numbers_are_written_for_people() -> None:
    assert [duration(s) for s in (0.4, 59.9, 60, 3599, 3600, 86399, 90061)] == [
        "0 s", "59 s", "1:00", "59:59", "1:00:00", "23:59:59", "1 d 01:01",
    ]  # fmt: skip
    assert [memory(size) for size in (812_000, 9_400_000, 45_300_000, 1_250_000_000)] == [
        "812 kB", "9.4 MB", "45 MB", "1.2 GB",
    ]  # fmt: skip
    assert [milliseconds(s) for s in (0.00012, 0.0123, 0.25)] == ["0.12 ms", "12.3 ms", "250 ms"]
