"""What a user's tools make of generated code: strict types, a linter, a formatter."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from mypy import api as mypy

from .generated import NAMES
from .golden import GOLDEN

USE = '''
"""How user code uses the types; what is wrong on purpose is said to be so, and would be reported if it were right."""

from concurrent.futures import Future

import numpy as np
from golden.everything.generic import Everything, Shapes
from golden.everything.specificworker import SpecificWorker
from golden.patrol.specificworker import SpecificWorker as Patrol
from numpy.typing import NDArray


class Worker(SpecificWorker):
    def compute(self) -> None:
        number: int = self.store_proxy.count()
        later: Future[int] = self.store1_proxy.countAsync(deadline=0.5)
        slices, many, middle = self.store_proxy.slices([Everything.Slice(a=1)])
        point: Shapes.Point = middle
        numbers: NDArray[np.float32] = Everything.Containers().numbers
        self.store_proxy.adjust(1.5, Everything.Level.high, note="up")
        self.news_proxy.told("news", [1, 2, 3])
        self.news_proxy.told("news", np.zeros(3))
        rate: int = self.params.rate
        gain: float = self.params.motors[0].gains[0].p
        level: Everything.Level = Everything.usual
        error: Everything.Failed = Everything.Late("why", since=5)

        self.store_proxy.adjust("fast")  # type: ignore[arg-type]
        self.store_proxy.slices([Shapes.Point()])  # type: ignore[list-item]
        text: str = self.store_proxy.count()  # type: ignore[assignment]
        self.store_proxy.cnt()  # type: ignore[attr-defined]
        self.news_proxy.asked()  # type: ignore[attr-defined]
        self.lasr_proxy.get()  # type: ignore[attr-defined]
        Shapes.Point(z=1)  # type: ignore[call-arg]
        self.params.rate = 5  # type: ignore[misc]
        self.params.rat  # type: ignore[attr-defined]

    def Store_count(self) -> str:  # type: ignore[override]
        return ""


class Round(Patrol):
    def compute(self) -> None:
        self.t_waiting_to_working()
        self.t_driving_to_driving.emit()
        active: tuple[str, ...] = self.statemachine.active
        self.statemachine.send("go")
        ended: bool = self.statemachine.ended

        self.t_waiting_to_wokring()  # type: ignore[attr-defined]
        self.t_waiting_to_working(1)  # type: ignore[call-arg]
        self.statemachine.active = ()  # type: ignore[misc]

    def sm_waiting(self, why: str) -> None:  # type: ignore[override]
        pass
'''

CACHE = Path(__file__).parents[2] / ".mypy_cache"
"""That of `make types`, which keeps what there is to know of all that generated code imports."""


def test_generated_code_is_strictly_typed_and_so_is_what_uses_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where `# type: ignore` is needed the types are tight: strict mypy reports those that are not."""
    use = tmp_path / "use.py"
    use.write_text(USE)
    (tmp_path / "golden").symlink_to(GOLDEN)
    trees = [str(tmp_path / "golden" / name) for name in NAMES]
    options = ["--strict", "--explicit-package-bases", "--config-file", "", "--cache-dir", str(CACHE)]
    monkeypatch.chdir(tmp_path)  # where `golden` is a package
    said, errors, code = mypy.run([*options, *trees, str(use)])
    assert (code, errors) == (0, ""), said


def test_linters_and_formatters_accept_generated_code() -> None:
    files = [str(path) for path in sorted(GOLDEN.rglob("*.py"))]
    for command, said in (
        (["check"], "All checks passed!"),
        (["format", "--check"], f"{len(files)} files already formatted"),
    ):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *command, "--no-cache", "--config", str(GOLDEN / "ruff.toml"), *files],
            capture_output=True,
            text=True,
        )
        assert (done.returncode, done.stdout) == (0, f"{said}\n"), done.stdout + done.stderr


@pytest.mark.parametrize("python", ["py311", "py314"], ids=["oldest", "newest"])
def test_the_default_rules_of_ruff_find_nothing_in_generated_code(python: str, tmp_path: Path) -> None:
    """What a user's own CI runs, outside of this checkout and without our configuration."""
    for name in NAMES:
        shutil.copytree(GOLDEN / name, tmp_path / name)
    command = [sys.executable, "-m", "ruff", "check", "--isolated", "--no-cache", "--target-version", python, "."]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "All checks passed!\n"), done.stdout + done.stderr
