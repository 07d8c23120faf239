"""`rc action` against a component that runs."""

from __future__ import annotations

import io
import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from robocomp_py.cli import rc
from robocomp_py.cli.candidates import answered
from robocomp_py.contract.goal import GoalState
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.actions import goals
from robocomp_py.tools.census import take_census

from ..client.pilot import flying
from .commands import complained, said


@pytest.fixture(scope="module", autouse=True)
def pilot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with flying(tmp_path_factory.mktemp("actions")):
        wait_until(lambda: "pilot/Pilot/fly-start" in take_census(["shm"]).channels)
        yield


def test_actions_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    (line,) = said(capsys, "action", "list", "--json").splitlines()
    assert json.loads(line) == {
        "action": "pilot/Pilot/fly",
        "middlewares": ["shm"],
        "providers": ["pilot"],
        "users": [],
    }
    assert re.search(r"pilot/Pilot/fly +shm +pilot", said(capsys, "action", "list"))
    assert "no action is offered" in complained(capsys, "action", "list", "--middleware", "zeromq")


def test_a_goal_is_sent_and_its_feedback_and_result_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    lines = said(capsys, "action", "send", "fly", "target.x=1", "target.y=2", "steps=30").splitlines()
    assert re.fullmatch(r"goal [0-9a-f]{8} of pilot/Pilot/fly: accepted", lines[0])
    assert lines[-1] == "SUCCEEDED 30"
    assert re.fullmatch(r'feedback {"left": \d+}', lines[-2])
    told = [json.loads(each) for each in said(capsys, "action", "send", "fly", "--json", SENT).splitlines()]
    assert told[-1] == {"status": "SUCCEEDED", "result": 3}
    assert len(told[0]["goal"]) == 32


SENT = '{"target": {"x": 1, "y": 2}, "steps": 3}'


def test_an_exception_of_the_interface_is_printed_with_its_fields(capsys: pytest.CaptureFixture[str]) -> None:
    wrong = complained(capsys, "action", "send", "fly", "target.x=-1", "target.y=2", "steps=30")
    assert wrong == 'rc action send: RoboCompPilot.Blocked: {"by": "a bird"}\n'


def test_types_and_goals_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    said(capsys, "action", "send", "fly", SENT)
    shown = said(capsys, "action", "info", "fly")
    assert "[action] int32 fly(Place target, int32 steps) feedback(int32 left) throws Blocked;" in shown
    assert re.search(r"goal [0-9a-f]{32}: SUCCEEDED", shown)
    assert "served by pilot (process" in shown


