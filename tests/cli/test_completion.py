"""What shells are told when they complete a command line, and that their scripts ask for it."""

from __future__ import annotations

import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.cli import rc, rcdeploy, rcgen
from robocomp_py.cli.candidates import answered
from robocomp_py.cli.completing import ASKED
from robocomp_py.deploy.place import Place
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON
from robocomp_py.tools.recording.bag import BagWriter, Options
from robocomp_py.tools.recording.layout import Topic
from robocomp_py.transports.base import find_transport

from ..runtime.components import Station, Tuned
from ..runtime.running import make, running
from ..tools import elsewhere

BIN = Path(sys.executable).parent


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("net.ddsl", "arm.cdsl", "notes.txt", "run.mcap", ".hidden.ddsl", "two words.ddsl"):
        (tmp_path / name).touch()
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "leg.ddsl").touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def talker(own_runtime_folder: Path) -> Iterator[object]:
    with running(make(Station, find_transport, "middleware=shm", name="talker")) as worker:
        yield worker


def completed(line: str, shell: str = "bash") -> list[str]:
    """What a shell is told for a line with the cursor behind it."""
    program, *words = line.split(" ")
    finders = {
        "rc": rc.completer,
        "rcgen": rcgen.completer,
        "rcdeploy": rcdeploy.completer,
    }
    return answered(finders[program], [line] if shell == "bash" else words, shell)


def test_topics_of_a_recording_are_proposed_whatever_their_names(files: Path) -> None:
    writer = BagWriter(files / "run", Options())
    for name in ("rosout", "world/Everything/news"):
        writer.write(writer.add(Topic(name, e.news)), b"", 1, 1, 1)
    writer.close()
    assert completed("rc plot run ") == ["rosout", "world/Everything/news"]
    assert completed("rc replay run --only ne") == ["news"]


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("rc ec", ["echo"]),
        ("rc bag m", ["mend", "merge"]),
        ("rc echo --mi", ["--middleware"]),
        ("rc echo x --json --js", []),
        ("rc echo --middleware sh", ["shm"]),
        ("rc echo --middleware=sh", ["shm"]),
        ("rc bag cut run --compress ", ["none", "lz4", "zstd"]),
        ("rc log wander wa", ["warning"]),
        ("rc graph n", ["net.ddsl"]),
        ("rc graph parts/", ["parts/leg.ddsl"]),
        ("rc graph a", []),
        ("rc graph .h", [".hidden.ddsl"]),
        ("rc graph nowhere/", []),
        ("rc bag info ", ["parts/", "run.mcap"]),
        ("rc graph tw", ["two words.ddsl"]),
        ("rc graph two\\ w", ["two words.ddsl"]),
        ("rc graph 'two w", ["two words.ddsl"]),
        ("rc completion ", ["bash", "zsh", "fish"]),
        ("rc lint -I p", ["parts/"]),
        ("rc mcp net -I p", ["parts/"]),
        ("rc action send a/B/c -I p", ["parts/"]),
        ("rc lint --explain no-pr", ["no-provider"]),
        ("rc replay ", ["parts/", "run.mcap"]),
        ("rc rerun p", ["parts/"]),
        ("rc rerun parts ", ["parts/", "run.mcap"]),
        ("rc rename ", ["arm.cdsl", "net.ddsl", "parts/", "two words.ddsl"]),
        ("rc fmt arm.cdsl a", []),
        ("rcdeploy logs net.ddsl --level w", ["warning"]),
        ("rcgen ", ["arm.cdsl", "net.ddsl", "parts/", "two words.ddsl"]),
        ("rcgen --to omg", ["omgidl"]),
        ("rcdeploy st", ["status", "stop", "start"]),
        ("rcdeploy net", ["net.ddsl"]),
        ("rcdeploy net.ddsl --det", ["--detach"]),
        ("rcdeploy logs net.ddsl --gr", ["--grep"]),
        ("rcdeploy export sys", ["systemd"]),
    ],
)
def test_what_fits_is_found(line: str, found: list[str], files: Path) -> None:
    assert completed(line) == found


def test_the_first_word_of_rcdeploy_is_a_command_or_a_network(files: Path) -> None:
    assert {"up", "down", "net.ddsl", "parts/"} <= set(completed("rcdeploy "))
    assert completed("rcdeploy net.ddsl u") == []


def test_commands_of_rc_have_their_help() -> None:
    assert completed("rc hz", "fish") == [f"hz\t{rc.COMMANDS['hz']}"]
    assert completed("rc echo --fu", "zsh") == ["--full\tprint long sequences whole"]


