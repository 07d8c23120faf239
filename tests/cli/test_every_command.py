"""What holds for all commands of `rc`: their help, JSON, misspelt names, exit codes."""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.cli import rc
from robocomp_py.cli.bag import NAME as BAG
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.census import take_census
from robocomp_py.transports.base import find_transport

from ..leftovers import killed_on_failure
from ..runtime.running import make, running
from ..tools.talkers import Talker

Said = pytest.CaptureFixture[str]

WITHOUT_JSON = {
    "fmt": "it formats files; `--check` prints their names, one a line",
    "rename": "it shows a diff, and asks",
    "run": "what is printed comes from the component",
    "host": "it prints nothing but what its middleware logs",
    "sim new": "it writes files",
    "sim import": "it writes files",
    "sim export": "it writes a file",
    "sim view": "it serves a page",
    "sim edit": "it serves a page",
    "foxglove": "it serves Foxglove, in its protocol",
    "param dump": "it prints a file of ROS 2; `rc param list --json` has the same values",
    "lsp": "it speaks the protocol of editors",
    "mcp": "it speaks the protocol of agents",
    "completion": "it prints the script of a shell",
}
"""Why a command has no `--json`."""


@pytest.fixture
def talker(own_runtime_folder: Path) -> Iterator[object]:
    with running(make(Talker, find_transport, "middleware=shm", name="talker")) as worker:
        wait_until(lambda: "talker/Everything/news" in take_census(["shm"]).channels)
        yield worker


def ended(*arguments: str) -> int:
    """The exit code of a command, also of one that its parser ends."""
    try:
        return rc.main(arguments)
    except SystemExit as exc:
        return int(str(exc.code))


@pytest.mark.parametrize("name", rc.COMMANDS)
def test_help_has_examples_and_tells_the_exit_codes(name: str, capsys: Said) -> None:
    assert ended(name, "--help") == 0
    told = capsys.readouterr().out
    assert re.search(rf"^examples:\n(  .*\n)*  .*\brc {name}\b", told, re.MULTILINE)
    assert re.search(r"^exit status: 0 \w+", told, re.MULTILINE)
    assert len(told.splitlines()) > 8


