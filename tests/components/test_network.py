"""The example network as a whole: its models, its generated parts, its story."""

from __future__ import annotations

import hashlib
import json
import runpy
from pathlib import Path

import pytest

import robocomp_py
from robocomp_py.cli import rc, rcgen

from . import story
from .conftest import COMPONENTS

INTERFACES = sorted((Path(robocomp_py.__file__).parent / "interfaces").glob("*.idsl"))


@pytest.mark.parametrize("path", INTERFACES, ids=lambda path: path.stem)
def test_the_shipped_interfaces_are_without_diagnostics(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rc.main(["lint", str(path)]) == 0
    assert not any(capsys.readouterr())


def test_the_network_is_without_diagnostics(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc.main(["lint", str(COMPONENTS / "rescue.ddsl")]) == 0
    assert not any(capsys.readouterr())


def test_the_generated_parts_are_what_rcgen_makes_of_the_models(capsys: pytest.CaptureFixture[str]) -> None:
    assert rcgen.main(["--check", str(COMPONENTS / "rescue.ddsl")]) == 0, capsys.readouterr().out


@pytest.mark.parametrize(("middleware", "carrier"), [("auto", "shm"), ("dds", "dds")])
def test_the_story_has_a_good_end_and_shows_what_carried_it_and_that_no_file_has_changed(
    tmp_path: Path, middleware: str, carrier: str
) -> None:
    picture, before = tmp_path / "story.svg", everything()
    demo = (COMPONENTS / "demo.py", "--fast", "--flat", "--picture", picture, "--middleware", middleware)
    said = story.run(*demo, cwd=tmp_path)
    story.check(said)
    assert picture.read_text().startswith("<svg")
    assert everything() == before, "generated for dds, not even what is generated has changed in the checkout"

    table = said[said.index("component  uses") :].split("\n\n")[0].splitlines()[1:]
    links = {(row[0], row[1], row[2]): (row[3], int(row[4])) for row in map(str.split, table)}
    assert len(links) == 10, "one line for each use of an interface by a component"
    assert {over for over, _ in links.values()} == {carrier}
    assert all(number > 0 for _, number in links.values())

    users = runpy.run_path(str(COMPONENTS / "demo.py"))["written_by_users"](COMPONENTS)
    digest = hashlib.sha256(json.dumps(users, sort_keys=True).encode()).hexdigest()
    assert f"generated for {middleware}.\nSHA-256 of them all: {digest}" in said


@pytest.mark.tool  # OpenGL
def test_the_demo_is_in_a_scene_where_one_can_be_simulated(tmp_path: Path) -> None:
    before = everything()
    said = story.run(COMPONENTS / "demo.py", "--fast", cwd=tmp_path)
    story.check(said)
    assert (tmp_path / "rescue.gif").read_bytes().startswith(b"GIF89a")
    assert everything() == before
    table = [row.split() for row in said[said.index("component  uses") :].splitlines()]
    assert ["rescue", "CameraSimplePub", "arena"] in [row[:3] for row in table]


def everything() -> dict[str, str]:
    """The SHA-256 of every file, but for what Python and tools keep for themselves."""
    return {
        str(path): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in COMPONENTS.rglob("*")
        if path.is_file() and not any(part == "__pycache__" or part.startswith(".") for part in path.parts)
    }
