"""`rcgen`: components from their models."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from .. import installed
from ..codegen.generate import (
    DEFAULT_MIDDLEWARE,
    Artifact,
    GenerationError,
    Model,
    Owner,
    generate,
    starter,
    starter_specifics,
)
from ..codegen.stubs import find_stubs
from ..codegen.write import compare, remove_stale, write
from ..dsl.workspace import Workspace, read_file
from ..spelling import unknown
from .common import FINE, WRONG, add_include, command, complain, parser, show

_EXAMPLES = """\
examples:
  rcgen camera.cdsl                       generate camera's Python beside its model
  rcgen camera.cdsl --middleware zeromq   ... and choose what carries its messages
  rcgen net.ddsl                          generate every component of a network
  rcgen --check camera.cdsl               exit 1 if something is out of date (for CI)
  rcgen --new Hello                       write a starter component into hello/

The folder generic/ is rewritten on every run. specificworker.py, etc/config.toml, README.md
and tests/ are written once and then yours. Imports are looked for beside the importing file,
in -I folders, $ROBOCOMP_INTERFACES, $ROBOCOMP/interfaces/IDSLs, ~/robocomp/interfaces/IDSLs,
/opt/robocomp/interfaces/IDSLs and among the interfaces shipped with robocomp_py.

exit status: 0 fine, 1 wrong input or (with --check) out of date, 2 usage
"""

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*\Z")
_MIDDLEWARE = re.compile(r'^    middleware = "(\w+)"$', re.MULTILINE)


@dataclass(frozen=True)
class _Job:
    """One component to generate, and where."""

    model: Model
    root: Path
    artifacts: tuple[Artifact, ...]


@command
def main(arguments: Sequence[str] | None = None) -> int:
    made = _parser()
    options = made.parse_args(arguments)
    if bool(options.new) == bool(options.models):
        made.error("give it components or networks (.cdsl, .ddsl), or --new NAME")
    if options.new and options.check:
        made.error("--check is for components that are there")
    if options.middleware and options.middleware not in installed.transports():
        return complain(f"rcgen: {unknown('middleware', options.middleware, installed.transports())}")
    try:
        if options.new:
            return _new(options.new, options.output or Path(options.new.lower()), options.middleware)
        jobs = _jobs(options.models, options.include, options.output, options.middleware)
        if jobs is None:
            return WRONG
        for job in jobs:
            if library := _library(job.root):
                print(f"rcgen: warning: {library}; rename it", file=sys.stderr)
        return _check(jobs) if options.check else _write(jobs)
    except GenerationError as exc:
        return complain(f"rcgen: {exc}")


def _parser() -> argparse.ArgumentParser:
    made = parser("rcgen", "Generate the Python of components from their CDSL, IDSL and PDSL files.", _EXAMPLES)
    made.add_argument("models", nargs="*", type=Path, metavar="FILE", help="component (.cdsl) or network (.ddsl)")
    made.add_argument("--middleware", metavar="NAME", help="what carries the messages (default: as before, or zeromq)")
    made.add_argument(
        "-o", dest="output", type=Path, metavar="DIR", help="folder of the component (default: the model's)"
    )
    add_include(made)
    made.add_argument("--check", action="store_true", help="write nothing; exit 1 and list what is out of date")
    made.add_argument("--new", metavar="NAME", help="write a commented starter component")
    return made


def _jobs(models: list[Path], include: list[Path], output: Path | None, middleware: str | None) -> list[_Job] | None:
    """What is to be generated; None if a model is wrong, which has been said then."""
    workspace = Workspace(include)
    paths = _components(models, workspace)
    found = [(path, workspace.component(path)) for path in paths]
    show(workspace.report.diagnostics)
    if workspace.report.errors:
        return None
    jobs: dict[Path, _Job] = {}
    for path, linked in found:
        root = output or path.parent
        if root.resolve() in jobs:
            other = jobs[root.resolve()].model.cdsl
            raise GenerationError(f"{other} and {path.name} would share {root}/; nothing was written")
        assert linked is not None, "there was no error"
        chosen = middleware or _middleware_before(root) or DEFAULT_MIDDLEWARE
        model = Model(linked.component, linked.modules, path.name, linked.params, chosen)
        jobs[root.resolve()] = _Job(model, root, generate(model))
    return list(jobs.values())


def _components(models: list[Path], workspace: Workspace) -> list[Path]:
    """The CDSL files meant: those given, and those of the networks given."""
    found: list[Path] = []
    for path in models:
        match path.suffix.lower():
            case ".cdsl":
                found.append(path)
            case ".ddsl":
                found += workspace.components_of(path)
            case ".idsl" | ".pdsl":
                raise GenerationError(f"{path} is no component: give rcgen a .cdsl or .ddsl that uses it")
            case _:
                workspace.check(path)
    return list(dict.fromkeys(found))


def _middleware_before(root: Path) -> str | None:
    """What an existing generic part was generated for."""
    try:
        text = read_file(root / "generic" / "genericworker.py").decode(errors="replace")
    except OSError:
        return None
    found = _MIDDLEWARE.search(text)
    return found[1] if found else None


_NEEDED = ("jinja2", "lark", "msgpack", "numpy", "pytest", "rich", "robocomp_py", "zmq")
"""What components, their tests and their generator import, beside the standard library."""


def _library(root: Path) -> str:
    """What is wrong with the name of a component's folder, if it is that of something that is imported by name."""
    name = root.resolve().name
    if name not in (*_NEEDED, *sys.stdlib_module_names):
        return ""
    whose = "a library that components need" if name in _NEEDED else "a module of Python"
    return f"{root} is called like {whose}: what is started beside it would import this folder instead"


