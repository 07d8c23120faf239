"""The first step of commands that read a network: check it, and print its errors."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from ... import installed
from ...dsl.diagnostics import Diagnostic
from .. import outdated
from ..common import USAGE, WRONG, show
from ..network import overrides_of, tell_notes
from ..progress import Progress

if TYPE_CHECKING:
    from ...deploy.plan import Plan
    from ...dsl.workspace import Workspace


def planned(options: argparse.Namespace, *, as_json: bool = False) -> Plan | int:
    """The plan of `options.network`; the exit code, after printing the reason, if there is none.

    `as_json` prints errors as JSON, one diagnostic a line on standard output.
    """
    from ...deploy.auto import usable
    from ...deploy.hosts.addresses import found, is_here
    from ...deploy.planner import make_plan
    from ...dsl.workspace import Workspace
    from ...garbage import no_collection

    try:
        overrides = overrides_of(options)
    except ValueError as exc:
        print(f"rcdeploy: {exc}", file=sys.stderr)
        return USAGE
    workspace = Workspace(options.include)
    with installed.asked_once(), no_collection(), Progress("rcdeploy") as progress:
        plan = make_plan(options.network, workspace, overrides, usable, found, is_here, progress.over)
        if plan and not _check_generated(options, workspace, progress):
            plan = None
    _show(workspace.report.diagnostics, as_json=as_json and plan is None)
    if plan is None:
        return WRONG
    tell_notes(plan)
    return plan


def _show(diagnostics: Iterable[Diagnostic], *, as_json: bool) -> None:
    """Print diagnostics. If they cannot be written, a correct network runs all the same."""
    from ...deploy.streams import discard

    stream = sys.stdout if as_json else sys.stderr
    try:
        show(diagnostics, as_json=as_json)
        stream.flush()
    except BrokenPipeError:
        raise
    except OSError:
        discard(stream)


# Generated code.


def _check_generated(options: argparse.Namespace, workspace: Workspace, progress: Progress) -> bool:
    """Whether every generic part is up to date with its models, and every specific part has what it needs.

    Reports what is wrong.
    """
    from ...codegen.unchanged import Request, generator, up_to_date
    from ...usercode.check import check_worker

    path: Path = options.network
    progress.show("comparing what was generated")
    request = Request((path,), tuple(options.include))
    if request.record.is_file() and up_to_date(request, generator()) is not None:
        return not workspace.report.errors
    model = workspace.deployment(path)
    paths = workspace.components_of(path)
    components = {linked.component.name.lower(): linked for each in paths if (linked := workspace.component(each))}
    seen: set[str] = set()
    for instance in progress.over(model.instances if model else (), "instances checked"):
        kind = instance.component.text.lower()
        if instance.program or kind in seen or kind not in components:
            continue  # a program is not generated
        seen.add(kind)
        if lines := outdated.outdated(components[kind]):
            text = outdated.message(str(instance.component), lines)
            workspace.report.error("out-of-date", text, instance.component.span, outdated.remedy(path))
        else:
            check_worker(components[kind], workspace)
    return not workspace.report.errors