def test_names_of_what_runs_are_found(talker: object) -> None:
    assert completed("rc echo ") == ["talker/Everything/news"]
    assert completed("rc echo Ev") == ["Everything/news"]
    assert completed("rc echo ne") == ["news"]
    assert "talker/Everything/divide" in completed("rc call talker/E")
    assert "talker/Everything/news" not in completed("rc call talker/E")
    assert "talker/CommonBehavior/getState" in completed("rc call talker/CommonBehavior")
    assert completed("rc param list t") == ["talker"]
    assert completed("rc action cancel ") == []


def test_fields_of_what_is_called_or_published_are_found(talker: object) -> None:
    assert completed("rc call talker/Everything/divide ") == ["dividend=", "divisor="]
    assert completed("rc call divide dividend=7 ") == ["divisor="]
    assert completed("rc call divide divis", "fish") == ["divisor=\tint64"]
    assert completed("rc pub talker/Everything/news t") == ["text="]
    nested = "rc call echo_nested value.scalars"
    assert completed(f"{nested}.i") == [f"value.scalars.i{bits}=" for bits in (8, 64, 16, 32)]
    assert completed(f"{nested}.colour=") == ["red", "green", "ultraviolet"]
    assert completed(f"{nested}.flag=t", "zsh") == ["value.scalars.flag=true"]


def test_instances_that_a_network_declares_are_found(files: Path) -> None:
    (files / "home.ddsl").write_text(
        "Deployment home { Component hall : lamp { }; System left { Component arm { }; }; };"
    )
    assert completed("rcdeploy up home.ddsl --until ") == ["hall", "left/arm"]
    assert completed("rcdeploy home.ddsl --until=l") == ["left/arm"]
    assert completed("rcdeploy simulate home.ddsl --until ha") == ["hall"]
    assert completed("rcdeploy up nowhere.ddsl --until ") == []


@pytest.fixture
def tuned(own_runtime_folder: Path) -> Iterator[object]:
    with running(make(Tuned, find_transport, "middleware=shm", "params.device=here", name="tuned")) as worker:
        yield worker


def test_parameters_of_a_component_are_found_with_what_they_are(tuned: object) -> None:
    assert completed("rc param get tuned m") == ["max_speed"]
    assert completed("rc param describe tuned dev") == ["device"]
    assert completed("rc param set tuned ") == ["max_speed=", "verbose="]
    assert completed("rc param set tuned verbose=") == ["true", "false"]
    assert completed("rc param set tuned verbose=true max") == ["max_speed="]
    assert completed("rc param get tuned max", "fish") == ["max_speed\t0.5; float, 0.0 to 2.0"]
    assert completed("rc param get absent ") == completed("rc param get ed ") == []


@pytest.fixture
def rescue(own_runtime_folder: Path, files: Path) -> Iterator[None]:
    """A network that runs, with a system."""
    place = Place("rescue")
    place.take()
    processes = [{"name": "wander", "instances": ["wander"]}, {"name": "both", "instances": ["left/arm", "left/hand"]}]
    place.plan.write_text(json.dumps({"processes": processes}))
    (files / "rescue.ddsl").write_text("Deployment rescue { };")
    yield
    place.release()


def test_instances_of_a_network_are_found_also_those_that_are_stopped(rescue: None) -> None:
    for command in ("stop", "start", "restart", "logs"):
        assert completed(f"rcdeploy {command} rescue w") == ["wander"]
    assert completed("rcdeploy stop rescue.ddsl ") == ["wander", "left/arm", "left/hand", "both", "left"]
    assert completed("rcdeploy stop rescue.ddsl wander left/h") == ["left/hand"]
    assert completed("rcdeploy stop nowhere ") == []


def test_checks_of_the_doctor_and_hosts_are_found(own_runtime_folder: Path, files: Path) -> None:
    assert completed("rc doctor --check cl") == ["clocks"]
    assert completed("rc echo x --host h") == ["here"]
    with elsewhere.network("base"):
        assert completed("rc echo x --host ") == ["base", "here"]


def test_nothing_is_found_for_what_cannot_be_known(talker: object) -> None:
    assert completed("rc call nowhere/divide ") == completed("rc pub {} ") == []
    assert completed("rc echo -- t") == ["talker/Everything/news"]


def test_names_of_networks_that_run_are_found(own_runtime_folder: Path, files: Path) -> None:
    place = Place("rescue")
    place.take()
    try:
        assert completed("rcdeploy status re") == ["rescue"]
    finally:
        place.release()
    assert completed("rcdeploy status re") == []


def asked(shell: str, program: str, *words: str) -> list[str]:
    made = subprocess.run(
        [BIN / program, *words], env=os.environ | {ASKED: shell}, capture_output=True, text=True, check=True
    )
    return made.stdout.splitlines()


def test_programs_answer_a_shell() -> None:
    assert asked("bash", "rc", "rc echo --mi") == ["--middleware"]
    assert asked("fish", "rcdeploy", "stat") == ["status\tshow the state of a running network"]
    assert asked("zsh", "rcgen", "--stu") == ["--stubs\tappend what specificworker.py lacks to its class"]


