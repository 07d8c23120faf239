"""What `rc doctor` finds in networks and on machines that are broken on purpose."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from robocomp_py.cli import rc
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.contract.qos import QoS, Reliability
from robocomp_py.runtime.effective import toml
from robocomp_py.runtime.RoboCompIntrospection import Description, Measure, Measures
from robocomp_py.runtime.RoboCompIntrospection import End as ToldEnd
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import wait_until
from robocomp_py.tools import asking
from robocomp_py.tools.census import take_census
from robocomp_py.tools.doctor import files, qos
from robocomp_py.tools.doctor.checks import CHECKS, examine
from robocomp_py.tools.doctor.collect import machine
from robocomp_py.tools.doctor.facts import (
    Asked,
    Complaints,
    Facts,
    Launched,
    Left,
    Machine,
    Place,
    Process,
    Space,
    Used,
    Weight,
    size,
)
from robocomp_py.tools.network import End
from robocomp_py.transports.base import find_transport
from robocomp_py.transports.census import Told
from robocomp_py.transports.runtime_folder import runtime_dir

from ..runtime.components import Calculator, Pupil
from ..runtime.running import make, running
from .facts import DIVIDE, EYE, HAND, HEARD, NEWS, THERE, WORLD, asked, end, facts, findings, plan, way
from .talkers import Talker

GB = 1 << 30


HEALTHY = facts(
    *(WORLD, HAND, NEWS, EYE),
    machine=Machine(
        (Process(1, 20, 1024),),
        Used(3, 128),
        Used(10, 65536),
        Space("/dev/shm", "messages", 2 * GB, GB, 0, 0),
        disks=(Space("/", "sockets", 20 * GB, 9 * GB, 100000, 90000),),
    ),
    components=(asked("world", Measures(state="compute", period=0.1, computes=1000, overruns=3), offset=0.0),),
)


def test_nothing_is_wrong_with_a_healthy_network() -> None:
    assert list(examine(HEALTHY)) == []
    assert list(examine(Facts("here"))) == []


def test_every_check_has_a_name_and_says_what_it_finds() -> None:
    assert len({each.NAME for each in CHECKS}) == len(CHECKS)
    assert all(each.NAME.isidentifier() and each.HELP for each in CHECKS)


# What runs.


def test_a_missing_server_is_found_and_so_is_a_missing_publisher() -> None:
    assert findings(facts(HAND, EYE), "servers") == [
        "error hand uses Everything of world, and nothing there provides it: "
        "start world, or see why it ended: where world was started, or by rcdeploy logs",
        "warn eye subscribes to Everything, and nothing there provides it: start a component that provides Everything",
    ]


def test_a_missing_server_of_an_action_is_told_once() -> None:
    parts = (
        ("calls", "arm/Arm/lift-start"),
        ("subscribes", "arm/Arm/lift-feedback"),
        ("subscribes", "arm/Arm/lift-status"),
    )
    (found,) = findings(facts(*(end("hand", *part) for part in parts)), "servers")
    assert found.startswith("error hand uses Arm of arm, ")


def test_of_a_declared_instance_the_command_is_told_that_shows_its_log() -> None:
    given = facts(components=(Asked("arm", 8, "S"), Asked("world", 9, "S")), plans=({"name": 1}, plan()))
    arm, world = findings(given, "silent")
    assert "see its log: where arm was started, or by rcdeploy logs;" in arm
    assert "see its log: rcdeploy logs house world --level warning;" in world


def test_a_server_of_another_instance_does_not_answer_for_the_missing_one() -> None:
    other = end("other", "serves", "other/Everything/divide")
    assert len(findings(facts(HAND, other), "servers")) == 1
    assert findings(facts(end("hand", "calls", "*/Everything/divide"), other), "servers") == []


def test_sides_of_different_contracts_are_found_with_the_fields() -> None:
    other = replace(e.divide, inputs=e.divide.inputs[:1])
    (found,) = findings(facts(WORLD, end("hand", "calls", "world/Everything/divide", operation=other)), "contracts")
    assert found.startswith("error hand and world disagree on world/Everything/divide: ")
    assert "absent" in found
    unknown = End("near", Told("hand", 2, "calls", "world/Everything/divide", 7, ""))
    assert "their contracts differ" in findings(facts(WORLD, unknown), "contracts")[0]


RELIABLE = QoS(Reliability.RELIABLE, deadline=0.1)


def subscribed(channel: str, text: str) -> ToldEnd:
    return ToldEnd(verb="subscribesTo", channel=channel, qos=text, operation="news")


def test_a_subscriber_that_asks_for_more_than_is_offered_is_found() -> None:
    eye = asked("eye", ends=[subscribed("*/Everything/news", toml(RELIABLE))])
    less, slower = sorted(findings(facts(NEWS, EYE, components=(eye,)), "qos"), reverse=True)
    assert less == (
        "error eye gets less than it asks for from world/Everything/news: `reliable` is asked for, `best_effort` is "
        'offered: offer it, or set in eye\'s configuration: reliability = "best_effort"'
    )
    assert "`deadline 100 ms` is asked for, none is offered" in slower
    offered = replace(NEWS, told=NEWS.told._replace(traits="rd100000000"))
    assert findings(facts(offered, EYE, components=(eye,)), "qos") == []


@pytest.mark.parametrize("text", ["", "{", "7", '"loud"', "{ depth = [[[", "[1]", '{ reliability = "so" }', "a\nb=1"])
def test_a_quality_of_service_of_another_version_is_left_out(text: str) -> None:
    eye = asked("eye", ends=[subscribed("*/Everything/news", text)])
    assert findings(facts(NEWS, EYE, components=(eye,)), "qos") == []


def test_the_quality_of_service_is_read_as_a_component_tells_it() -> None:
    for each in (RELIABLE, QoS(), QoS(depth=3, lease=2.0)):
        assert qos.asked_by(subscribed("a/B/c", toml(each))) == each


def test_a_publisher_that_nothing_hears_is_only_noted() -> None:
    (found,) = findings(facts(NEWS), "unheard")
    assert found.startswith("note world publishes world/Everything/news, and nothing subscribes to it: ")


def test_the_topics_of_an_action_may_have_no_subscriber() -> None:
    action = [end("world", "serves", "world/Arm/go-start"), end("world", "publishes", "world/Arm/go-feedback")]
    assert findings(facts(*action), "unheard") == []


def test_two_processes_of_one_name_are_found_once() -> None:
    more = [replace(each, told=each.told._replace(pid=9)) for each in (WORLD, NEWS)]
    (found,) = findings(facts(WORLD, NEWS, *more), "twice")
    assert found.startswith("error processes 1 and 9 both serve world/Everything/divide: end one of them")


@pytest.mark.parametrize(
    ("computes", "overruns", "expected"),
    [(1000, 4, ""), (10000, 50, ""), (95, 5, "warn"), (50, 50, "error"), (0, 50, "error"), (-5, 5, "error")],
)
def test_a_component_that_takes_longer_than_its_period_is_found(computes: int, overruns: int, expected: str) -> None:
    slow = asked("slow", Measures(period=0.05, computes=computes, overruns=overruns))
    found = findings(facts(components=(slow,)), "overruns")
    assert [each.split()[0] for each in found] == ([expected] if expected else [])


def test_an_overrun_tells_share_and_period() -> None:
    slow = asked("slow", Measures(period=0.05, computes=75, overruns=25))
    assert findings(facts(components=(slow,)), "overruns") == [
        "error slow left out 25% of its periods of 50 ms (25 since its start): "
        "make its compute faster, or its period longer: component.period"
    ]


def test_an_overrun_names_the_handler_that_takes_half_a_period() -> None:
    handler = Measure(port="LaserPub", operation="scanned", verb="subscribesTo", latest=np.array([0.01, 0.5]))
    quick = replace(handler, operation="moved", latest=np.array([0.001]))
    client = replace(handler, verb="requires", latest=np.array([3.0]))
    slow = asked("slow", Measures(period=0.05, computes=75, overruns=25, operations=[quick, handler, client]))
    (found,) = findings(facts(components=(slow,)), "overruns")
    assert ": make its compute and its handler LaserPub_scanned (up to 0.5 s) faster, or its period longer" in found


def test_a_message_that_was_dropped_is_one_of_those_that_came() -> None:
    lossy = Measure(verb="subscribesTo", channel="a/B/c", middleware="near", received=15, dropped=47, lost=3)
    lost, dropped = findings(facts(components=(asked("eye", Measures(operations=[lossy])),)), "losses")
    assert lost.startswith("warn eye: 3 of 65 messages of a/B/c over near were lost: ")
    assert dropped.startswith("warn eye: 47 of 65 messages of a/B/c over near were dropped: ")


def test_lost_messages_and_failed_calls_are_found() -> None:
    measured = Measures(
        operations=[
            Measure(verb="subscribesTo", channel="a/B/c", middleware="near", received=90, lost=10),
            Measure(verb="requires", channel="a/D/e", middleware="near", count=3, failed=3),
            Measure(verb="implements", channel="x/F/g", middleware="near", count=9, failed=1, malformed=2, received=9),
        ]
    )
    given = facts(components=(asked("eye", measured),))
    lost, malformed = findings(given, "losses")
    assert lost.startswith("warn eye: 10 of 100 messages of a/B/c over near were lost: ")
    assert malformed.startswith("warn eye: 2 of 11 messages of x/F/g over near were malformed: ")
    called, answered = findings(given, "failures")
    assert called.startswith("error eye: 3 of 3 calls of a/D/e over near failed: ")
    assert answered.startswith("warn eye: 1 of 9 requests for x/F/g over near failed: ")


def test_a_stopped_process_is_found_and_so_is_one_that_hangs() -> None:
    given = facts(components=(Asked("arm", 7, "T"), Asked("leg", 8, "S"), asked("world")))
    stopped, hanging = findings(given, "silent")
    assert stopped == "error arm does not answer, since its process 7 is stopped: let it go on: kill -CONT 7"
    assert hanging.startswith("error leg (process 8) does not answer: ")


# What is declared.


def test_a_network_that_is_as_it_is_declared_is_fine() -> None:
    assert findings(facts(WORLD, HAND, NEWS, EYE, *THERE, plans=(plan(DIVIDE, HEARD),)), "plan") == []


def test_a_declared_instance_that_is_not_there_is_found() -> None:
    given = facts(WORLD, NEWS, EYE, *(each for each in THERE if each.told.owner != "hand"), plans=(plan(DIVIDE),))
    assert findings(given, "plan")[0] == (
        "error hand is declared to use Everything of world, and is not there: rcdeploy logs house hand"
    )
    (alone,) = findings(facts(*THERE[:2], plans=(plan(),)), "plan")
    assert alone == "error eye is declared in house, and is not there: rcdeploy logs house eye"


def test_an_instance_that_its_user_has_stopped_is_only_noted() -> None:
    stopped = Launched("house", "eye", "ended", "was stopped by the user")
    (alone,) = findings(facts(*THERE[:2], plans=(plan(),), launched=(stopped,)), "plan")
    assert alone == (
        "note eye is declared in house, and was stopped by the user: to start it again: rcdeploy start house eye"
    )


def test_what_cannot_be_seen_from_here_is_not_missed() -> None:
    assert findings(facts(*THERE[:2], plans=(plan(hosts={"eye": "robot"}),)), "plan") == []
    assert findings(facts(*THERE[:2], plans=(plan(HEARD),), tellers={"": frozenset(["far"])}), "plan") == []


def test_a_declared_use_that_is_not_connected_is_found() -> None:
    parts = way("hand", "world", "world/Everything/go", parts=[["-start", "requires"], ["-result", "requires"]])
    ends = [WORLD, NEWS, HAND, *THERE]
    (found,) = findings(facts(*ends, plans=(plan(DIVIDE, HEARD),)), "plan")
    assert found.startswith("error eye is declared to use Everything of world, and is not connected to it: ")
    assert len(findings(facts(*ends, plans=(plan(DIVIDE, parts),)), "plan")) == 1
    started = end("hand", "calls", "world/Everything/go-start", pid=2)
    assert len(findings(facts(*ends, started, plans=(plan(DIVIDE, parts),)), "plan")) == 1
    served = end("world", "serves", "world/Everything/go-start")
    assert findings(facts(*ends, started, served, plans=(plan(DIVIDE, parts),)), "plan") == []


def test_what_is_connected_and_not_declared_is_found() -> None:
    tool = end("rc", "subscribes", "world/Everything/news", pid=9)
    stranger = end("spy", "subscribes", "world/Everything/news", pid=8)
    given = facts(WORLD, HAND, NEWS, EYE, tool, stranger, *THERE, plans=(plan(DIVIDE),))
    assert sorted(each.partition(":")[0] for each in findings(given, "plan")) == [
        "note rc (process 9) uses Everything of world, which house does not declare",
        "warn eye uses Everything of world, which house does not declare",
        "warn spy (process 8) uses Everything of world, which house does not declare",
    ]


@pytest.mark.parametrize("broken", [{}, {"name": 1}, plan() | {"ours": {"world": 3}}, plan({"client": "hand"})])
def test_a_plan_of_another_version_is_told(broken: dict[str, Any]) -> None:
    (found,) = findings(facts(*THERE, plans=(broken,)), "plan")
    assert found.startswith("warn the plan of a network is of another version (")


# Hosts and leftovers.


def on(host: str, offset: float, inaccuracy: float = 0.001) -> Asked:
    return Asked(f"eye_{host}", 1, "", Description(host=host), Measures(), offset, inaccuracy)


@pytest.mark.parametrize(
    ("offset", "inaccuracy", "expected"),
    [(0.05, 0.0, ""), (0.5, 0.6, ""), (0.5, 0.01, "warn"), (-0.5, 0.0, "warn"), (-9.0, 0.01, "error")],
)
def test_the_clock_of_another_host_is_compared(offset: float, inaccuracy: float, expected: str) -> None:
    found = findings(facts(components=(on("robot", offset, inaccuracy),)), "clocks")
    assert [each.split()[0] for each in found] == ([expected] if expected else [])


def test_a_clock_is_judged_by_the_quickest_answer_and_ours_is_not() -> None:
    given = facts(components=(on("robot", 9.0, 5.0), on("robot", 3.25), on("here", 99.0)))
    assert findings(given, "clocks") == [
        "error the clock of robot is 3.25 s ahead: have both hosts follow one time server: timedatectl set-ntp true"
    ]


def test_the_clock_of_a_host_is_judged_by_what_its_scout_tells_too() -> None:
    places = (Place("robot", Machine(), (), 3.0, 0.001),)
    mine = replace(on("my computer", 3.1, 0.2), host="robot")
    (found,) = findings(facts(components=(mine,), places=places), "clocks")
    assert found.startswith("error the clock of robot is 3 s ahead: ")


def test_what_is_wrong_with_another_machine_is_told_with_its_host() -> None:
    poor = Machine((Process(2, 1020, 1024),), memory=Space("/dev/shm", "messages", GB, 0, 0, 0))
    hand = replace(HAND, host="robot")
    given = facts(
        WORLD, replace(HAND, told=HAND.told._replace(owner="mine")), hand, places=(Place("robot", poor, (), 0, 0),)
    )
    assert [
        (name, each.host, each.text.partition(" has ")[0]) for name, each in examine(given, ["files", "memory"])
    ] == [
        ("files", "robot", "hand (process 2)"),
        ("memory", "robot", "/dev/shm"),
    ]


def test_a_stopped_process_of_another_host_is_told_with_its_host() -> None:
    (found,) = [each for _, each in examine(facts(components=(Asked("eye", 7, "T", host="robot"),)), ["silent"])]
    assert (found.host, found.advice) == ("robot", "let it go on: kill -CONT 7")


def test_processes_of_two_hosts_with_one_name_are_two() -> None:
    (found,) = findings(facts(WORLD, replace(WORLD, host="robot")), "twice")
    assert found.startswith("error processes 1 and 1 on robot both serve world/Everything/divide: ")


def test_leftovers_of_killed_processes_are_found() -> None:
    given = facts(left=(Left("near", 2, 3), Left("far", 0, 0, 12), Left("wide", 4, 0)), killed_networks=("rescue",))
    killed, entries, memory = findings(given, "leftovers")
    assert killed.startswith("error the rcdeploy that ran rescue was killed, and its components may still run: ")
    assert entries.startswith("warn killed processes have left 3 entries or sockets of near: ")
    assert memory.startswith("warn killed processes have left 12 files of far in shared memory: ")


def test_processes_that_failed_or_were_started_again_are_found() -> None:
    given = (
        Launched("house", "eye", "failed", "exit code 1", is_wrong=True),
        Launched("house", "hand", "ready", restarts=3),
        Launched("house", "world", "ready"),
    )
    failed, again = findings(facts(launched=given), "processes")
    assert failed == "error eye of house is in the state failed (exit code 1): see why: rcdeploy logs house eye"
    assert again == "warn hand of house was started again 3 times: see why: rcdeploy logs house hand"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("compute raised\nTraceback:\n  File x\nValueError: no\n(and 3 more times)", "compute raised: ValueError: no"),
        ("compute raised Odd\nTraceback:\n  File x\nlib.Odd: no", "compute raised: lib.Odd: no"),
        ("compute raised Odd\nTraceback:\n  File x\nOther: no", "compute raised Odd: Other: no"),
        ("out of range", "out of range"),
        ("", "?"),
        ("x" * 300, "x" * 200 + "…"),
    ],
)
def test_logged_errors_are_told_with_what_was_raised(text: str, shown: str) -> None:
    (found,) = findings(facts(complaints=(Complaints("house", "both", "eye", 2, text),)), "logs")
    assert found == f"error eye has logged 2 errors, the newest: {shown}: rcdeploy logs house both --level error"


# The machine.


@pytest.mark.parametrize(("free", "expected"), [(0, "error"), (7 << 20, "error"), (40 << 20, "warn"), (GB, "")])
def test_full_shared_memory_is_found(free: int, expected: str) -> None:
    memory = Space("/dev/shm", "messages in shared memory", 2 * GB, free, 0, 0)
    found = findings(facts(machine=Machine(memory=memory)), "memory")
    assert [each.split()[0] for each in found] == ([expected] if expected else [])


def test_full_shared_memory_tells_how_to_enlarge_it() -> None:
    memory = Space("/dev/shm", "messages in shared memory", 2 * GB, 0, 0, 0)
    assert findings(facts(machine=Machine(memory=memory)), "memory") == [
        "error /dev/shm has 0 B of 2.15 GB left for messages in shared memory: remove what is not used there, or "
        "enlarge it: sudo mount -o remount,size=4G /dev/shm"
    ]
    missing = findings(facts(machine=Machine(missing_memory="/dev/shm")), "memory")
    assert missing[0].startswith("warn there is no shared memory at /dev/shm")
    assert findings(facts(), "memory") == []


def test_a_full_disk_and_one_without_room_for_files_are_found() -> None:
    full = Space("/run", "sockets", 10 * GB, 0, 1000000, 20)
    space, number = findings(facts(machine=Machine(disks=(full,))), "disk")
    assert space.startswith("error /run has 0 B of 10.7 GB left for sockets: ")
    assert number.startswith("warn /run has room for 20 more files, for sockets: ")


def test_a_small_file_system_that_is_half_empty_is_no_reason() -> None:
    small = Space("/run", "sockets", 16 << 20, 10 << 20, 100, 60)
    assert findings(facts(machine=Machine(disks=(small,))), "disk") == []


def test_used_up_limits_are_found() -> None:
    limits = Machine((Process(2, 1020, 1024), Process(1, 10, 1024), Process(9, 5, 0)), Used(128, 128), Used(950, 1000))
    given = facts(HAND, machine=limits)
    assert findings(given, "files") == [
        "error hand (process 2) has 1020 of at most 1024 files open: start it with a higher limit: ulimit -n 2048"
    ]
    instances, watches = findings(given, "inotify")
    assert instances.startswith("error your processes use 128 of 128 inotify instances;")
    assert watches.endswith("sudo sysctl fs.inotify.max_user_watches=4000")


def test_a_process_without_a_name_is_told_by_its_number() -> None:
    (found,) = files.find(facts(machine=Machine((Process(5, 1024, 1024),))))
    assert found.text.startswith("? (process 5) has")
    assert found.weight is Weight.ERROR


def test_sizes_are_told_with_three_digits() -> None:
    assert [size(each) for each in (0, 999, 1000, 1234567, 5e12, 7e16)] == [
        *("0 B", "999 B", "1 kB", "1.23 MB", "5 TB", "7e+04 TB")
    ]


def test_the_facts_of_a_machine_are_read(tmp_path: Path) -> None:
    process = tmp_path / "7"
    for each in ("fd", "fdinfo"):
        (process / each).mkdir(parents=True)
    (process / "limits").write_text("Limit  Soft Limit  Hard Limit\nMax open files            1024     4096    files\n")
    (process / "fd" / "3").symlink_to("anon_inode:inotify")
    (process / "fd" / "4").symlink_to("/dev/null")
    (process / "fdinfo" / "3").write_text("pos: 0\ninotify wd:1 ino:2\ninotify wd:2 ino:3\n")
    limits = tmp_path / "sys/fs/inotify"
    limits.mkdir(parents=True)
    (limits / "max_user_instances").write_text("128\n")
    full = SimpleNamespace(f_frsize=4096, f_blocks=1000, f_bavail=1, f_files=0, f_favail=0)

    def statvfs(path: Path) -> os.statvfs_result:
        return full  # type: ignore[return-value]  # as far as it is read

    found = machine([7, 8], tmp_path, tmp_path / "shm", statvfs)
    assert found.processes == (Process(7, 2, 1024),)
    assert (found.inotify_instances, found.inotify_watches) == (Used(1, 128), Used(2, 0))
    assert found.memory == Space(str(tmp_path / "shm"), "messages in shared memory", 4096000, 4096, 0, 0)
    assert [finding.weight for _, finding in examine(facts(machine=found), ["memory"])] == [Weight.ERROR]


def test_a_machine_without_these_files_has_no_limits(tmp_path: Path) -> None:
    def statvfs(path: Path) -> os.statvfs_result:
        raise FileNotFoundError(path)

    found = machine([1], tmp_path, tmp_path / "shm", statvfs)
    assert found == Machine(missing_memory=str(tmp_path / "shm"))
    assert machine([1], tmp_path, None, statvfs) == Machine()


# The command.


def said(capsys: pytest.CaptureFixture[str], *arguments: str, code: int) -> list[dict[str, str]]:
    assert rc.main(["doctor", "--json", *arguments]) == code
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_what_runs_is_examined(capsys: pytest.CaptureFixture[str]) -> None:
    with contextlib.ExitStack() as pupil:
        with running(make(Calculator, find_transport, "middleware=shm")):
            pupil.enter_context(running(make(Pupil, find_transport, "middleware=shm")))
        wait_until(lambda: asking.components(take_census(["shm"])) == ["pupil"])
        (finding,) = said(capsys, "--check", "servers", "--middleware", "shm", code=1)
    assert (finding["weight"], finding["check"]) == ("error", "servers")
    assert finding["text"] == "pupil uses Everything, and nothing there provides it"


def test_a_publisher_without_a_subscriber_is_no_fault(capsys: pytest.CaptureFixture[str]) -> None:
    with running(make(Talker, find_transport, "middleware=shm", name="talker")):
        wait_until(lambda: "talker/Everything/news" in take_census(["shm"]).channels)
        (finding,) = said(capsys, "--check", "unheard", "--check", "silent", "--middleware", "shm", code=0)
    assert (finding["weight"], finding["text"]) == (
        "note",
        "talker publishes talker/Everything/news, and nothing subscribes to it",
    )


def test_entries_of_a_killed_process_are_found(capsys: pytest.CaptureFixture[str], own_runtime_folder: Path) -> None:
    ended = subprocess.Popen(["true"])
    ended.wait()
    left = [runtime_dir("zeromq") / f"{ended.pid}-0.{suffix}" for suffix in ("json", "lock")]
    left[0].parent.mkdir(exist_ok=True)
    for each in left:
        each.write_text("{}")
    note = runtime_dir("deploy", "shattered") / "leftovers"
    note.parent.mkdir(parents=True)
    note.touch()
    try:
        found = said(capsys, "--check", "leftovers", "--middleware", "zeromq", code=1)
    finally:
        for each in (*left, note):
            each.unlink(missing_ok=True)
        note.parent.rmdir()
    texts = [each["text"] for each in found]
    assert "the rcdeploy that ran shattered was killed, and its components may still run" in texts
    assert "killed processes have left 1 entry or socket of zeromq" in texts


def test_a_network_that_does_not_run_is_compared_with_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "quiet.cdsl").write_text("Component quiet { Communications { }; language python; };")
    assert rcgen([str(tmp_path / "quiet.cdsl")]) == 0
    path = tmp_path / "still.ddsl"
    path.write_text('import "quiet.cdsl";\nDeployment still { middleware zeromq; Component quiet { }; };\n')
    capsys.readouterr()
    (finding,) = said(capsys, "--check", "plan", str(path), code=1)
    assert finding["text"] == "quiet is declared in still, and is not there"
    assert finding["advice"] == "rcdeploy logs still quiet"


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["--check", "memmory"], 2, "unknown check `memmory`; did you mean `memory`?"),
        (["nowhere.ddsl"], 1, "rc doctor: nowhere.ddsl cannot be read: No such file"),
        (["nowhere"], 1, "rc doctor: network `nowhere` is not running on this machine; give it a DDSL file"),
    ],
)
def test_wrong_arguments_are_explained(
    arguments: list[str], code: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rc.main(["doctor", *arguments]) == code
    assert says in capsys.readouterr().err


def test_the_checks_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc.main(["doctor", "--list"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == [each.NAME for each in CHECKS]
