"""Each mistake is told by its code, at its place, and nothing else is said; of several, all are, in one pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import chdir
from pathlib import Path
from types import ModuleType

import pytest

from robocomp_py.cli import lint
from robocomp_py.dsl.diagnostics import Diagnostic

from . import cdsl, configuration, ddsl, idsl, pdsl, smdsl
from .seed import Seed, sow

LANGUAGES = {"idsl": idsl, "cdsl": cdsl, "pdsl": pdsl, "ddsl": ddsl, "smdsl": smdsl, "configuration": configuration}
EVERY = [(name, seed) for name, language in LANGUAGES.items() for seed in language.SEEDS]

pytestmark = pytest.mark.usefixtures("standard_folders_are_empty")


def checked(files: Mapping[str, str], folder: Path, *others: str) -> list[Diagnostic]:
    """What `rc lint` says of files with these texts, and of others in their folder."""
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    with chdir(folder):
        checked_alone = (name for name in (*files, *others) if not name.endswith(".toml") or name == "config.toml")
        return lint.check([Path(name) for name in checked_alone])


def check_all_are_told(language: ModuleType, seeds: Sequence[Seed], folder: Path) -> None:
    files, places = sow(language.RIGHT, seeds)
    found = checked(files, folder)
    said = [(str(each.span.source.path), each.span.start, each.span.end, each.severity, each.code) for each in found]
    wanted = [(seed.file, *place, seed.severity, seed.code) for seed, place in zip(seeds, places, strict=True)]
    assert sorted(said) == sorted(wanted), "\n".join(each.render() for each in found)


@pytest.mark.parametrize("name", LANGUAGES)
def test_without_a_mistake_nothing_is_said(name: str, tmp_path: Path) -> None:
    assert [each.render() for each in checked(LANGUAGES[name].RIGHT, tmp_path)] == []


@pytest.mark.parametrize(("name", "seed"), EVERY, ids=[f"{name}: {seed.name}" for name, seed in EVERY])
def test_an_error_is_reported_by_its_code_at_its_place_and_no_other_is(name: str, seed: Seed, tmp_path: Path) -> None:
    check_all_are_told(LANGUAGES[name], [seed], tmp_path)


@pytest.mark.parametrize("name", LANGUAGES)
def test_independent_errors_are_all_reported_in_one_pass_and_only_once(name: str, tmp_path: Path) -> None:
    language = LANGUAGES[name]
    together = [seed for seed in language.SEEDS if seed.name in language.TOGETHER]
    assert len(together) == len(language.TOGETHER) >= 8
    check_all_are_told(language, together, tmp_path)


@pytest.mark.parametrize("name", [name for name, each in LANGUAGES.items() if hasattr(each, "BESIDE_A_MISSING_IMPORT")])
def test_an_import_that_is_not_found_hides_only_what_may_come_of_it(name: str, tmp_path: Path) -> None:
    language = LANGUAGES[name]
    wanted = language.BESIDE_A_MISSING_IMPORT
    together = [seed for seed in language.SEEDS if seed.name in wanted]
    assert len(together) == len(wanted)
    check_all_are_told(language, together, tmp_path)


def test_there_are_enough_of_them() -> None:
    assert len(EVERY) >= 60
    assert all(len({seed.name for seed in language.SEEDS}) == len(language.SEEDS) for language in LANGUAGES.values())
