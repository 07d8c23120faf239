"""The files that are expected to be generated. `python -m tests.codegen.golden` rewrites them; review their diff."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import robocomp_py
from robocomp_py.codegen.generate import generate_module
from robocomp_py.dsl.workspace import SHIPPED, Workspace

from .generated import NAMES, artifacts

GOLDEN = Path(__file__).parent / "golden"
COMMON_BEHAVIOR = Path(robocomp_py.__file__).parent / "runtime" / "RoboCompCommonBehavior.py"
"""The one generated file that is part of the run time."""


def expected() -> Iterator[tuple[Path, str]]:
    """Every golden file with the text it has to have."""
    for name in NAMES:
        for artifact in artifacts(name):
            yield GOLDEN / name / artifact.path, artifact.text
    module = Workspace().interfaces(SHIPPED / "CommonBehavior.idsl")
    assert module is not None
    yield COMMON_BEHAVIOR, generate_module(module)


def main() -> None:
    for name in NAMES:
        shutil.rmtree(GOLDEN / name, ignore_errors=True)
    for path, text in expected():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
