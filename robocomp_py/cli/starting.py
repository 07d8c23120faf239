"""New components: where they may be, and how they are written."""

from __future__ import annotations

import keyword
import re
import sys
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from ..contract.middleware import AUTO, carrier
from ..errors import ConfigurationError

if TYPE_CHECKING:
    from ..codegen.generate import Model

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*\Z")

_NEEDED = ("jinja2", "lark", "msgpack", "numpy", "pytest", "rich", "robocomp_py")
"""Libraries that components, their tests and their generator import, besides the middleware."""


def library(root: Path) -> str:
    """Why the name of a component's folder is wrong, if it is that of an imported library; otherwise ""."""
    from ..transports.deployment import deployments

    name = root.resolve().name
    needed = {*_NEEDED, *(module for each in deployments().values() for module, _ in each.modules)}
    if name not in needed | sys.stdlib_module_names:
        return ""
    whose = "a library that components need" if name in needed else "a module of Python"
    return f"{root} has the name of {whose}: programs started beside it would import this folder instead"


def absent(middleware: str) -> str:
    """Why a middleware, or what carries messages of `auto(…)`, cannot be used on this machine, and the remedy.

    "" if its packages are installed, or if none is named.
    """
    from ..transports.base import find_transport
    from ..transports.deployment import deployment_of

    name = carrier(middleware, "")
    lacking = [package for module, package in deployment_of(name).modules if find_spec(module) is None] if name else []
    if not lacking:
        return ""
    try:
        find_transport(name)  # its error may name a better remedy
    except ConfigurationError as exc:
        return str(exc) if "pip install" in str(exc) else f"{exc}; pip install {' '.join(lacking)}"
    return ""


def unfit(name: str, root: Path) -> str:
    """Why no component of this name can be written into a folder; "" if it can."""
    if not _NAME.match(name):
        return f"`{name}` is not a component name: letters, digits and single `_`, a letter first"
    if keyword.iskeyword(name.lower()):
        return f"`{name.lower()}` is a Python keyword; choose another name"
    wrong = library(root)
    if wrong:
        return f"{wrong}; choose another name, or another folder by -o DIR"
    return ""


def begin(
    root: Path,
    cdsl: str,
    texts: Mapping[str, str],
    specifics: Callable[[Model], Mapping[PurePosixPath, str]],
    middleware: str | None,
) -> str:
    """Write a component: its models, whose `texts` have file names, and all that is generated from them.

    `specifics` has the files of the specific part that are not to be as rcgen makes them. Returns why nothing was
    written; "" if all was.
    """
    from ..codegen.generate import Artifact, Model, Owner, generate
    from ..codegen.write import remove_stale, write
    from ..dsl.format import format_text
    from ..dsl.workspace import Workspace, read_file

    remove_stale(root)
    if root.exists() and (not root.is_dir() or any(root.iterdir())):
        return f"{root} exists and is not an empty folder; nothing was written"
    models = {root / file: format_text(text, file.rpartition(".")[2]) for file, text in texts.items()}
    workspace = Workspace(read=lambda path: models[path].encode() if path in models else read_file(path))
    found = workspace.component(root / cdsl)
    assert found is not None, "the models are right, as tests show"
    model = Model(found.component, found.modules, cdsl, found.params, middleware or AUTO)
    instead = specifics(model)
    artifacts = [Artifact(PurePosixPath(path.name), text, Owner.USER) for path, text in models.items()]
    artifacts += [Artifact(each.path, instead.get(each.path, each.text), each.owner) for each in generate(model)]
    write((root, artifacts))
    if wrong := absent(model.middleware):
        print(f"warning: {wrong}", file=sys.stderr)
    return ""
