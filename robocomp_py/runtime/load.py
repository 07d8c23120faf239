"""Loads the worker class from a component's folder."""

from __future__ import annotations

import importlib
import importlib.machinery
import importlib.util
import inspect
import os
import re
import shlex
import sys
from pathlib import Path
from typing import Any

from .. import plugins
from ..errors import ComponentError
from ..spelling import beside
from .trace import user_trace
from .worker import Worker

_IN_NO_NAME = re.compile(r"\W")


def load_worker(folder: Path, *, afresh: bool = False, alone: bool = False) -> type[Worker[Any]]:
    """The SpecificWorker of a generated component, in any folder.

    The folder is imported as a package under its own name, so that its files can import each other. With `afresh`, it
    is imported again, so that two instances share no module variables. A component written for another framework is
    loaded by a plug-in, which is given `alone`. The component's .cdsl file stands for its folder. Raises ComponentError
    if there is no such class, or if an import fails.
    """
    if not os.path.exists(folder):  # not Path.exists, which raises if a name is too long
        raise ComponentError(_missing(folder))
    if folder.is_file():
        folder = _folder_of(folder)
    folder = folder.resolve()
    loader = plugins.worker_loader(folder)
    if not (folder / "generic" / "genericworker.py").is_file():
        raise ComponentError(_not_generated(folder, "generic/genericworker.py"))
    if not loader and not plugins.is_ours(folder):
        why = "specificworker.py, and no installed package runs it without one"
        raise ComponentError(_not_generated(folder, why))
    try:
        if loader:
            return loader.load(folder, _import_package(folder, afresh), alone=alone)
        module = importlib.import_module(f"{_import_package(folder, afresh)}.specificworker")
    except ComponentError:
        raise
    except Exception as exc:
        raise ComponentError(f"{folder.name} cannot be imported\n{user_trace(exc)}{_dotted(exc)}") from exc
    worker = getattr(module, "SpecificWorker", None)
    if not (inspect.isclass(worker) and issubclass(worker, Worker)):
        raise ComponentError(f"{folder / 'specificworker.py'} has no class SpecificWorker(GenericWorker)")
    return worker


def _dotted(exc: Exception) -> str:
    """Advice for an import of what stands in the folder of the component, which needs a dot; "" for other errors."""
    name = exc.name if isinstance(exc, ModuleNotFoundError) and exc.name else ""
    if name.split(".")[0] != "generic":
        return ""
    return f"\nwrite `from .{name} import …`, with a dot: a component is a package"


def _missing(folder: Path) -> str:
    near = beside(folder)
    return f"there is no folder {folder}" + (f"; did you mean `{near}`?" if near else "")


def _folder_of(file: Path) -> Path:
    if file.suffix.lower() != ".cdsl":
        raise ComponentError(f"{file} is a file, not a component; give the component's folder or its .cdsl")
    return file.parent


def _not_generated(folder: Path, lacking: str) -> str:
    models = sorted(folder.glob("*.cdsl"))
    remedy = f"run: rcgen {shlex.quote(str(models[0]))}" if len(models) == 1 else "run rcgen on its .cdsl"
    return f"{folder} is not a generated component: it has no {lacking}; {remedy}"


def _is_taken(name: str, folder: Path) -> bool:
    """Whether another module has this name, which may be imported later."""
    found = importlib.util.find_spec(name)
    places = found.submodule_search_locations if found else None
    return found is not None and (places is None or str(folder) not in map(str, map(Path, places)))


def _import_package(folder: Path, afresh: bool) -> str:
    """Import a folder as a package, once unless `afresh`. Returns the name of the package."""
    stem = _IN_NO_NAME.sub("_", folder.name) or "component"
    name, number = stem, 1
    while name in sys.modules or _is_taken(name, folder):
        if not afresh and getattr(sys.modules.get(name), "__path__", None) == [str(folder)]:
            return name
        number += 1
        name = f"{stem}_{number}"
    init = folder / "__init__.py"
    places = [str(folder)]
    spec = importlib.util.spec_from_file_location(name, init, submodule_search_locations=places)
    if spec is None or not init.is_file():  # a namespace package
        spec = importlib.machinery.ModuleSpec(name, None, is_package=True)
        spec.submodule_search_locations = places
    package = importlib.util.module_from_spec(spec)
    sys.modules[name] = package
    if spec.loader:
        spec.loader.exec_module(package)
    return name