def _check(jobs: list[_Job]) -> int:
    lines = [line for job in jobs for line in compare(job.artifacts, job.root).lines(job.root)]
    for line in lines:
        print(line)
    return WRONG if lines else FINE


def _write(jobs: list[_Job]) -> int:
    for job, changes in zip(jobs, write(*((job.root, job.artifacts) for job in jobs)), strict=True):
        done = [f"{len(changes.written)} written"] if changes.written else []
        done += [f"{len(changes.removed)} removed"] if changes.removed else []
        print(f"{job.model.component.name}: {', '.join(done) or 'up to date'} in {job.root}/ ({job.model.middleware})")
        _announce_stubs(job)
    return FINE


def _announce_stubs(job: _Job) -> None:
    """Say which methods the specific part has to add or change, and how they begin."""
    path = job.root / "specificworker.py"
    stubs = find_stubs(read_file(path).decode(errors="replace"), job.model)
    if stubs.missing:
        print(f"\n{path} lacks {', '.join(stubs.missing)}; add to SpecificWorker:\n")
        if stubs.imports:
            print(stubs.imports)
        print("\n".join(stubs.missing.values()))
    gone = [
        name for name in stubs.gone if not (job.root / "generic" / f"{name}.py").exists()
    ]  # or it is the user's own
    if gone:
        print(f"\n{path} imports {', '.join(gone)} of generic/, where it is not generated any more; change that")
    for name, begins in stubs.unfit.items():
        print(f"\n{path}: {name} does not take what it is given; it must begin with:\n\n    {begins}")


def _new(name: str, root: Path, middleware: str | None) -> int:
    if not _NAME.match(name):
        return complain(f"rcgen: {name!r} is no name for a component: letters and digits, a letter first")
    library = _library(root)
    if library:
        return complain(f"rcgen: {library}; choose another name, or another folder by -o DIR")
    name = name[:1].upper() + name[1:]
    remove_stale(root)
    if root.exists() and (not root.is_dir() or any(root.iterdir())):
        return complain(f"rcgen: {root} exists and is no empty folder; nothing was written")
    models = {root / file: text for file, text in starter(name).items()}
    cdsl = f"{name.lower()}.cdsl"
    workspace = Workspace(read=lambda path: models[path].encode() if path in models else read_file(path))
    found = workspace.component(root / cdsl)
    assert found is not None, "the starter is right, as tests show"
    model = Model(found.component, found.modules, cdsl, found.params, middleware or DEFAULT_MIDDLEWARE)
    instead = starter_specifics(model, name)
    artifacts = [Artifact(PurePosixPath(path.name), text, Owner.USER) for path, text in models.items()]
    artifacts += [Artifact(a.path, instead.get(a.path, a.text), a.owner) for a in generate(model)]
    write((root, artifacts))
    print(f"{root}/ holds a component that runs as it is:\n\n    rc run {root}\n    pytest {root}\n")
    return FINE


if __name__ == "__main__":
    raise SystemExit(main())
