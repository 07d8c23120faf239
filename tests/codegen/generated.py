"""Components generated for tests."""

from __future__ import annotations

import importlib
import shutil
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from robocomp_py.codegen.generate import Artifact, Model, generate
from robocomp_py.dsl.workspace import Workspace
from robocomp_py.runtime.load import load_worker
from robocomp_py.runtime.worker import Worker

MODELS = Path(__file__).parent / "models"
NAMES = ("everything", "names", "patrol", "plain", "points", "ship", "towers")
"""The components that have golden files."""


def linked(cdsl: Path) -> Model:
    """What a CDSL file and all it uses come to."""
    workspace = Workspace()
    found = workspace.component(cdsl)
    assert found is not None, "\n".join(each.render() for each in workspace.report.diagnostics)
    return Model(found.component, found.modules, cdsl.name, found.params, statemachine=found.statemachine)


@cache
def golden_model(name: str) -> Model:
    """The model of a component that has golden files."""
    return linked(MODELS / f"{name}.cdsl")


@cache
def artifacts(name: str) -> tuple[Artifact, ...]:
    return generate(golden_model(name))


def model_in(folder: Path, **texts: str) -> Path:
    """Write these files (`arm_cdsl="…"` is arm.cdsl); the path of the CDSL file among them."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (folder / name.replace("_cdsl", ".cdsl").replace("_idsl", ".idsl").replace("_pdsl", ".pdsl")).write_text(text)
    return next(folder.glob("*.cdsl"))


def copied(name: str, folder: Path) -> Path:
    """The model of a golden component in a folder of its own; the path of its CDSL file."""
    shutil.copytree(MODELS, folder, dirs_exist_ok=True)
    for other in folder.glob("*.cdsl"):
        if other.stem != name:
            other.unlink()
    return folder / f"{name}.cdsl"


def snapshot(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, by its path there; of a link, where it leads. Caches are left out."""
    return {
        str(path.relative_to(folder)): str(path.readlink()).encode() if path.is_symlink() else path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if (path.is_symlink() or path.is_file()) and "__pycache__" not in path.parts
    }


def loaded(folder: Path) -> type[Worker[Any]]:
    """The SpecificWorker of a generated component."""
    return load_worker(folder)


def module_of(worker: type[Worker[Any]], name: str) -> ModuleType:
    """A module of a component's generic part."""
    return importlib.import_module(f"{worker.__module__.rpartition('.')[0]}.generic.{name}")
