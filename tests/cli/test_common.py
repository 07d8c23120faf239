"""Shared by the commands: how they end when they are interrupted, or when their output is closed."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from robocomp_py.cli.common import command, print_table
from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcgen import main as rcgen

from ..leftovers import killed_on_failure

COMMANDS = {"rc": ["robocomp_py.cli.rc", "lint", "--json"], "rcgen": ["robocomp_py.cli.rcgen", "--check"]}
PROGRAMS = pytest.mark.parametrize("program", COMMANDS)
SIGNALS = pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])


def started(program: str, path: Path, **streams: int) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-m", *COMMANDS[program], str(path)], text=True, **streams)


@PROGRAMS
def test_a_closed_pipe_causes_no_traceback(program: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.cdsl"
    path.write_text(f"Component arm {{ language {'Cpp' if program == 'rc' else 'python'}; }};")
    reading, writing = os.pipe()
    os.close(reading)
    with started(program, path, stdout=writing, stderr=subprocess.PIPE) as running:
        os.close(writing)
        _, said = running.communicate()
    assert (running.returncode, said) == (1, "")


@PROGRAMS
def test_an_output_that_is_full_is_said(program: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.cdsl"
    path.write_text(f"Component arm {{ language {'Cpp' if program == 'rc' else 'python'}; }};")
    with (
        open("/dev/full", "w") as full,
        started(program, path, stdout=full.fileno(), stderr=subprocess.PIPE) as running,
    ):
        _, said = running.communicate()
    assert (running.returncode, said) == (1, "cannot write the output: No space left on device\n")


@PROGRAMS
def test_an_output_that_is_closed_is_no_reason_for_a_traceback(program: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.cdsl"
    path.write_text("Component arm { language python; };")
    command = shlex.join([sys.executable, "-m", *COMMANDS[program], str(path)])
    done = subprocess.run(f"{command} >&-", shell=True, stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (program == "rcgen", "")


def test_a_name_that_is_no_text_can_be_printed(tmp_path: Path) -> None:
    path = os.fsdecode(os.path.join(os.fsencode(tmp_path), b"arm\xff.cdsl"))
    Path(path).write_text("Component arm{language python;};")
    command = [sys.executable, "-m", "robocomp_py.cli.rc", "fmt", path]
    done = subprocess.run(command, capture_output=True, env={**os.environ, "PYTHONUTF8": "1"})
    assert (done.returncode, done.stdout, done.stderr) == (0, f"formatted: {tmp_path}/arm?.cdsl\n".encode(), b"")


WAITING = """
import time
from robocomp_py.cli.common import command

@command
def main(arguments=None):
    print("there", flush=True)
    while True:
        time.sleep(0.1)  # an endless wait would miss a signal that comes just before it begins

raise SystemExit(main())
"""


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 128 + signal.SIGTERM), (signal.SIGHUP, 129)]
)
def test_a_signal_ends_a_command_without_a_traceback(number: signal.Signals, code: int) -> None:
    command = [sys.executable, "-c", WAITING]
    with killed_on_failure(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == "there\n"
        running.send_signal(number)
        said = running.communicate()
    assert (running.returncode, said) == (code, ("", ""))


INTERRUPTED_IMPORT = """
import signal, sys
from robocomp_py.cli import entry

signal.signal(signal.SIGINT, signal.default_int_handler)  # a process in the background begins with it ignored

