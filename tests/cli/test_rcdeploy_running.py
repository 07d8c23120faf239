"""A network that goes on without a terminal, and the commands for one that runs."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.deploy.logs import AGENT, Logs
from robocomp_py.deploy.place import Place
from robocomp_py.deploy.ring import Line
from robocomp_py.testing.patience import SOON, wait_until

from ..leftovers import killed_on_failure
from .losing import UNHEARD, run_losing
from .programs import network_of

Said = pytest.CaptureFixture[str]


def run(*arguments: object, **options: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=SOON * 6, **options)  # type: ignore[call-overload, no-any-return]


def is_gone(name: str) -> bool:
    return Place(name).runner() is None


@contextlib.contextmanager
def down_at_the_end(name: str) -> Iterator[None]:
    """A network that has a session of its own is ended whatever happens to the test that started it."""
    try:
        yield
    finally:
        if not is_gone(name):
            run("down", name, "--now")
            wait_until(lambda: is_gone(name))


class Running:
    def __init__(self, path: Path, started: subprocess.CompletedProcess[str]) -> None:
        self.path, self.started = str(path), started
        runner = Place(path.stem).runner()
        self.pid = runner.pid if runner else 0


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A network that was left running: one that prints, and one that is quiet."""
    prints = "echo one; echo two; trap 'echo bye; exit 0' TERM; while true; do sleep 0.05; done"
    path = network_of(tmp_path_factory.mktemp("house"), "house", prints=prints, quiet="exec sleep 600")
    with down_at_the_end("house"):
        yield Running(path, run("up", path, "--detach"))


def test_it_returns_when_everything_is_ready_and_says_how_to_go_on(house: Running) -> None:
    assert house.started.returncode == 0, house.started
    assert "both components of house are ready" in house.started.stdout
    assert f"house is running (process {house.pid}); status: rcdeploy status {house.path}" in house.started.stdout
    assert f"to stop it: rcdeploy down {house.path}" in house.started.stdout


def test_it_has_a_session_of_its_own_and_no_terminal(house: Running) -> None:
    assert os.getsid(house.pid) == house.pid
    streams = [os.readlink(f"/proc/{house.pid}/fd/{number}") for number in range(3)]
    assert streams == [os.devnull, os.devnull, str(Place("house").folder / "rcdeploy.err")]


def test_how_it_is_can_be_seen(house: Running, capsys: Said) -> None:
    for name in (house.path, "house"):
        assert rcdeploy(["status", name]) == 0
        said = capsys.readouterr().out.splitlines()
        assert said[0].startswith("house: 2 components, 2 ready, up ")
        assert [line.split()[:2] for line in said[2:]] == [["prints", "ready"], ["quiet", "ready"]]


def test_how_it_is_can_be_read_by_machines(house: Running, capsys: Said) -> None:
    assert rcdeploy(["status", house.path, "--json"]) == 0
    [line] = capsys.readouterr().out.splitlines()
    found = json.loads(line)
    assert found["network"] == "house"
    assert [(each["name"], each["state"]) for each in found["processes"]] == [("prints", "ready"), ("quiet", "ready")]


def test_all_that_run_are_listed(house: Running, capsys: Said) -> None:
    assert rcdeploy(["status"]) == 0
    assert capsys.readouterr().out.startswith("house: 2 components, 2 ready, up ")


