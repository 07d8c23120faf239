"""What is said about wrong arguments, by all commands alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from robocomp_py.arguments import Parser
from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.cli.rcgen import main as rcgen

Said = pytest.CaptureFixture[str]
Main = Callable[[Sequence[str]], int]


def told(main: Main, arguments: Sequence[str], capsys: Said) -> tuple[object, str]:
    """The exit code, and the last line that was said."""
    capsys.readouterr()
    try:
        code: object = main(arguments)
    except SystemExit as exc:
        code = exc.code
    return code, capsys.readouterr().err.strip().splitlines()[-1]


@pytest.fixture
def hello(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    assert rcgen(["--new", "hello"]) == 0
    (tmp_path / "net.ddsl").write_text('import "hello/hello.cdsl"; Deployment net { Component hello { }; };')
    return tmp_path


EMPTY: list[tuple[Main, list[str], str]] = [
    (rc, ["run", "hello", "--name", ""], "rc: error: --name has an empty value"),
    (rc, ["run", "hello", "--keys="], "rc: error: --keys has an empty value"),
    (rc, ["run", ""], "rc: error: an argument is empty"),
    (rc, ["fmt", ""], "rc: error: an argument is empty"),
    (rc, ["lint", "-I", "", "net.ddsl"], "rc: error: -I has an empty value"),
    (rcgen, ["hello/hello.cdsl", "--middleware", ""], "rcgen: error: --middleware has an empty value"),
    (rcdeploy, ["net.ddsl", "--middleware="], "rcdeploy: error: --middleware has an empty value"),
    (rcdeploy, ["logs", ""], "rcdeploy logs: error: an argument is empty"),
]

WRONG: list[tuple[Main, list[str], str]] = [
    (rc, ["rum", "hello"], "rc: error: no command `rum`; did you mean `run`?"),
    (rc, ["run", "hello", "--json"], "rc run hello: error: --json is for --print-config"),
    (rc, ["run", "hello", "--nmae", "x"], "rc run hello: error: no option --nmae; did you mean --name?"),
    (rc, [], "rc: error: a command is missing; see: rc --help"),
    (rc, ["clock"], "rc clock: error: a command is missing: show, pause, resume, step, speed; see: rc clock --help"),
    (rc, ["call"], "rc call: error: NAME is missing; see: rc call --help"),
    (rc, ["param", "set", "wander"], "rc param set: error: NAME=VALUE is missing; see: rc param set --help"),
    (rcdeploy, ["down"], "rcdeploy down: error: NET.ddsl is missing; see: rcdeploy down --help"),
    (rc, ["lint", "--against"], "rc lint: error: --against needs a value"),
    (rc, ["lint", "--json", "--sarif", "net.ddsl"], "rc lint: error: --sarif and --json exclude each other"),
    (rcdeploy, ["down", "net.ddsl", "--grace", "x"],
     "rcdeploy down: error: --grace: `x` is not a number of seconds; write it as 30 or 0.5"),
    (rcdeploy, ["net.ddsl", "--until", "helo"],
     "rcdeploy: --until helo: unknown instance `helo`; did you mean `hello`?"),
    (rcdeploy, ["status", "--json=1"], "rcdeploy status: error: --json takes no value"),
    (rcdeploy, ["net.ddsl", "--record-logs", "xml"],
     "rcdeploy: error: --record-logs: there is no `xml`; there are: text, json"),
]  # fmt: skip

UNKNOWN: list[tuple[Main, list[str]]] = [
    (rc, ["run", "hello", "--middleware", "zenho"]),
    (rc, ["run", "hello", "+", "hello", "--name", "b", "--middleware", "zenho"]),
    (rc, ["host", "zenho"]),
    (rc, ["links", "net.ddsl", "--middleware", "zenho"]),
    (rcgen, ["hello/hello.cdsl", "--middleware", "zenho"]),
    (rcdeploy, ["net.ddsl", "--middleware", "zenho"]),
]


@pytest.mark.parametrize(("main", "arguments", "says"), [*EMPTY, *WRONG])
def test_a_wrong_argument_is_named_in_plain_words(
    hello: Path, capsys: Said, main: Main, arguments: list[str], says: str
) -> None:
    assert told(main, arguments, capsys) == (2, says)


@pytest.mark.parametrize(("main", "arguments"), UNKNOWN)
def test_an_unknown_middleware_is_wrong_usage_of_every_command(
    hello: Path, capsys: Said, main: Main, arguments: list[str]
) -> None:
    code, says = told(main, arguments, capsys)
    assert code == 2
    assert "middleware `zenho`" in says
    assert "did you mean `zenoh`?" in says


def test_what_follows_two_dashes_may_be_empty() -> None:
    made = Parser()
    made.add_argument("words", nargs="*")
    assert made.parse_args(["--", "", "a"]).words == ["", "a"]
    assert made.parse_args(["a=", "b"]).words == ["a=", "b"]


def test_a_file_that_is_not_there_has_no_lines(hello: Path, capsys: Said) -> None:
    assert rc(["lint", "nosuch.ddsl"]) == 1
    assert capsys.readouterr().err.startswith(
        "nosuch.ddsl: error[unreadable]: cannot be read: No such file or directory\n"
    )


def test_a_path_is_shown_without_detours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Said) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "idsl").mkdir()
    (tmp_path / "thermo").mkdir()
    (tmp_path / "idsl" / "Thermo.idsl").write_text("module RoboCompThermo { interface Thermo { Degree get(); }; };")
    (tmp_path / "thermo" / "thermo.cdsl").write_text(
        'import "../idsl/Thermo.idsl"; Component thermo { Communications { implements Thermo; }; language python; };'
    )
    assert rc(["lint", "thermo/thermo.cdsl"]) == 1
    assert capsys.readouterr().err.startswith("idsl/Thermo.idsl:1:44: error[unknown-type]")


def test_missing_keys_are_reported_even_if_they_may_not_be_needed(hello: Path, capsys: Said) -> None:
    assert told(rc, ["run", "hello", "--keys", "nosuch"], capsys) == (
        1,
        "--keys nosuch: no such folder; create it with `rcdeploy keys`",
    )
