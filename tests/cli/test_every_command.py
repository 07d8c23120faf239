"""What holds for all commands of `rc`: their help, JSON, misspelt names, exit codes."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.cli import rc
from robocomp_py.cli.bag import NAME as BAG
from robocomp_py.testing.patience import wait_until
from robocomp_py.tools.census import take_census
from robocomp_py.transports.base import find_transport

from ..runtime.test_run import make, running
from ..tools.test_commands import Talker

Said = pytest.CaptureFixture[str]

WITH_JSON = ("lint", "links", "list", "info", "echo", "hz", "bw", "delay", "call", "doctor", "top", "record", "plot")


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


def test_the_help_lists_each_command_once_in_its_group(capsys: Said) -> None:
    assert ended("--help") == 0
    told = capsys.readouterr().out.partition("\noptions:")[0]
    assert re.findall(r"^  ([a-z]+) ", told, re.MULTILINE) == list(rc.COMMANDS)
    assert re.findall(r"^([a-z ]+):$", told, re.MULTILINE) == list(rc.GROUPS)


@pytest.mark.parametrize("name", [BAG, "param", "action", "clock"])
def test_each_part_of_a_command_has_an_example(name: str, capsys: Said) -> None:
    assert ended(name, "--help") == 0
    told = capsys.readouterr().out
    parts = re.search(r"\{([\w,]+)\}", told)
    known = parts[1].split(",") if parts else re.findall(r"^    (\w+) ", told, re.MULTILINE)
    assert len(known) >= 4
    assert [each for each in known if f"rc {name} {each}" not in told] == []


@pytest.mark.parametrize("name", WITH_JSON)
def test_what_is_listed_or_measured_can_be_json(name: str, capsys: Said) -> None:
    assert ended(name, "--help") == 0
    assert "--json" in capsys.readouterr().out


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


def test_a_declared_exception_is_told_to_machines(talker: object, capsys: Said) -> None:
    assert ended("call", "divide", "dividend=1", "divisor=0", "--json") == 1
    told = json.loads(capsys.readouterr().out)
    assert told == {"exception": "Conformance.Failed", "fields": {"what": "division by zero", "code": 7}}
    assert ended("call", "divide", "dividend=7", "divisor=2", "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"ret": 3, "remainder": 1}


@pytest.mark.parametrize("arguments", [("echo", "news"), ("hz", "news"), ("bw", "news"), ("delay", "news"), ("top",)])
def test_a_command_that_goes_on_ends_by_a_signal(talker: object, arguments: tuple[str, ...]) -> None:
    command = [sys.executable, "-m", "robocomp_py.cli.rc", *arguments, "--json"]
    for number, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stdout
            assert process.stderr
            assert json.loads(process.stdout.readline())
            process.send_signal(number)
            process.stdout.read()
            assert process.stderr.read() == ""
        assert process.returncode == code
