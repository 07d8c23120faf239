"""The plug-in that runs Python components of RoboComp's own generators. See `existing`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from .kind import accepts as accepts
from .kind import component as component

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ...contract.component import Component
    from ...dsl.cdsl.model import Component as Model
    from ...dsl.diagnostics import Diagnostic
    from ...runtime.worker import Worker
    from ..findings import Findings


def load(folder: Path, package: str, *, alone: bool) -> type[Worker[Any]]:
    from .existing import existing_worker  # loads what the component's files may use

    return existing_worker(folder, package, alone)


def adopted(
    component: Component, model: Model | None, found: Sequence[Diagnostic], folder: Path, middleware: str
) -> Findings:
    from ..findings import find  # needs the build half

    return find(component, model, found, folder, middleware)
