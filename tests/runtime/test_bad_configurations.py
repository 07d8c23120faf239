"""Twelve kinds of bad configuration, each told with its line, what is allowed, and what the parameter is.

Who starts the component and who checks the file beforehand are told the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from robocomp_py.deploy.configuration import check_configuration
from robocomp_py.dsl.workspace import Workspace
from robocomp_py.errors import ConfigurationError
from robocomp_py.runtime import settings

MODEL = """
ComponentParams rover
{
    max_speed "the fastest it drives, in m/s" float 0.5 0:2;
    retries "how often it tries again" int 3 0:10;
    device "where the base is" string "" mandatory;
    verbose "whether to tell more" bool false;
    mode "how it explores" enum walls { walls, spiral, random };
    List motors "one for each wheel" [1:2]
    {
        name "what it is called" string "" mandatory;
        max_torque "in N·m" float 1.5 0:10;
        List gains "of its controller" { kp "proportional" float 1 0:100; };
    };
};
"""

GOOD = """\
# Configuration of the rover.
[params]
device = "/dev/base"

[[params.motors]]
name = "left"
"""


@dataclass(frozen=True)
class Bad:
    """Lines put behind the good configuration, or instead of a part of it, and what is said about them."""

    line: int
    said: str
    text: str = ""
    instead: str = ""
    column: int = 1


KINDS = {
    "a value of another type": Bad(
        7,
        "`max_torque` (in N·m) is 'strong'; allowed: float, 0.0 to 10.0",
        'max_torque = "strong"',
        column=14,
    ),
    "a number that is too large": Bad(
        7, "`max_torque` (in N·m) is 11; allowed: float, 0.0 to 10.0", "max_torque = 11", column=14
    ),
    "a number that is too small": Bad(
        3,
        "`max_speed` (the fastest it drives, in m/s) is -0.1; allowed: float, 0.0 to 2.0",
        'max_speed = -0.1\ndevice = "/dev/base"',
        'device = "/dev/base"',
        column=13,
    ),
    "a fraction for an integer": Bad(
        4,
        "`retries` (how often it tries again) is 2.5; allowed: int, 0 to 10",
        'device = "/dev/base"\nretries = 2.5',
        'device = "/dev/base"',
        column=11,
    ),
    "a number for a truth": Bad(
        4,
        "`verbose` (whether to tell more) is 1; allowed: bool",
        'device = "/dev/base"\nverbose = 1',
        'device = "/dev/base"',
        column=11,
    ),
    "a word that is none of the choices": Bad(
        4,
        "`mode` (how it explores) is 'wals'; allowed: one of walls, spiral, random; did you mean `walls`?",
        'device = "/dev/base"\nmode = "wals"',
        'device = "/dev/base"',
        column=8,
    ),
    "a mandatory parameter that is missing": Bad(
        2, "`device` (where the base is) is mandatory: give it (string)", "", 'device = "/dev/base"\n'
    ),
    "a mandatory parameter that is missing in an item": Bad(
        7, "`name` (what it is called) is mandatory: give it (string)", "[[params.motors]]"
    ),
    "a parameter that does not exist": Bad(
        7, "unknown parameter `max_torqe`; did you mean `max_torque`?", "max_torqe = 1"
    ),
    "too many items": Bad(
        5,
        "3 items of `motors` (one for each wheel); allowed: 1 to 2",
        '[[params.motors]]\nname = "b"\n[[params.motors]]\nname = "c"',
        column=10,
    ),
    "too few items": Bad(
        1,
        "0 items of `motors` (one for each wheel); allowed: 1 to 2",
        '[params]\ndevice = "/dev/base"\n',
        GOOD,
    ),
    "a value where a list belongs": Bad(
        2,
        "`motors` (one for each wheel) is a list: write its items as tables, each under [[params.motors]]",
        '[params]\nmotors = 2\ndevice = "/dev/base"\n',
        GOOD,
        column=10,
    ),
    "a wrong value in a list inside of a list": Bad(
        8,
        "`kp` (proportional) is 101; allowed: float, 0.0 to 100.0",
        "[[params.motors.gains]]\nkp = 101",
        column=6,
    ),
    "a key that is set twice": Bad(
        8, "`max_torque` is set twice: keep one of them", "max_torque = 1\nmax_torque = 2", column=15
    ),
    "a text without quotes": Bad(7, "invalid value", "max_torque = strong", column=14),
    "a table that does not exist": Bad(7, "unknown key `paramss`; did you mean `params`?", "[paramss]", column=2),
    "a period that is none": Bad(
        8,
        "`period` is 0; allowed: a positive number of seconds, at most 1e+06",
        "[component]\nperiod = 0",
        column=10,
    ),
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rover.pdsl").write_text(MODEL)
    (tmp_path / "rover.cdsl").write_text('Component rover { language python; params "rover.pdsl"; };')
    return tmp_path


def written(bad: Bad) -> Path:
    path = Path("config.toml")
    path.write_text(GOOD.replace(bad.instead, bad.text) if bad.instead else f"{GOOD}{bad.text}\n")
    return path


def test_there_are_twelve_kinds_at_least() -> None:
    assert len(KINDS) >= 12


@pytest.mark.usefixtures("folder")
def test_the_good_configuration_is_good() -> None:
    workspace = Workspace()
    path = Path("config.toml")
    path.write_text(GOOD)
    check_configuration(path, workspace)
    assert workspace.report.diagnostics == []


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("kind", KINDS)
def test_starting_the_component_reports_the_error(kind: str) -> None:
    bad, component = KINDS[kind], Workspace().component(Path("rover.cdsl"))
    assert component is not None
    with pytest.raises(ConfigurationError) as caught:
        settings.check(component.component, settings.read(written(bad), component.component.params))
    column = f":{bad.column}" if bad.said.endswith(("keep one of them", "invalid value")) else ""
    assert str(caught.value).partition("\n    ")[0] == f"config.toml:{bad.line}{column}: {bad.said}"


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("kind", KINDS)
def test_checking_the_file_reports_the_error_with_its_position(kind: str) -> None:
    bad, workspace = KINDS[kind], Workspace()
    check_configuration(written(bad), workspace, Path("rover.cdsl"))
    [only] = workspace.report.diagnostics
    assert only.message == bad.said
    assert only.span.source.position(only.span.start) == (bad.line, bad.column)
    assert only.code.startswith("config-")
