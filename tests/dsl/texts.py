"""Texts that are checked as if they were files."""

from __future__ import annotations

from pathlib import Path

from robocomp_py.contract.interface import Interface
from robocomp_py.contract.module import Definition, Module
from robocomp_py.dsl.workspace import LinkedComponent, Workspace, read_file

FOLDER = Path("/nowhere")


def workspace(**texts: str) -> Workspace:
    """A workspace that reads these texts as files: `Arm_idsl="…"` is /nowhere/Arm.idsl."""
    files = {FOLDER / name.replace("_idsl", ".idsl").replace("_pdsl", ".pdsl"): text for name, text in texts.items()}

    def read(path: Path) -> bytes:
        return files[path].encode() if path in files else read_file(path)

    return Workspace(read=read)


def rendered(found: Workspace) -> str:
    return "\n".join(each.render().replace(f"{FOLDER}/", "") for each in found.report.diagnostics)


def module_of(text: str, **others: str) -> Module:
    """What an IDSL text means."""
    found = workspace(Arm_idsl=text, **others)
    module = found.interfaces(FOLDER / "Arm.idsl")
    assert module is not None, rendered(found)
    return module


def definition_of(text: str, name: str) -> Definition:
    module = module_of(text)
    return next(each for each in module.definitions if each.name == f"{module.name}::{name}")


def interface_of(text: str, name: str = "Arm") -> Interface:
    found = definition_of(text, name)
    assert isinstance(found, Interface)
    return found


def component_of(text: str, **others: str) -> LinkedComponent:
    """What a CDSL text means."""
    found = workspace(**{"arm.cdsl": text, **others})
    component = found.component(FOLDER / "arm.cdsl")
    assert component is not None, rendered(found)
    return component
