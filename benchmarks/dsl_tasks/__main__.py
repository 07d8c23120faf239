"""The five tasks, each done both ways, and what that took. Ends with 1 if one of them does not do what it should."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from ..tables import Table, as_text, fill
from .project import Project, prepare
from .tasks import add_class, add_method, add_proxy, deploy_network, provide_interface

TASKS: tuple[ModuleType, ...] = deploy_network, add_class, add_method, provide_interface, add_proxy
HEAD = "task", "lines, with the languages", "lines, by hand", "files, with the languages", "files, by hand", "generator"
NOTE = (
    "Lines that were written or changed, without blank ones, and files they are in; s that `rcgen` took. "
    "What both ways share is counted in both: what a method does, for instance."
)


@dataclass(frozen=True)
class Done:
    """What it took to do a task one way."""

    lines: int
    files: tuple[str, ...]
    seconds: float


def main(arguments: Sequence[str] | None = None) -> int:
    options = _parser().parse_args(arguments)
    chosen = [each for each in TASKS if not options.only or _name(each) in options.only]
    with tempfile.TemporaryDirectory(prefix="dsl-tasks-") as scratch:
        folder = options.keep or Path(scratch)
        start = prepare(folder / "start")
        rows = [_row(task, start, folder) for task in chosen]
    table = Table("tasks", "Five tasks, with the languages and by hand", HEAD, rows, labels=1, note=NOTE)
    print(as_text(table))
    if options.page:
        options.page.write_text(fill(options.page.read_text(), [table]))
    return 0


def do(task: ModuleType, way: str, start: Path, root: Path) -> Done:
    """Do a task in a new project, and see that it was done. Raises AssertionError if it was not."""
    project = Project(root, start)
    getattr(task, way)(project)
    task.behaves(project)
    return Done(project.lines, project.touched, project.seconds)


def _row(task: ModuleType, start: Path, folder: Path) -> tuple[str, ...]:
    print(f"{task.TITLE} …", file=sys.stderr)
    dsl, hand = (do(task, way, start, folder / _name(task) / way) for way in ("with_dsl", "by_hand"))
    took = f"{dsl.seconds:.1f} s" if dsl.seconds else "–"
    return task.TITLE, str(dsl.lines), str(hand.lines), str(len(dsl.files)), str(len(hand.files)), took


def _name(task: ModuleType) -> str:
    return task.__name__.rpartition(".")[2]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.dsl_tasks", description=__doc__)
    names = [_name(task) for task in TASKS]
    parser.add_argument("--only", action="append", choices=names, help="only that task; may be repeated")
    parser.add_argument(
        "--keep", type=Path, metavar="DIR", help="leave the projects in this new folder, to be looked at"
    )
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the table into this page")
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
