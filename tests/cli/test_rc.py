"""`rc lint` and `rc run` as people use them."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.contract.component import Component
from robocomp_py.runtime.commandline import parser_of, read_plain

from ..codegen.generated import model_in, snapshot
from ..leftovers import killed_on_failure

Said = pytest.CaptureFixture[str]

RIGHT = {
    "Arm.idsl": "module RoboCompArm { interface Arm { void move(float to); }; };",
    "arm.cdsl": 'import "Arm.idsl"; Component arm { Communications { implements Arm; }; language python; };',
    "arm.pdsl": "ComponentParams arm { speed float 0.5 0:2; };",
    "net.ddsl": 'import "arm.cdsl"; Deployment net { Component arm { }; };',
}
WRONG = {
    "Arm.idsl": (
        "module Arm {\n struct P { flaot x; };\n struct P { int x; int x; };\n};",
        "unknown-type duplicate duplicate",
    ),
    "arm.cdsl": (
        "Component arm {\n period 5;\n Communications { requires Lasr; };\n};",
        "no-language bad-period unknown-interface",
    ),
    "arm.pdsl": ("ComponentParams arm {\n speed float 5 0:2;\n mode enum a { b };\n};", "bad-default bad-default"),
    "net.ddsl": (
        "Deployment net {\n Component arm { };\n Component leg { port 1; port 2; };\n};",
        "unknown-component unknown-component duplicate",
    ),
}
KEYS = ["file", "line", "column", "end_line", "end_column", "severity", "code", "message", "hint"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the commands run; a file of each language is there, and all are right."""
    for name, text in RIGHT.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


# Checking.


@pytest.mark.parametrize("file", RIGHT)
def test_a_right_file_is_fine(folder: Path, capsys: Said, file: str) -> None:
    before = snapshot(folder)
    assert rc(["lint", file]) == 0
    assert rc(["lint", "--json", file]) == 0
    assert capsys.readouterr() == ("", "")
    assert snapshot(folder) == before