def test_what_was_printed_can_be_read_later(house: Running, capsys: Said) -> None:
    wait_until(lambda: "two" in run("logs", house.path).stdout, SOON * 3)
    assert rcdeploy(["logs", house.path]) == 0
    said = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert [line[13:].strip() for line in said if " prints |" in line] == ["prints | one", "prints | two"]
    assert any(line.endswith(" rcdeploy | both components of house are ready") for line in said)
    assert rcdeploy(["logs", house.path, "prints", "-n", "1"]) == 0
    assert capsys.readouterr().out[13:] == "prints | two\n"
    assert rcdeploy(["logs", house.path, "rcdeploy"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0].endswith("rcdeploy | both components of house are ready")
    assert all(line[13:].startswith("rcdeploy | ") for line in told)  # and what other tests have asked of it


def test_what_an_agent_has_done_can_be_read_and_followed_while_it_runs(house: Running, capsys: Said) -> None:
    (Place("house").logs / f"{AGENT}.log").unlink(missing_ok=True)  # another test may have written it
    assert rcdeploy(["logs", "house", "rc-mcp"]) == 1
    assert "no `rc mcp` has been started for this run of house" in capsys.readouterr().err
    logs = Logs(Place("house").logs)
    logs.write(Line(time.time(), AGENT, "INFO: begins"))
    logs.write(Line(time.time(), AGENT, "WARNING: call: refused"))
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", "logs", "house", "rc-mcp", "-f"]
    with killed_on_failure(command, text=True, stdout=subprocess.PIPE) as following:
        assert following.stdout
        assert [following.stdout.readline().partition(" | ")[2] for _ in range(2)] == [
            "INFO: begins\n",
            "WARNING: call: refused\n",
        ]
        logs.write(Line(time.time(), AGENT, "INFO: ends"))
        assert following.stdout.readline().endswith("rc-mcp | INFO: ends\n")
        following.send_signal(signal.SIGINT)
    assert following.returncode == 130
    assert rcdeploy(["logs", "house", "rc-mcp", "--level", "warning"]) == 0
    assert capsys.readouterr().out.count(" | ") == 1
    assert rcdeploy(["logs", "house", "rc-mcp", "prints", "-n", "4"]) == 0
    assert {each.partition(" | ")[0].split()[-1] for each in capsys.readouterr().out.splitlines()} == {
        "rc-mcp",
        "prints",
    }
    assert rcdeploy(["logs", "house", "rc-mcp", "prints", "-f"]) == 2
    assert "the log of rc-mcp is followed alone; leave out prints" in capsys.readouterr().err
    logs.close()


def test_it_is_not_started_twice(house: Running) -> None:
    for arguments in ([house.path], ["up", "--detach", house.path]):
        again = run(*arguments)
        assert again.returncode == 1
        assert again.stderr.startswith(
            f"rcdeploy: house is already running (process {house.pid}); status: rcdeploy status"
        )
        assert f"to stop it: rcdeploy down {house.path}" in again.stderr
    assert not is_gone("house")


def test_a_plan_says_what_would_change(house: Running, capsys: Said) -> None:
    assert rcdeploy(["plan", house.path]) == 0
    assert capsys.readouterr().out.endswith("house matches the running network\n")
    path = Path(house.path)
    before = path.read_text()
    path.write_text(before.replace("Component quiet", "Component silent"))
    try:
        assert rcdeploy(["plan", house.path]) == 0
        assert "\nhouse differs from the running network:\n- quiet: program\n+ silent: program\n" in (
            capsys.readouterr().out
        )
        assert rcdeploy(["plan", house.path, "--json"]) == 0
        found = json.loads(capsys.readouterr().out)["changes"]
    finally:
        path.write_text(before)
    assert [(each["kind"], each["what"]) for each in found] == [("removed", "quiet"), ("added", "silent")]


def test_an_instance_can_be_started_again(house: Running, capsys: Said) -> None:
    rcdeploy(["status", house.path, "--json"])
    before = json.loads(capsys.readouterr().out)["processes"][1]
    assert rcdeploy(["restart", house.path, "quiet"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "quiet is ready again"
    rcdeploy(["status", house.path, "--json"])
    after = json.loads(capsys.readouterr().out)["processes"][1]
    assert (after["starts"], after["restarts"]) == (before["starts"] + 1, before["restarts"] + 1)


@pytest.mark.parametrize("command", [("logs", "-f"), ("status", "--watch")])
@pytest.mark.parametrize(("name", "code"), [("SIGTERM", 143), ("SIGINT", 130)])
def test_a_command_that_keeps_looking_ends_by_a_signal_whose_exception_was_lost(
    house: Running, command: tuple[str, str], name: str, code: int
) -> None:
    done = run_losing(name, "rcdeploy", f"deploying.{command[0]}", *command, house.path)
    assert (done.returncode, done.stdout) == (code, "")


def test_following_logs_ends_by_an_interrupt_just_before_waiting_for_a_line(house: Running) -> None:
    code = f"{UNHEARD}\nfrom robocomp_py.cli.rcdeploy import main\nsys.exit(main())"
    command = [sys.executable, "-c", code, "logs", "-f", house.path]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as following:
        assert following.stdout is not None
        following.stdout.readline()
        try:
            following.communicate("\n", SOON)
        finally:
            following.terminate()
    assert following.returncode == 130


@pytest.mark.parametrize("name", ["rcdeploy", AGENT])
def test_following_logs_ends_with_the_program_that_reads_them(house: Running, name: str) -> None:
    logs = Logs(Place("house").logs)
    logs.write(Line(time.time(), AGENT, "INFO: begins"))
    logs.close()
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", "logs", "house", name, "-f", "-n", "1"]
    with killed_on_failure(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as following:
        assert following.stdout
        following.stdout.readline()
        following.stdout.close()
        assert following.wait(3 * SOON) == 1
        assert following.stderr
        assert following.stderr.read() == b""


def test_an_unknown_process_cannot_be_restarted(house: Running, capsys: Said) -> None:
    assert rcdeploy(["restart", house.path, "quit"]) == 1
    assert capsys.readouterr().err == "rcdeploy: unknown instance `quit`; did you mean `quiet`?\n"


def processes(network: str, capsys: Said) -> dict[str, dict[str, object]]:
    rcdeploy(["status", network, "--json"])
    return {each["name"]: each for each in json.loads(capsys.readouterr().out)["processes"]}


def test_a_stopped_instance_stays_so_whatever_its_restart_says_until_it_is_started(
    tmp_path: Path, capsys: Said
) -> None:
    path = network_of(tmp_path, "parted", first="exec sleep 600", other="exec sleep 600")
    path.write_text(path.read_text().replace("first {", "first { restart always(delay 0);"))
    with down_at_the_end("parted"):
        assert run("up", path, "--detach").returncode == 0
        assert rcdeploy(["stop", "parted", "first"]) == 0
        assert capsys.readouterr().out.splitlines()[-1] == (
            "first is stopped; to start it again: rcdeploy start parted first"
        )
        found = processes("parted", capsys)
        assert (found["first"]["state"], found["first"]["how"]) == ("ended", "was stopped by the user")
        assert (found["other"]["state"], found["other"]["starts"]) == ("ready", 1)
        assert rcdeploy(["status", "parted"]) == 0
        assert "was stopped by the user" in capsys.readouterr().out
        assert rcdeploy(["stop", "parted", "first"]) == 0
        assert capsys.readouterr().out == "first had ended before\n"
        assert rcdeploy(["stop", "parted", "other"]) == 1
        assert "would end with that: to stop all of it, use rcdeploy down" in capsys.readouterr().err
        assert rcdeploy(["start", "parted", "first", "other"]) == 0
        said = capsys.readouterr().out.splitlines()
        assert (said[0], said[-1]) == ("other runs already", "first is ready")
        assert [each["state"] for each in processes("parted", capsys).values()] == ["ready", "ready"]


@pytest.mark.parametrize("command", ["stop", "start"])
def test_a_misspelt_instance_is_proposed_and_nothing_is_done(house: Running, capsys: Said, command: str) -> None:
    assert rcdeploy([command, house.path, "quit"]) == 1
    assert capsys.readouterr().err == "rcdeploy: unknown instance `quit`; did you mean `quiet`?\n"
    assert processes(house.path, capsys)["quiet"]["state"] == "ready"


def test_following_logs_shows_output_until_the_end_and_down_waits_for_it(tmp_path: Path) -> None:
    path = network_of(
        tmp_path, "brief", prints="trap 'echo bye; exit 0' TERM; echo one; while true; do sleep 0.05; done"
    )
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", "logs", "-f", str(path)]
    with contextlib.ExitStack() as ends:
        ends.enter_context(down_at_the_end("brief"))
        assert run("up", "--detach", path).returncode == 0
        following = ends.enter_context(killed_on_failure(command, stdout=subprocess.PIPE, text=True))
        assert following.stdout is not None
        heard = [following.stdout.readline()]
        while "prints | one" not in heard[-1]:
            assert heard[-1]
            heard.append(following.stdout.readline())
        down = run("down", path)
        assert (down.returncode, down.stdout.splitlines()[-1], down.stderr) == (0, "brief is down", "")
        assert is_gone("brief")
        rest = following.stdout.read()
        assert following.wait(SOON) == 0
    assert "rcdeploy | stopping: requested by rcdeploy down\n" in rest
    assert "prints | bye\n" in rest
    end = rest[rest.index("rcdeploy | stop") - len("12:34:56.789 ") :]  # sh may have something to say, too
    past = run("logs", path, "-n", end.count("\n"))
    assert (past.returncode, past.stdout) == (0, end)
    assert past.stderr == f"brief is not running; these are the logs of its last run, from {Place('brief').logs}\n"


def test_the_newest_run_is_shown_with_times_wherever_it_kept_its_output(tmp_path: Path) -> None:
    path = network_of(tmp_path, "twice", laser="echo first")
    assert run("up", path).returncode == 0
    (tmp_path / "laser.sh").write_text("#!/bin/sh\necho second\n")
    assert run("up", path, "--log-dir", "elsewhere", cwd=tmp_path).returncode == 0
    shown = run("logs", path, "laser", "-n", "9")
    assert re.fullmatch(r"\d\d:\d\d:\d\d\.\d{3} laser \| second\n", shown.stdout), shown
    assert shown.stderr.endswith(f"these are the logs of its last run, from {tmp_path / 'elsewhere'}\n")
    assert run("up", path).returncode == 0
    assert run("logs", path, "laser").stdout.count("\n") == 1  # and not what the first run printed into the same file
    misspelt = run("logs", path, "lasser")
    assert (misspelt.returncode, misspelt.stdout) == (1, "")
    assert "has no logs of lasser;" in misspelt.stderr
    assert misspelt.stderr.endswith("it has logs of: laser, rcdeploy\n")


def test_a_network_that_cannot_start_is_reported_at_the_terminal(tmp_path: Path) -> None:
    path = network_of(tmp_path, "broken", fine="exec sleep 600", broken="")
    (tmp_path / "broken.sh").write_text("#!/no/such/interpreter\n")
    failed = run("up", "--detach", path)
    assert failed.returncode == 1
    assert "broken.sh cannot be started: No such file or directory" in failed.stdout
    assert is_gone("broken")


def test_a_network_that_is_stopped_before_it_is_up_does_not_count_as_running(tmp_path: Path) -> None:
    path = network_of(tmp_path, "early", fine="exec sleep 600", broken="")
    (tmp_path / "broken.sh").write_text("#!/no/such/interpreter\n")
    path.write_text(path.read_text().replace("early {", "early { restart always(delay 600, max_delay 600);"))
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", "up", "--detach", str(path)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with down_at_the_end("early"), killed_on_failure(command, **pipes) as starting:
        assert starting.stdout is not None
        while "started again in" not in starting.stdout.readline():
            assert starting.poll() is None
        assert run("down", path).returncode == 0
        _, complaint = starting.communicate(timeout=SOON)
    assert complaint == "rcdeploy: early ended before everything was ready\n"
    assert starting.returncode == 1


def test_an_empty_network_does_not_go_on(tmp_path: Path) -> None:
    path = network_of(tmp_path, "deserted")
    assert run("up", path).returncode == 0
    detached = run("up", "--detach", path)
    assert detached.returncode == 1
    assert detached.stderr.endswith("rcdeploy: deserted has no components to leave running\n")


def test_errors_of_a_network_are_reported_at_the_terminal(tmp_path: Path) -> None:
    path = network_of(tmp_path, "wrong", fine="exec sleep 600")
    path.write_text(path.read_text().replace(": program", ": progam"))
    failed = run("up", "--detach", path)
    assert failed.returncode == 1
    assert "error[unknown-component]" in failed.stderr


def test_what_does_not_run_cannot_be_asked_and_it_is_said_how_to_start_it(tmp_path: Path, capsys: Said) -> None:
    path = network_of(tmp_path, "idle", quiet="exec sleep 600")
    for arguments in (["status"], ["logs"], ["down"], ["restart"], ["stop"], ["start"]):
        more = ["quiet"] if arguments[0] in ("restart", "stop", "start") else []
        assert rcdeploy([*arguments, str(path), *more]) == 1
        said = capsys.readouterr().err
        assert said.startswith("rcdeploy: network `idle` is not running on this machine; ")
        assert said.endswith(f"; start it: rcdeploy {path}\n")  # other networks may be named between


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["status", "--watch"], "--watch needs a network"),
        (["restart", "net.ddsl"], "INSTANCE is missing"),
        (["stop", "net.ddsl"], "which INSTANCE of `net.ddsl`? To stop the whole network: rcdeploy down net.ddsl"),
        (["start", "net.ddsl"], "which INSTANCE of `net.ddsl`? To start the network: rcdeploy net.ddsl"),
        (["logs"], "NET.ddsl is missing"),
        (["logs", "net.ddsl", "-n", "many"], "`many` is not a number of lines from 0 to 10000"),
        (["down", "net.ddsl", "--grace", "long"], "`long` is not a number of seconds"),
        (["status", "net.ddsl", "--detach"], "--detach is for `rcdeploy up`, not for `rcdeploy status`"),
    ],
)
def test_wrong_usage_exits_with_2(arguments: list[str], says: str, capsys: Said) -> None:
    try:
        code: object = rcdeploy(arguments)
    except SystemExit as exc:
        code = exc.code
    assert (code, says in (said := capsys.readouterr().err)) == (2, True), said


@pytest.mark.parametrize(
    "command", ["up", "plan", "status", "logs", "restart", "stop", "start", "down", "export", "keys", "trust"]
)
def test_the_help_of_every_command_teaches_by_examples(command: str, capsys: Said) -> None:
    with pytest.raises(SystemExit) as left:
        rcdeploy([command, "--help"])
    assert left.value.code == 0
    said = capsys.readouterr().out
    assert f"\n  rcdeploy {command} " in said
    assert "exit status:" in said.lower()


def test_a_network_may_be_called_like_a_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = network_of(tmp_path, "status", brief="echo done")
    path.rename(tmp_path / "status")
    done = run("./status", cwd=tmp_path)
    assert (done.returncode, "brief │ done" in done.stdout) == (0, True), done
