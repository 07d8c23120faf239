"""The same code on every middleware: what people wrote stays as it is, octet by octet, and so does what it does.

The libraries of the middlewares that are not used cannot be imported here, so none can stand in for another.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import runpy
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.cli import rcdeploy, rcgen

from . import story
from .conftest import COMPONENTS

LIBRARIES = {"zeromq": "zmq", "dds": "cyclonedds", "zenoh": "zenoh", "shm": "iceoryx2"}
MIDDLEWARES = tuple(LIBRARIES)
FAST = [word for each in runpy.run_path(str(COMPONENTS / "demo.py"))["FAST"] for word in ("--set", each)]


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example network in a repository of its own, with everything committed."""
    tree = tmp_path_factory.mktemp("network") / "components"
    shutil.copytree(COMPONENTS, tree, ignore=shutil.ignore_patterns("__pycache__", ".*_cache", "*.svg"))
    (tree / ".gitignore").write_text("__pycache__/\n*.svg\n")
    git(tree, "init", "--quiet")
    git(tree, "add", "--all")
    git(tree, "-c", "user.name=test", "-c", "user.email=test@localhost", "commit", "--quiet", "-m", "as it was")
    return tree


def git(tree: Path, *arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=tree, capture_output=True, text=True, check=True).stdout


def changed(tree: Path) -> list[str]:
    """The files that differ from what was committed, or are new."""
    return [line[3:] for line in git(tree, "status", "--porcelain", "--untracked-files=all").splitlines()]


def specific(tree: Path) -> dict[str, str]:
    """The SHA-256 of everything that is not generated."""
    tracked = git(tree, "ls-files").splitlines()
    return {
        name: hashlib.sha256((tree / name).read_bytes()).hexdigest()
        for name in tracked
        if "generic" not in Path(name).parts
    }


def deploy(tree: Path, folder: Path, middleware: str, *more: str) -> None:
    """Run the network to its end where there is only this middleware, and see whether it did what it always does."""
    picture, missing = folder / "story.svg", folder / "missing"
    missing.mkdir()
    for library in set(LIBRARIES.values()) - {LIBRARIES[middleware]}:
        (missing / f"{library}.py").write_text('raise ImportError("this middleware is not used here")')
    drawn = ("--set", f"world.params.picture={picture}")
    command = ("-m", "robocomp_py.cli.rcdeploy", tree / "rescue.ddsl", "--until", "rescue", *FAST, *drawn, *more)
    story.check(story.run(*command, cwd=tree, environment={"PYTHONPATH": str(missing)}))
    assert picture.read_text().startswith("<svg")


LONG = pytest.mark.tool  # needs nothing but time: `make test` has less of it than `make test-tools`


@pytest.mark.parametrize(  # the tests of the demo run it over shm and dds
    "middleware", ["zeromq", *(pytest.param(each, marks=LONG) for each in ("zenoh", "dds", "shm"))]
)
def test_a_network_runs_over_another_middleware_without_any_change(tree: Path, tmp_path: Path, middleware: str) -> None:
    deploy(tree, tmp_path, middleware, "--middleware", middleware)
    assert changed(tree) == []


@pytest.mark.parametrize("middleware", MIDDLEWARES)
def test_a_network_that_is_generated_for_another_middleware_differs_in_what_is_generated(
    tree: Path, middleware: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with generated_for(middleware, tree):
        capsys.readouterr()
        assert rcdeploy.main(["plan", str(tree / "rescue.ddsl"), "--json"]) == 0
        assert {way["middleware"] for way in json.loads(capsys.readouterr().out)["ways"]} == {middleware}


@LONG
def test_a_network_that_is_generated_for_another_middleware_runs(tree: Path, tmp_path: Path) -> None:
    with generated_for("zenoh", tree):  # the tests of the demo run those for dds and auto
        deploy(tree, tmp_path, "zenoh")


@contextlib.contextmanager
def generated_for(middleware: str, tree: Path) -> Iterator[None]:
    """The network, generated for a middleware; what people wrote is as before, then and after the block."""
    before = specific(tree)
    assert len(before) > 25
    try:
        assert rcgen.main([str(tree / "rescue.ddsl"), "--middleware", middleware]) == 0
        assert specific(tree) == before
        assert all("generic" in Path(name).parts for name in changed(tree))
        assert changed(tree), "it was committed for auto"
        yield
        assert specific(tree) == before
    finally:
        git(tree, "checkout", "--quiet", ".")
        git(tree, "clean", "--force", "-d", "--quiet")