@pytest.fixture
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a narrow terminal, help has lines that begin anywhere."""
    monkeypatch.setenv("COLUMNS", "100")


@pytest.mark.usefixtures("wide")
def test_the_help_lists_each_command_once_in_its_group(capsys: Said) -> None:
    assert ended("--help") == 0
    told = capsys.readouterr().out.partition("\noptions:")[0]
    assert re.findall(r"^  ([a-z]+) ", told, re.MULTILINE) == list(rc.COMMANDS)
    assert re.findall(r"^([a-z ]+):$", told, re.MULTILINE) == list(rc.GROUPS)


@pytest.mark.parametrize("name", [BAG, "param", "action", "clock", "sim"])
def test_each_part_of_a_command_has_an_example(name: str, capsys: Said) -> None:
    known = [part for part, _ in parsers(rc.parser_for(name))]
    assert len(known) >= 4
    for each in known:
        assert ended(*each.split(), "--help") == 0
        told = capsys.readouterr().out
        assert re.search(rf"^usage: rc {each} .*\n(.*\n)*?\n[A-Z].*\n", told), told
        assert re.search(rf"^examples:\n  rc {each}\b", told, re.MULTILINE), told
        assert re.search(r"^exit status: 0 \w+", told, re.MULTILINE), told


def parsers(parser: argparse.ArgumentParser, name: str = "") -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """The parsers of commands, by their names; of one with parts, those of the parts."""
    parts = [each for each in parser._actions if isinstance(each, argparse._SubParsersAction)]
    for each in parts:
        for part, inner in each.choices.items():
            yield from parsers(inner, f"{name} {part}".strip())
    if not parts:
        yield name, parser


@pytest.mark.usefixtures("wide")
def test_each_command_has_json_or_a_reason_why_not() -> None:
    known = {name: made for each in rc.COMMANDS for name, made in parsers(rc.parser_for(each))}
    without = {name for name, made in known.items() if not re.search(r"^ +--json\b", made.format_help(), re.MULTILINE)}
    assert without == set(WITHOUT_JSON)


@pytest.mark.parametrize("name", [each for each in rc.COMMANDS if each != rc.RUN])
def test_a_wrong_option_is_a_wrong_usage(name: str, capsys: Said) -> None:
    assert ended(name, "--hlep") == 2
    told = capsys.readouterr().err
    assert told.startswith("usage: ")
    assert f"\nrc {name}: error: " in told


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (("ecko",), "no command `ecko`; did you mean `echo`?"),
        (("bag", "mnd"), "did you mean `mend`?"),
        (("list", "--jsn"), "no option --jsn; did you mean --json?"),
        (("list", "--top"), "no option --top; did you mean --topics?"),
        (("log", "wander", "dbug"), "did you mean `debug`?"),
        (("completion", "bsh"), "did you mean `bash`?"),
    ],
)
def test_misspelt_words_of_a_command_are_guessed(arguments: tuple[str, ...], meant: str, capsys: Said) -> None:
    assert ended(*arguments) == 2
    assert meant in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        ("echo", "talkr"),
        ("hz", "talkr"),
        ("bw", "talkr"),
        ("delay", "talkr"),
        ("info", "talkr"),
        ("call", "talkr"),
        ("pub", "talkr"),
        ("log", "talkr", "debug"),
        ("param", "list", "talkr"),
        ("top", "talkr", "--once"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_misspelt_names_of_what_runs_are_guessed(talker: object, arguments: tuple[str, ...], capsys: Said) -> None:
    waiting = () if "--once" in arguments else ("--timeout", "0.1")
    assert ended(*arguments, *waiting) == 1
    assert "did you mean `talker`?" in capsys.readouterr().err


def test_a_contract_is_told_to_machines(talker: object, capsys: Said) -> None:
    assert ended("info", "divide", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["channel"] == "talker/Everything/divide"
    assert told["pattern"] == "query"
    assert told["contract"][0].startswith("int64 divide(int64 dividend")
    (served,) = told["ends"]
    assert (served["role"], served["component"], served["middleware"]) == ("serves", "talker", "shm")
    assert re.fullmatch("[0-9a-f]{16}", served["fingerprint"])


def test_an_operation_that_returns_nothing_prints_nothing(talker: object, capsys: Said) -> None:
    call = ("call", "talker/Introspection/watch", "calls=false", "logs=false", "lease=0.1")
    assert ended(*call) == 0
    assert capsys.readouterr().out == ""
    assert ended(*call, "--json") == 0
    assert capsys.readouterr().out == "null\n"


def test_a_declared_exception_is_told_to_machines(talker: object, capsys: Said) -> None:
    assert ended("call", "divide", "dividend=1", "divisor=0", "--json") == 1
    told = json.loads(capsys.readouterr().out)
    assert told == {"exception": "Conformance.Failed", "fields": {"what": "division by zero", "code": 7}}
    assert ended("call", "divide", "dividend=7", "divisor=2", "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"ret": 3, "remainder": 1}


@pytest.mark.parametrize(
    ("arguments", "number", "code"),
    [
        (("echo", "news"), signal.SIGINT, 130),
        (("echo", "news"), signal.SIGTERM, 143),
        (("hz", "news"), signal.SIGINT, 130),
        (("bw", "news"), signal.SIGINT, 130),
        (("delay", "news"), signal.SIGINT, 130),
        (("top",), signal.SIGINT, 130),
    ],
)
def test_a_command_that_goes_on_ends_by_a_signal(
    talker: object, arguments: tuple[str, ...], number: signal.Signals, code: int
) -> None:
    command = [sys.executable, "-m", "robocomp_py.cli.rc", *arguments, "--json"]
    with killed_on_failure(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert process.stderr
        assert json.loads(process.stdout.readline())
        process.send_signal(number)
        process.stdout.read()
        assert process.stderr.read() == ""
    assert process.returncode == code


@pytest.mark.parametrize(
    "arguments",
    [
        ("echo", "news", "--where", "text=nothing"),
        ("echo", "divide", "--calls", "--served", "--timeout", "3600"),
        ("logs", "--follow"),
        ("param", "watch", "talker"),
        ("top", "--every", "3600"),
    ],
    ids=" ".join,
)
def test_a_command_that_goes_on_ends_with_the_program_that_reads_its_output(
    talker: object, arguments: tuple[str, ...]
) -> None:
    reading, writing = os.pipe()
    command = [sys.executable, "-m", "robocomp_py.cli.rc", *arguments, "--middleware", "shm"]
    with killed_on_failure(command, stdout=writing, stderr=subprocess.PIPE, text=True) as process:
        os.close(writing)
        if arguments[0] == "top":
            os.read(reading, 1)
        os.close(reading)
        _, said = process.communicate(timeout=3 * SOON)
    assert (process.returncode, said) == (1, "")
