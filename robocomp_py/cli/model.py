"""Shared by commands that compare what runs with what a network declares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .common import show
from .network import network


def declared(text: str, include: Sequence[Path] = ()) -> Mapping[str, Any]:
    """The plan of a network that runs, by its file or by its name; else what its file declares. As `Plan.to_json`.

    Raises DeploymentError; what is wrong with a file is printed.
    """
    from ..deploy.client import NotRunning, network_of, not_running, running_plan

    name = network_of(text)
    plan = running_plan(name)
    if plan is not None:
        return plan
    path = network(text)
    if path.suffix != ".ddsl":
        raise NotRunning(not_running(name, "give it a DDSL file"))
    return _planned(path, include)


def _planned(path: Path, include: Sequence[Path]) -> Mapping[str, Any]:
    """What a file declares that does not run."""
    from ..deploy.auto import usable
    from ..deploy.hosts.addresses import is_own
    from ..deploy.plan import Overrides
    from ..deploy.planner import make_plan
    from ..dsl.workspace import Workspace
    from ..errors import DeploymentError

    workspace = Workspace(include)
    plan = make_plan(path, workspace, Overrides(), usable, is_here=is_own)
    if plan is None:
        show(workspace.report.diagnostics)
        raise DeploymentError(f"{path} is wrong; see above")
    return plan.to_json()
