"""What is generated, to the byte."""

from __future__ import annotations

import difflib
import json
import os
import subprocess
import sys
from pathlib import Path

import lark
import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.codegen import compiled
from robocomp_py.codegen.generate import environment
from robocomp_py.dsl.tables import make, read_grammar, text_of

from ..dsl.tables import LANGUAGES
from .generated import MODELS, NAMES, copied
from .golden import GOLDEN, OWN, TEXTS, expected

THERE = {path for name in NAMES for path in (GOLDEN / name).rglob("*") if path.is_file() and path.suffix != ".pyc"}


@pytest.fixture(scope="module")
def files() -> dict[Path, str]:
    return dict(expected())


@pytest.mark.parametrize("path", sorted(THERE | {*OWN.values(), TEXTS}), ids=lambda path: "/".join(path.parts[-3:]))
def test_a_file_is_generated_as_expected(path: Path, files: dict[Path, str]) -> None:
    found, wanted = files[path], path.read_text(encoding="utf-8")
    changes = difflib.unified_diff(wanted.splitlines(), found.splitlines(), "expected", "generated", lineterm="")
    assert found == wanted, "\n".join(["`make golden` if this is meant:", *changes])


def test_no_expected_file_is_missing_or_left_over(files: dict[Path, str]) -> None:
    assert set(files) - set(OWN.values()) - {TEXTS} == THERE, "`make golden` if this is meant"


@pytest.mark.parametrize(("seed", "locale"), [("0", "C"), ("1", "C.UTF-8")])
def test_the_same_models_give_the_same_bytes_everywhere(
    seed: str, locale: str, files: dict[Path, str], tmp_path: Path
) -> None:
    """Other folders, other hash seeds, other working directories, other locales."""
    models = {name: copied(name, tmp_path / f"folder {seed}" / name) for name in NAMES}
    environment = {**os.environ, "PYTHONHASHSEED": seed, "LC_ALL": locale, "PYTHONUTF8": "0"}
    command = [sys.executable, "-m", "robocomp_py.cli.rcgen", *map(str, models.values())]
    subprocess.run(command, env=environment, cwd=tmp_path, check=True, capture_output=True)
    for name, cdsl in models.items():
        wanted = {
            path.relative_to(GOLDEN / name): text for path, text in files.items() if GOLDEN / name in path.parents
        }
        assert wanted
        assert {path: (cdsl.parent / path).read_bytes() for path in wanted} == {
            path: text.encode() for path, text in wanted.items()
        }


def test_a_second_run_changes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cdsl = copied("everything", tmp_path)
    assert rcgen([str(cdsl)]) == 0
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in tmp_path.rglob("*") if path.is_file()}
    capsys.readouterr()
    assert rcgen([str(cdsl)]) == 0
    assert "everything: up to date in " in capsys.readouterr().out
    assert {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in before} == before
    assert rcgen(["--check", str(cdsl)]) == 0


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_tables_of_a_parser_are_those_of_its_grammar(language: str) -> None:
    """Other versions of lark make the same ones, or this fails."""
    grammar = read_grammar(language)
    found = json.loads(grammar.tables) | {"lark": lark.__version__}
    assert found == json.loads(text_of(grammar, make(grammar))), "`make golden` if this is meant"


def test_the_code_of_the_templates_is_that_of_the_templates() -> None:
    found, made = (json.loads(text)["code"] for text in (compiled.FILE.read_text(), compiled.text_of(environment())))
    assert found == made, "`make golden` if this is meant"


def test_every_model_has_a_golden_component() -> None:
    assert {path.stem for path in MODELS.glob("*.cdsl")} == set(NAMES)