class Finder:
    def find_spec(name, path, target=None):
        if name == "robocomp_py.cli.{name}":
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Finder)
raise SystemExit(entry.{name}())
"""


@pytest.mark.parametrize("name", ["rc", "rcdeploy", "rcgen"])
def test_ctrl_c_ends_a_command_quietly_while_it_is_imported(name: str) -> None:
    command = [sys.executable, "-c", INTERRUPTED_IMPORT.format(name=name)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "")


def test_what_cleans_up_is_not_ended_by_another_signal() -> None:
    cleaned = []

    @command
    def main(arguments: Sequence[str] | None = None) -> int:
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            signal.raise_signal(signal.SIGTERM)
            cleaned.append(True)
        return 0

    assert (main(), cleaned) == (143, [True])
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_a_signal_that_is_ignored_or_taken_care_of_stays_so() -> None:
    received = []

    @command
    def main(arguments: Sequence[str] | None = None) -> int:
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGHUP)
        return 0

    before = signal.signal(signal.SIGTERM, lambda *_: received.append("SIGTERM"))
    hangup = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as `nohup` does
    try:
        assert (main(), received) == (0, ["SIGTERM"])
    finally:
        signal.signal(signal.SIGTERM, before)
        signal.signal(signal.SIGHUP, hangup)


@pytest.mark.parametrize("program", [*COMMANDS, "rcdeploy"])
def test_a_working_directory_that_is_gone_is_said(program: str, tmp_path: Path) -> None:
    module = f"robocomp_py.cli.{program}"
    gone = f"import os; os.rmdir(os.getcwd()); from {module} import main; raise SystemExit(main(['arm.cdsl']))"
    done = subprocess.run([sys.executable, "-P", "-c", gone], cwd=tmp_path, capture_output=True, text=True)
    assert done.stderr == "the working directory no longer exists; change to another one\n"
    assert (done.returncode, done.stdout) == (1, "")


def test_a_folder_for_imports_that_is_not_there_is_warned_about(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "arm.cdsl"
    path.write_text("Component arm { language python; };")
    for main, arguments in ((rc, ["lint"]), (rcgen, ["--check"])):
        main([*arguments, "-I", str(tmp_path / "nowhere"), "-I", str(tmp_path), str(path)])
        assert capfd.readouterr().err.endswith(f"warning: -I {tmp_path}/nowhere: there is no such folder\n")
    assert rc(["call", "mill/Workshop/divide", "-I", str(tmp_path / "nowhere"), "--timeout", "0.1"]) != 0
    assert f"rc call: warning: -I {tmp_path}/nowhere: there is no such folder\n" in capfd.readouterr().err


def test_a_command_is_a_function_of_its_arguments_to_its_exit_code() -> None:
    @command
    def main(arguments: Sequence[str] | None = None) -> int:
        """What it does."""
        return len(arguments or ())

    assert (main(["a", "b"]), main()) == (2, 0)
    assert main.__doc__ == "What it does."


LOST = """
import signal
from robocomp_py.cli.common import command, raise_if_signalled, signalled

class Last:
    def __del__(self):
        signal.raise_signal(signal.{name})

@command
def main(arguments=None):
    Last()
    print(signalled(), flush=True)
    raise_if_signalled()
    print("nothing has come of it")

raise SystemExit(main())
"""
"""What a signal raises is ignored by Python in a destructor, say."""


@SIGNALS
def test_a_signal_whose_exception_was_lost_still_ends_a_command(name: str, code: int) -> None:
    done = subprocess.run([sys.executable, "-c", LOST.format(name=name)], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (code, f"{getattr(signal, name):d}\n")


WITHIN = """
import signal
from robocomp_py.cli.common import command

CODE = "signal.raise_signal(signal.{name})"

class Named:
    def __set_name__(self, owner, name):
        exec(CODE)

@command
def main(arguments=None):
    {doing}

raise SystemExit(main())
"""


@pytest.mark.parametrize("doing", ["exec(CODE)", "type('Owner', (), {'it': Named()})"])
@SIGNALS
def test_a_signal_while_a_class_is_made_ends_a_command_as_any_other_time(name: str, code: int, doing: str) -> None:
    """Python remembers a KeyboardInterrupt in an `exec`, as of a dataclass; 3.11 hides what a `__set_name__` raises."""
    script = WITHIN.format(name=name, doing=doing)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "")


def test_a_table_of_plain_text_is_the_same_with_and_without_wrapping(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [("world", "1"), ("a longer name", "")]
    print_table(("name", "number"), rows)
    plain = capsys.readouterr().out
    assert plain == "name           number\nworld          1\na longer name\n"
    print_table(("name", "number"), [*rows, ("…", "2")])
    assert capsys.readouterr().out == f"{plain}…              2\n"


def test_a_narrow_terminal_cuts_no_name(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setenv("FORCE_COLOR", "1")  # it counts as a terminal
    row = ("world/DifferentialRobotPub/pushBaseState", "zeromq – shm")
    print_table(("channel", "over"), [row], wrapped=("channel",))
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= 40
    assert sorted("".join(shown.split())) == sorted("".join(("channel", "over", *row)).replace(" ", ""))


@pytest.mark.parametrize("columns", [40, 60, 80])
def test_a_narrow_terminal_leaves_out_no_column_and_breaks_no_word(
    columns: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    head = ("component", "process", "over", "offers", "uses")
    row = ("wander – 2", "17680", "shm, zeromq", "GotoPoint, Laser", "DifferentialRobot of world, LaserPub of world")
    print_table(head, [row], wrapped=("offers", "uses"))
    assert sorted(capsys.readouterr().out.split()) == sorted(" ".join((*head, *row)).split())
