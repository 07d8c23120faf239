"""Checks whether generated code is up to date with its models.

`rcdeploy` refuses such components; `rc run` and `rc lint` warn of them.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # running a component must not import the languages
    from ..dsl.workspace import LinkedComponent, Workspace

_MODELS = (".cdsl", ".idsl", ".pdsl", ".smdsl", ".scxml")

_NAMED = re.compile(rb'"([^"\n]+)"|<([^>\n]+)>')
"""What may be the name of an imported file."""

_TOGETHER = 1.0
"""Seconds within which a checkout writes the files of a component, in any order."""


def message(name: str, lines: Sequence[str]) -> str:
    """The message about a component, with `lines` about its files."""
    return "\n  ".join((f"`{name}` is not generated from its models as they are now", *lines))


def remedy(model: Path) -> str:
    return f"run: rcgen {shlex.quote(str(model))}"


def outdated(linked: LinkedComponent) -> list[str]:
    """A line for each generated file that differs from what its models make now."""
    from ..codegen.generate import GenerationError, Model, generate_generic
    from ..codegen.write import compare
    from ..contract.middleware import AUTO, generated_for
    from ..version import __version__

    folder = linked.path.parent
    try:
        worker = (folder / "generic" / "genericworker.py").read_text(encoding="utf-8", errors="replace")
        if f" by rcgen {__version__}:" not in worker.partition("\n")[0]:
            return []  # another version generates other text from the same models, so a comparison means nothing
        middleware = generated_for(folder) or AUTO
        artifacts = generate_generic(
            Model(linked.component, linked.modules, linked.path.name, linked.params, middleware)
        )
        return compare(artifacts, folder).lines(folder)
    except (OSError, GenerationError) as exc:
        return [str(exc)]


def warn_of(path: Path, workspace: Workspace) -> None:
    """Report a warning if the component of a CDSL file was generated from other models."""
    linked = workspace.component(path)
    if linked is None or linked.model is None or not (path.parent / "generic" / "genericworker.py").is_file():
        return
    if lines := outdated(linked):
        name = linked.model.name
        workspace.report.warning("out-of-date", message(name.text, lines), name.span, remedy(path))


def warn(folder: Path) -> None:
    """Print a warning if a component that is about to run was generated from other models.

    Models are only read if one of them is newer than the generated code, since to read them takes longer than to start
    a component.
    """
    model = None
    with contextlib.suppress(OSError, ValueError):  # the start of the component tells what is wrong with the folder
        model = _newer_model(folder)
    if model is None:
        return
    from ..dsl.workspace import Workspace
    from .common import show

    workspace = Workspace()
    warn_of(model, workspace)
    show(each for each in workspace.report.diagnostics if each.code == "out-of-date")


def _newer_model(folder: Path) -> Path | None:
    """The CDSL file of a component, if a file of its models is newer than all of its generated code."""
    found = [folder] if folder.suffix.lower() == ".cdsl" else sorted(folder.glob("*.cdsl"))
    if len(found) != 1:
        return None
    [model] = found
    generic = model.parent / "generic"
    made = max(each.stat().st_mtime for each in generic.iterdir() if each.suffix == ".py")
    return model if any(each.stat().st_mtime > made + _TOGETHER for each in _models(model)) else None


def _models(model: Path) -> Iterator[Path]:
    """The files of the languages beside a component, and what they import from other folders of the user."""
    listed = [Path(each) for each in os.environ.get("ROBOCOMP_INTERFACES", "").split(os.pathsep) if each]
    found = {each: None for each in model.parent.iterdir() if each.suffix.lower() in _MODELS}
    waiting = list(found)
    while waiting:
        path = waiting.pop()
        yield path
        for names in _NAMED.findall(path.read_bytes()):
            name = os.fsdecode(names[0] or names[1])
            if Path(name).suffix.lower() not in _MODELS:
                continue
            there = next((each for base in (path.parent, *listed) if (each := base / name).is_file()), None)
            if there and there not in found:
                found[there] = None
                waiting.append(there)