@pytest.mark.parametrize("file", WRONG)
def test_all_that_is_wrong_with_a_file_is_shown_in_order(folder: Path, capsys: Said, file: str) -> None:
    text, codes = WRONG[file]
    (folder / file).write_text(text)
    assert rc(["lint", file]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    found = re.findall(rf"^{file}:(\d+):(\d+): (?:error|warning)\[(.+?)\]: ", said.err, re.MULTILINE)
    assert sorted(code for _, _, code in found) == sorted(codes.split())
    places = [(int(line), int(column)) for line, column, _ in found]
    assert places == sorted(places)


@pytest.mark.parametrize("file", WRONG)
def test_machines_get_a_line_of_json_for_each(folder: Path, capsys: Said, file: str) -> None:
    text, codes = WRONG[file]
    (folder / file).write_text(text)
    assert rc(["lint", "--json", file]) == 1
    said = capsys.readouterr()
    assert said.err == ""
    found = [json.loads(line) for line in said.out.splitlines()]
    assert [list(each) for each in found] == [KEYS] * len(codes.split())
    assert sorted(each["code"] for each in found) == sorted(codes.split())
    for each in found:
        assert each["file"] == file
        assert each["severity"] in ("error", "warning")
        assert (each["line"], each["column"]) <= (each["end_line"], each["end_column"])


def test_several_files_are_checked_together(folder: Path, capsys: Said) -> None:
    for file, (text, _) in WRONG.items():
        (folder / file).write_text(text)
    assert rc(["lint", "--json", *WRONG]) == 1
    found = [json.loads(line)["file"] for line in capsys.readouterr().out.splitlines()]
    assert set(found) == set(WRONG)
    assert found == sorted(found)


def test_warnings_alone_are_fine(folder: Path, capsys: Said) -> None:
    (folder / "arm.cdsl").write_text("Component arm { language Cpp; };")
    assert rc(["lint", "arm.cdsl"]) == 0
    assert "warning[not-python]" in capsys.readouterr().err


def test_imports_are_found_in_the_folders_that_are_given(folder: Path, capsys: Said) -> None:
    (folder / "far").mkdir()
    (folder / "Arm.idsl").rename(folder / "far" / "Arm.idsl")
    assert rc(["lint", "arm.cdsl"]) == 1
    assert "missing-import" in capsys.readouterr().err
    assert rc(["lint", "-I", "far", "arm.cdsl"]) == 0


@pytest.mark.parametrize("file", ["missing.idsl", "machine.txt"])
def test_what_cannot_be_checked_is_wrong(folder: Path, capsys: Said, file: str) -> None:
    assert rc(["lint", file, "Arm.idsl"]) == 1
    assert len(re.findall(r": error\[", capsys.readouterr().err)) == 1


# Running.

SELF_STOPPING = """
from pathlib import Path

from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def initialize(self) -> None:
        Path(__file__).with_name("said").write_text(f"{self.period} {self.log.name}")
        self.stop()
"""


@pytest.fixture
def arm(tmp_path: Path, capsys: Said, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A component that says how it was configured, then stops."""
    cdsl = model_in(tmp_path / "arm", arm_cdsl="Component arm { language python; };")
    assert rcgen([str(cdsl), "--middleware", "inproc"]) == 0
    (cdsl.parent / "specificworker.py").write_text(SELF_STOPPING)
    monkeypatch.chdir(tmp_path)
    capsys.readouterr()
    return cdsl.parent


def said_by(component: Path) -> str:
    return (component / "said").read_text()


def test_a_component_is_run_until_it_ends(arm: Path) -> None:
    assert rc(["run", "arm"]) == 0
    assert said_by(arm) == "0.1 arm"


def edited(component: Path, later: float) -> None:
    """Change an imported interface in another folder, `later` seconds after the code was generated."""
    made = (component / "generic" / "genericworker.py").stat().st_mtime
    interface = component.parent / "idsl" / "Arm.idsl"
    interface.write_text("module RoboCompArm { interface Arm { void move(float to, float speed); }; };")
    os.utime(interface, (made + later, made + later))


@pytest.fixture
def using(arm: Path, capsys: Said) -> Path:
    """The same component, which uses an interface."""
    (arm.parent / "idsl").mkdir()
    (arm.parent / "idsl" / "Arm.idsl").write_text(RIGHT["Arm.idsl"])
    text = 'import "../idsl/Arm.idsl"; Component arm { Communications { publishes Arm; }; language python; };'
    (arm / "arm.cdsl").write_text(text)
    assert rcgen([str(arm / "arm.cdsl")]) == 0
    capsys.readouterr()
    return arm


OUTDATED = """\
arm/arm.cdsl:1:38: warning[out-of-date]: `arm` is not generated from its models as they are now
  out of date: arm/generic/RoboCompArm.py
    import "../idsl/Arm.idsl"; Component arm { Communications { publishes Arm; }; language python; };
                                         ^^^
    run: rcgen arm/arm.cdsl
"""


@pytest.mark.parametrize("arguments", [["arm"], ["arm/arm.cdsl"], ["arm", "--name=left"]], ids=" ".join)
def test_old_generated_code_is_told_when_a_component_is_run(using: Path, capsys: Said, arguments: list[str]) -> None:
    edited(using, later=5.0)
    assert rc(["run", *arguments]) == 0
    assert OUTDATED in capsys.readouterr().err
    assert rcgen(["arm/arm.cdsl"]) == 0
    capsys.readouterr()
    assert rc(["run", *arguments]) == 0
    assert "out-of-date" not in capsys.readouterr().err


def test_a_launcher_has_compared_generated_code_before(
    using: Path, capsys: Said, monkeypatch: pytest.MonkeyPatch
) -> None:
    edited(using, later=5.0)
    monkeypatch.setenv("ROBOCOMP_READY_FILE", str(using.parent / "ready"))
    assert rc(["run", "arm"]) == 0
    assert "out-of-date" not in capsys.readouterr().err


def test_old_generated_code_is_a_warning_of_lint(using: Path, capsys: Said) -> None:
    assert rc(["lint", "."]) == 0
    assert capsys.readouterr().err == ""
    edited(using, later=-5.0)  # times do not matter here
    (using.parent / "net.ddsl").write_text(
        'import "arm/arm.cdsl"; Deployment net { Component arm { middleware zeromq; }; };'
    )
    for checked in (".", "net.ddsl"):
        assert rc(["lint", checked]) == 0
        assert capsys.readouterr().err == OUTDATED + "1 warning in 1 file\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ["arm", "--set", "component.period=0.5", "--name", "left"],
        ["--set", "component.period=0.5", "--name", "left", "arm"],
        ["--name=left", "arm", "--set=component.period=0.5"],
        ["--set", "component.period=2", "--set", "component.period=0.5", "arm", "--name", "left"],
        ["--config", "left.toml", "--name", "left", "arm"],
        ["arm", "--config", "left.toml", "--name", "left"],
    ],
    ids=" ".join,
)
def test_options_may_stand_before_and_behind_the_folder(arm: Path, arguments: list[str]) -> None:
    (arm.parent / "left.toml").write_text("[component]\nperiod = 0.5\n")
    assert rc(["run", *arguments]) == 0
    assert said_by(arm) == "0.5 left"


PLAIN = [
    ["--name", "left", "--set", "component.period=0.5", "--set", "params.x=1", "--middleware", "zeromq"],
    ["--config", "some/file.toml", "--keys", "keys", "--name", "a", "--name", "b"],
    [],
]
OTHERWISE = [
    ["--name"],
    ["--name=left", "--set=a=b"],
    ["--name", "--json"],
    ["--set", "nothing"],
    ["--print-config", "--json"],
    ["--help"],
    ["+", "folder"],
    ["--nam", "left"],
]


@pytest.mark.parametrize("arguments", PLAIN, ids=lambda arguments: " ".join(arguments) or "none")
def test_what_is_read_without_a_parser_is_what_the_parser_reads(arguments: list[str]) -> None:
    assert read_plain(arguments) == parser_of(Component("it")).parse_args(arguments)


@pytest.mark.parametrize("arguments", OTHERWISE, ids=" ".join)
def test_whatever_else_there_may_be_is_left_to_the_parser(arguments: list[str]) -> None:
    assert read_plain(arguments) is None


def test_every_option_of_a_component_that_takes_a_value_is_known_to_rc(arm: Path, capsys: Said) -> None:
    """Else its value, standing before the folder, would be taken for the folder."""
    assert rc(["run", "-h"]) == 0
    known = with_values(capsys.readouterr().out)
    with pytest.raises(SystemExit):
        rc(["run", "arm", "-h"])
    assert (
        known
        == with_values(capsys.readouterr().out)
        == {"--config", "--name", "--middleware", "--set", "--keys", "--grace"}
    )


def with_values(usage: str) -> set[str]:
    """The options of a help text that take a value."""
    return set(re.findall(r"^  (--\w+) [A-Z=]+", usage, re.MULTILINE))


@pytest.mark.parametrize(
    "arguments", [["--version"], ["lint", "--version"], ["run", "--version"], ["run", "arm", "--version"]]
)
def test_every_command_tells_its_version(arm: Path, capsys: Said, arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        rc(arguments)
    assert ended.value.code == 0
    assert re.fullmatch(r"rc( lint| run)? \(robocomp_py\) \S+\n", capsys.readouterr().out)


@pytest.mark.parametrize(
    "specific", ["def initialize(self) -> None: raise ValueError('no arm')", "def compute(self) -> None: 1 / 0"]
)
def test_a_component_that_fails_exits_with_1(arm: Path, specific: str) -> None:
    text = SELF_STOPPING.partition("    def initialize")[0]
    (arm / "specificworker.py").write_text(f"{text}    {specific}\n")
    assert rc(["run", "arm"]) == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            [str(Path(__file__).parent)],
            "is not a generated component: it has no generic/genericworker.py; run rcgen on",
        ),
        (["amr"], "there is no folder amr; did you mean `arm`?\n"),
        (["./amr"], "there is no folder amr; did you mean `arm`?\n"),
        (["long" * 100], f"there is no folder {'long' * 100}\n"),
        (["nowhere/at/all"], "there is no folder nowhere/at/all\n"),
        (["arm", "--set", "params.speed=1"], "speed"),
        (["arm", "--config", "nowhere.toml"], "nowhere.toml"),
    ],
)
def test_what_cannot_be_run_is_said_and_exits_with_1(arm: Path, capsys: Said, arguments: list[str], said: str) -> None:
    assert rc(["run", *arguments]) == 1
    assert said in capsys.readouterr().err


def test_a_handler_that_is_missing_is_said_with_the_method_to_add(arm: Path, capsys: Said) -> None:
    (arm / "arm.cdsl").write_text(
        'import "Speech.idsl"; Component arm { Communications { implements Speech; }; language python; };'
    )
    assert rcgen([str(arm / "arm.cdsl")]) == 0
    capsys.readouterr()
    assert rc(["run", "arm"]) == 1
    said = capsys.readouterr().err
    assert said.startswith(
        "SpecificWorker lacks the method Speech_say; run `rcgen --stubs arm/arm.cdsl`, or add:\n\n"
        "    def Speech_say(self, "
    )


@pytest.mark.parametrize(
    "arguments", [[], ["bogus"], ["lint"], ["lint", "--bogus", "x.idsl"], ["run", "arm", "--bogus"]]
)
def test_wrong_usage_exits_with_2(arm: Path, capsys: Said, arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        rc(arguments)
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith("usage: ")


@pytest.mark.parametrize("arguments", [["run"], ["run", "--name", "left"]])
def test_run_without_a_folder_says_so_and_shows_how_to_use_it(capsys: Said, arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        rc(arguments)
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("usage: rc run ")
    assert said.endswith("rc run: error: give it the folder of a component, as in: rc run .\n")
    assert rc(["run", "-h"]) == 0
    assert capsys.readouterr().out.startswith("usage: rc run ")


@pytest.mark.parametrize("assignment", ["speed", "=1", "a b=1", "a..b=1", "params.motors[x].y=1"])
def test_an_invalid_assignment_is_a_usage_error(arm: Path, capsys: Said, assignment: str) -> None:
    with pytest.raises(SystemExit) as ended:
        rc(["run", "arm", "--set", assignment])
    assert ended.value.code == 2
    assert f"`{assignment}` is not key=value, as in --set params.max_speed=0.5" in capsys.readouterr().err


def test_an_option_that_lint_does_not_have_shows_how_to_use_lint(capsys: Said) -> None:
    with pytest.raises(SystemExit):
        rc(["lint", "x.idsl", "--bogus"])
    assert capsys.readouterr().err.startswith("usage: rc lint ")


def test_ctrl_c_ends_a_component_as_a_program_quietly(tmp_path: Path) -> None:
    """A new component, as its author runs it for the first time."""
    assert rcgen(["--new", "Hello", "-o", str(tmp_path / "hello")]) == 0
    command = [sys.executable, "-m", "robocomp_py.cli.rc", "run", str(tmp_path / "hello")]
    with killed_on_failure(command, stderr=subprocess.PIPE, text=True, env=os.environ) as running:
        assert running.stderr
        lines = []
        for line in running.stderr:
            lines.append(line)
            if line.endswith("ready\n"):
                running.send_signal(signal.SIGINT)
        code = running.wait()
    assert code == 130
    assert "Traceback" not in "".join(lines)