def in_bash(line: str) -> list[str]:
    """The replies of the function that the script has bash call."""
    words = f"""\
        PATH={BIN}:$PATH
        eval "$(rc completion bash)"
        compopt() {{ :; }}   # there is no completion going on, whose options it could change
        COMP_LINE='{line}' COMP_POINT={len(line)}
        _robocomp {line.split()[0]}
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    made = subprocess.run(["bash", "-c", words], capture_output=True, text=True, check=True)
    assert made.stderr == ""
    return made.stdout.splitlines()


def test_bash_completes(files: Path) -> None:
    assert in_bash("rc bag me") == ["mend", "merge"]
    assert in_bash("rc graph tw") == ["two\\ words.ddsl"]
    assert in_bash("rcgen --stu") == ["--stubs"]
    assert in_bash("rc echo --middleware=sh") == ["shm"]


SHELL_LINES = {
    "rc bag me": ["mend", "merge"],
    "rcgen --stu": ["--stubs"],
    "rc graph ne": ["net.ddsl"],
    "rc param get tuned max": ["max_speed"],
    "rc param set tuned max": ["max_speed="],
    "rc param set tuned verbose=": ["verbose=false", "verbose=true"],
    "rc log tuned wa": ["warning"],
    "rc call tuned/CommonBehavior/getS": ["tuned/CommonBehavior/getState", "tuned/CommonBehavior/getStatus"],
    "rcdeploy status resc": ["rescue", "rescue.ddsl"],
    "rcdeploy stop rescue left/h": ["left/hand"],
}
"""What every shell finds, whole words in their order."""


def test_bash_finds_names_of_what_runs(rescue: None, tuned: object) -> None:
    for line, found in SHELL_LINES.items():
        cut = len(line.rpartition(" ")[2].rpartition("=")[0]) + 1 if "=" in line else 0
        assert sorted(in_bash(line)) == [each[cut:] for each in found], line


@pytest.mark.tool
def test_fish_completes(rescue: None, tuned: object, tmp_path: Path) -> None:
    asked = "; echo @@; ".join(f"complete -C {line!r}" for line in SHELL_LINES)
    words = f"set -x PATH {BIN} $PATH; rc completion fish | source; {asked}"
    home = {"HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path), "XDG_DATA_HOME": str(tmp_path)}
    made = subprocess.run(
        ["fish", "--no-config", "-c", words], env=os.environ | home, capture_output=True, text=True, check=True
    )
    found = [[line.partition("\t")[0] for line in part.split("\n") if line] for part in made.stdout.split("@@\n")]
    assert dict(zip(SHELL_LINES, map(sorted, found), strict=True)) == SHELL_LINES


@pytest.mark.tool
def test_zsh_completes(rescue: None, tuned: object, tmp_path: Path) -> None:
    with Terminal("zsh", "-f", "-i", home=tmp_path) as shell:
        shell.type(f"PS1='$ '; PATH={BIN}:$PATH; autoload -U compinit; compinit -u -D\n")
        shell.type('eval "$(rc completion zsh)"; echo rea""dy\n')
        shell.wait_for("ready")
        shell.type("rc graph ne\t")
        shell.wait_for("n.*e.*t.ddsl")
        shell.type("\x15rc bag me\t\t")
        shell.wait_for("merge +-- make one recording")
        shell.type("\x15tell() { print -r -- \"<$BUFFER>\" }; zle -N tell; bindkey '^X^T' tell\n")
        for line, found in SHELL_LINES.items():
            if len(found) == 1:
                shell.type(f"\x15{line}\t\x18\x14")
                whole = f"{line.rpartition(' ')[0]} {found[0]}"
                shell.wait_for(f"<{re.escape(whole)} ?>")


class Terminal:
    """An interactive program in a terminal."""

    def __init__(self, *command: str, home: Path) -> None:
        self._command, self._home = command, home
        self._seen = ""

    def __enter__(self) -> Terminal:
        ours, theirs = pty.openpty()
        self._ours = ours
        self._process = subprocess.Popen(
            self._command,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            start_new_session=True,
            env=os.environ | {"HOME": str(self._home), "ZDOTDIR": str(self._home), "TERM": "dumb"},
        )
        os.close(theirs)
        return self

    def __exit__(self, *_: object) -> None:
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        os.close(self._ours)

    def type(self, text: str) -> None:
        os.write(self._ours, text.encode())

    def wait_for(self, pattern: str) -> None:
        while not re.search(pattern, self._seen):
            readable, _, _ = select.select([self._ours], [], [], SOON)
            assert readable, self._seen
            self._seen += os.read(self._ours, 65536).decode(errors="replace")
        self._seen = ""
