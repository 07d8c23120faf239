"""From the plan of a network to the components of a simulation, in this process."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

from ..errors import ComponentError, ConfigurationError, DeploymentError
from ..runtime.commandline import parser_of, prepare
from ..runtime.load import load_worker
from ..runtime.notify import BETWEEN
from ..virtual.simulation import Part
from .plan import Plan
from .process import Process


def parts(plan: Plan) -> list[Part]:
    """The components of a network, in the order of its plan. Raises DeploymentError with all that is in the way."""
    wrong = [*_obstacles(plan)]
    if wrong:
        raise DeploymentError("\n".join(wrong))
    found: list[Part] = []
    for process in plan.processes:
        for name, (folder, arguments) in zip(process.instances, _components(process), strict=True):
            try:
                found.append(_part(name, folder, arguments))
            except (ComponentError, ConfigurationError) as exc:
                wrong.append(f"{process.name}: {exc}")
    if wrong:
        raise DeploymentError("\n".join(wrong))
    return found


def _obstacles(plan: Plan) -> Iterator[str]:
    """What cannot run in virtual time."""
    for process in plan.processes:
        if process.host:
            yield f"{process.name}: a simulation runs in one process, so no component may have a `host`"
        if process.is_program:
            yield (
                f"{process.name}: `path` and `existing` are programs with a time of their own, so they cannot be "
                "simulated; put a component in its place"
            )
        elif process.env:
            yield f"{process.name}: a simulation is one process, so no component may have an `env` of its own"


def _components(process: Process) -> Iterator[tuple[Path, Sequence[str]]]:
    """The folder and the arguments of each component of a process."""
    words = process.command[process.command.index("run") + 1 :]
    for between, group in groupby(words, lambda word: word == BETWEEN):
        if not between:
            folder, *arguments = group
            yield Path(folder), arguments


def _part(name: str, folder: Path, arguments: Sequence[str]) -> Part:
    worker_class = load_worker(folder, afresh=True)
    parser = parser_of(worker_class.component)
    parser.add_argument("--after", action="append")  # the order of the plan keeps to that
    settings, _ = prepare(worker_class, parser.parse_args(arguments))
    return Part(worker_class, settings, name)
