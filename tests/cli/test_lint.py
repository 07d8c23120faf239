"""`rc lint`: for people, for machines, and for who wants to know more."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcgen import main as rcgen

from ..docs.diagnostics import PAGES

WRONG = "module Arm { struct Joint { flaot angle; };; };"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.idsl").write_text(WRONG)
    (tmp_path / "right.idsl").write_text("module Right { };")
    return tmp_path


def test_the_number_of_errors_is_printed_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["lint", "arm.idsl", "right.idsl"]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines()[-1] == "1 error and 1 warning in 1 file"


@pytest.mark.parametrize("how", [[], ["--json"]])
def test_nothing_is_said_of_right_files(how: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["lint", *how, "right.idsl"]) == 0
    assert capsys.readouterr() == ("", "")


def test_json_has_one_diagnostic_a_line_and_nothing_else(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["lint", "--json", "arm.idsl"]) == 1
    said = capsys.readouterr()
    first, _ = map(json.loads, said.out.splitlines())
    assert said.err == ""
    assert first == {
        "file": "arm.idsl", "line": 1, "column": 29, "end_line": 1, "end_column": 34, "severity": "error",
        "code": "unknown-type", "message": "unknown type `flaot`", "hint": "did you mean `float`?",
    }  # fmt: skip


def test_sarif_is_one_log_of_all_files(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["lint", "--sarif", "arm.idsl", "right.idsl"]) == 1
    said = capsys.readouterr()
    assert said.err == ""
    codes = [result["ruleId"] for result in json.loads(said.out)["runs"][0]["results"]]
    assert codes == ["unknown-type", "stray-semicolon"]
    assert rc(["lint", "--sarif", "right.idsl"]) == 0
    assert json.loads(capsys.readouterr().out)["runs"][0]["results"] == []


def test_a_folder_means_all_that_is_in_it_but_what_is_hidden(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("deep/down", ".hidden", "empty"):
        (folder / name).mkdir(parents=True)
    for name in ("deep/down/hand.idsl", ".hidden/leg.idsl", "notes.txt"):
        (folder / name).write_text(WRONG)
    assert rc(["lint", "--json", "."]) == 1
    files = [json.loads(line)["file"] for line in capsys.readouterr().out.splitlines()]
    assert sorted(set(files)) == ["arm.idsl", "deep/down/hand.idsl"]


def test_in_a_folder_also_what_is_linked_there_is_checked_but_nothing_that_is_no_file(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "hands").mkdir()
    (folder / "hands" / "left.idsl").symlink_to(folder / "arm.idsl")
    (folder / "hands" / "gone.idsl").symlink_to(folder / "nothing.idsl")
    os.mkfifo(folder / "hands" / "pipe.idsl")
    assert rc(["lint", "--json", "hands"]) == 1
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {each["file"] for each in found} == {"hands/left.idsl", "hands/gone.idsl"}
    assert [each["code"] for each in found if each["file"] == "hands/gone.idsl"] == ["unreadable"]


def test_each_folder_in_which_there_is_nothing_to_check_is_reported(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("empty", "void"):
        (folder / name).mkdir()
    assert rc(["lint", "right.idsl", "empty", "void"]) == 1
    said = "".join(f"rc lint: {name}: no model files in this folder\n" for name in ("empty", "void"))
    assert capsys.readouterr().err == said


def test_a_code_is_explained_by_its_page(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["lint", "--explain", "unknown-type"]) == 0
    assert capsys.readouterr().out == (PAGES / "unknown-type.md").read_text(encoding="utf-8")


def test_a_misspelt_code_gets_a_suggestion(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc(["lint", "--explain", "unknwon-type"]) == 1
    assert capsys.readouterr().err == "rc lint: unknown code `unknwon-type`; did you mean `unknown-type`?\n"


@pytest.mark.parametrize("arguments", [[], ["--json", "--sarif", "arm.idsl"]])
def test_what_cannot_be_asked_for_is_a_wrong_usage(arguments: list[str], folder: Path) -> None:
    with pytest.raises(SystemExit) as ended:
        rc(["lint", *arguments])
    assert ended.value.code == 2


# Configurations.

EXPLORER = """
ComponentParams explorer
{
    max_speed "m/s" float 0.5 0:2;
    device "where the base is" string "" mandatory;
};
"""


@pytest.fixture
def explorer(folder: Path) -> Path:
    (folder / "explorer").mkdir()
    (folder / "explorer" / "etc").mkdir()
    (folder / "explorer" / "explorer.pdsl").write_text(EXPLORER)
    (folder / "explorer" / "explorer.cdsl").write_text(
        'import "Laser.idsl";\n'
        'Component explorer { Communications { requires Laser; }; language python; params "explorer.pdsl"; };'
    )
    return folder / "explorer"


def lint(capsys: pytest.CaptureFixture[str], *arguments: object) -> list[tuple[str, int, int, int, str]]:
    """Severity and code, line, column and end column, and message of what is found."""
    code = rc(["lint", "--json", *map(str, arguments)])
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert code == (1 if any(each["severity"] == "error" for each in found) else 0)
    return [
        (f"{each['severity']}[{each['code']}]", each["line"], each["column"], each["end_column"], each["message"])
        for each in found
    ]


@pytest.mark.parametrize("model", ["explorer.pdsl", "explorer.cdsl", None])
def test_a_configuration_is_checked_against_its_model(
    explorer: Path, model: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    config = explorer / "etc" / "config.toml"
    config.write_text('[params]\nmax_speed = 3.5 # fast\ndevise = "x"\n')
    against = ["--against", explorer / model] if model else []
    assert lint(capsys, config, *against) == [
        ("error[config-missing]", 1, 1, 9, "`device` (where the base is) is mandatory: give it (string)"),
        ("error[config-out-of-range]", 2, 13, 16, "`max_speed` (m/s) is 3.5; allowed: float, 0.0 to 2.0"),
        ("error[config-unknown-key]", 3, 1, 7, "unknown parameter `devise`; did you mean `device`?"),
    ]
    config.write_text('[params]\ndevice = "x"\n')
    assert lint(capsys, config, *against) == []


def test_a_folder_means_the_configurations_of_its_components_too(
    explorer: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (explorer / "pyproject.toml").write_text("[tool]\n")
    (explorer.parent / "etc").mkdir()
    (explorer.parent / "etc" / "other.toml").write_text("[of_another_program]\n")
    network = 'import "explorer/explorer.cdsl";\nDeployment net { Component explorer { }; };'
    (explorer.parent / "net.ddsl").write_text(network)
    assert rcgen([str(explorer / "explorer.cdsl")]) == 0
    capsys.readouterr()
    (explorer / "etc" / "config.toml").write_text('[params]\ndevice = "x"\nmax_speed = "fast"\n')
    found = [each for each in lint(capsys, explorer.parent) if each[0].startswith("error[config")]
    assert [each[:3] for each in found] == [("error[config-wrong-type]", 3, 13)]


def test_ports_are_checked_if_the_model_is_a_component(explorer: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = explorer / "etc" / "config.toml"
    config.write_text('[params]\ndevice = "x"\n[ports.lasr]\n[ports.laser]\nmiddleware = "zermq"\n')
    assert lint(capsys, config, "--against", explorer / "explorer.pdsl") == []
    assert [each[:4] for each in lint(capsys, config, "--against", explorer / "explorer.cdsl")] == [
        ("error[config-unknown-key]", 3, 8, 12),
        ("error[config-unknown-value]", 5, 14, 21),
    ]


def test_unfinished_toml_is_reported_at_its_end(explorer: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = explorer / "etc" / "config.toml"
    config.write_text('[params]\ndevice = "x')
    assert [each[:4] for each in lint(capsys, config)] == [("error[config-syntax]", 2, 11, 12)]


def test_a_configuration_needs_a_model(explorer: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = explorer / "etc" / "config.toml"
    config.write_text("")
    (explorer / "other.cdsl").write_text("Component other { language python; };")
    [(said, *_)] = lint(capsys, config)
    assert said == "error[config-without-model]"
    assert [each[0] for each in lint(capsys, config, "--against", explorer / "explorer.psdl")] == ["error[unreadable]"]


def test_a_model_that_is_wrong_is_said_instead(explorer: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (explorer / "explorer.pdsl").write_text("ComponentParams explorer { max_speed float 5 0:2; };")
    (explorer / "etc" / "config.toml").write_text("[params]\nmax_speed = 9\n")
    assert [each[0] for each in lint(capsys, explorer / "etc" / "config.toml")] == ["error[bad-default]"]


def test_a_model_whose_name_begins_like_a_configuration_is_a_model(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "configurator.cdsl").write_text("Component configurator { langage python; };")
    assert [each[0] for each in lint(capsys, folder / "configurator.cdsl")] == ["error[syntax]"]


def test_a_file_in_etc_that_is_called_a_configuration_is_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "etc").mkdir()
    (tmp_path / "arm.cdsl").write_text("Component arm { language python; };")
    (tmp_path / "etc" / "generic_config").write_text("period = \n")
    monkeypatch.chdir(tmp_path)
    assert "unknown-language" not in str(lint(capsys, Path("etc/generic_config")))