@pytest.mark.parametrize("name", ["fly", "Pilot/fly", "pilot"])
def test_rc_info_shows_an_action_as_one_operation(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    shown = said(capsys, "info", name)
    assert shown.startswith("pilot/Pilot/fly: action\n  [action] int32 fly(Place target, int32 steps) feedback(")
    assert "served by pilot (process" in shown
    assert "fly-start" not in shown
    assert json.loads(said(capsys, "info", name, "--json").splitlines()[0])["action"] == "pilot/Pilot/fly"


def test_a_part_of_an_action_is_shown_if_it_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert said(capsys, "info", "fly-status").startswith("pilot/Pilot/fly-status: publish\n")


@pytest.mark.parametrize("command", [("call", "fly"), ("call", "pilot/Pilot/fly"), ("echo", "fly", "--timeout", "0.1")])
def test_commands_for_other_operations_tell_that_it_is_an_action(
    command: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    told = f"`{command[1]}` is an action; `rc action` begins, shows and cancels its goals"
    assert told in complained(capsys, *command)


def test_a_detached_goal_goes_on_and_can_be_cancelled(capsys: pytest.CaptureFixture[str]) -> None:
    began = said(capsys, "action", "send", "fly", "target.x=1", "target.y=2", "steps=100000", "--detach")
    goal = began.split()[1]
    assert "no goal ffff" in complained(capsys, "action", "cancel", "fly", "ffffffffff")
    wait_until(lambda: "EXECUTING" in said(capsys, "action", "info", "fly"))
    goals = json.loads(said(capsys, "action", "info", "fly", "--json"))["goals"]
    assert [state for name, state in goals.items() if name.startswith(goal)] == ["EXECUTING"]
    assert re.match(rf"fly {goal}: CANCEL", said(capsys, "action", "cancel", "fly", goal))
    wait_until(lambda: "EXECUTING" not in said(capsys, "action", "info", "fly"))
    assert f"goal {goal} of pilot/Pilot/fly is over: CANCELED" in complained(capsys, "action", "cancel", "fly", goal)
    assert "has no goal that could be cancelled" in complained(capsys, "action", "cancel", "fly")


def test_a_goal_that_takes_too_long_is_cancelled(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc.main(["action", "send", "fly", "target.x=1", "target.y=2", "steps=100000", "--for", "0.1"]) == 1
    printed = capsys.readouterr()
    assert printed.out.splitlines()[-1] == "CANCELED"
    assert "not over in 0.1 s; cancelling the goal" in printed.err


def test_each_message_of_feedback_is_written_whole_since_more_follows_after_ctrl_c(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pieces = list[str]()

    class Written(io.StringIO):
        def write(self, text: str) -> int:
            pieces.append(text)
            return len(text)

    monkeypatch.setattr(sys, "stdout", Written())
    assert rc.main(["action", "send", "fly", "target.x=1", "target.y=2", "steps=3"]) == 0
    told = [each for each in pieces if each.startswith("feedback")]
    assert told
    assert all(each.endswith("\n") for each in told)


def test_ctrl_c_cancels_the_goal(capsys: pytest.CaptureFixture[str]) -> None:
    command = [sys.executable, "-m", "robocomp_py.cli.rc", "action", "send", "fly", SENT.replace("3}", "100000}")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as sending:
        assert sending.stdout
        try:
            wait_until(lambda: sending.stdout and "feedback" in sending.stdout.readline())
            sending.send_signal(signal.SIGINT)
            out, err = sending.communicate(timeout=SOON)
        finally:
            sending.kill()
    assert sending.returncode == 130
    assert "cancelling the goal" in err
    assert out.splitlines()[-1] == "CANCELED"


@pytest.mark.parametrize(
    ("arguments", "code", "why"),
    [
        (("send", "fyl", "--timeout", "0.1"), 1, "no action `fyl` is offered now; did you mean `fly`?"),
        (("info", "elephant", "--timeout", "0.1"), 1, "`rc action list` shows all"),
        (("info", "pilot/CommonBehavior/getState"), 1, "getState is a query; `rc call` calls it"),
        (("send", "fly", "steps=1"), 1, "fly: lacks `target`"),
        (("send", "fly", "{"), 2, "is no JSON"),
        (("send", "fly", "target=1", "steps=1"), 1, "fly.target: the number 1 is given"),
        (("list", "--middleware", "shn"), 2, "unknown middleware `shn`; did you mean `shm`?"),
    ],
)
def test_what_is_wrong_is_told(
    arguments: tuple[str, ...], code: int, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert why in complained(capsys, "action", *arguments, code=code)


def test_fields_of_a_goal_are_completed() -> None:
    def completed(line: str) -> list[str]:
        return answered(rc.completer, [line], "bash")

    assert completed("rc action send fly ") == ["target.x=", "target.y=", "steps="]
    assert completed("rc action send pilot/Pilot/fly steps=3 target.") == ["target.x=", "target.y="]
    assert completed("rc action send swim ") == []


def test_a_goal_without_arguments_shows_what_it_takes(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc.main(["action", "send", "fly"]) == 2
    shown = capsys.readouterr()
    assert json.loads(shown.out) == {"target": {"x": 0.0, "y": 0.0}, "steps": 0}
    assert shown.err.splitlines() == [
        "pilot/Pilot/fly takes arguments; fill in:",
        "  Fly straight to a place.",
        "  Place: in m",
    ]


def test_states_that_nobody_knows_are_left_out() -> None:
    octets = b"a" * 16 + b"b" * 16 + b"c" * 5
    assert goals(octets, bytes([2, 99, 2])) == {b"a" * 16: GoalState.EXECUTING}
