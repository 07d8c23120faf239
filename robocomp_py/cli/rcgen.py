"""`rcgen`: components from their models."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from ..codegen.generate import DEFAULT_MIDDLEWARE, Artifact, Model, Owner, generate, starter, starter_specifics
from ..codegen.stubs import missing_imports, missing_methods
from ..codegen.write import GenerationError, outdated, write
from ..dsl.workspace import Workspace
from .common import FINE, USAGE, WRONG, add_include, complain, parser, show

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
"""

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*\Z")


@dataclass(frozen=True)
class _Job:
    """One component to generate, and where."""

    model: Model
    root: Path
    artifacts: tuple[Artifact, ...]


def main(arguments: Sequence[str] | None = None) -> int:
    options = _parser().parse_args(arguments)
    if options.new:
        return _new(options.new, options.output or Path(options.new.lower()), options.middleware)
    if not options.models:
        _parser().print_usage(sys.stderr)
        return USAGE
    if options.output and len(options.models) > 1:
        print("rcgen: -o takes one component only", file=sys.stderr)
        return USAGE
    jobs = _jobs(options.models, options.include, options.output, options.middleware)
    if jobs is None:
        return WRONG
    return _check(jobs) if options.check else _write(jobs)


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
    jobs = []
    for path in _components(models, workspace):
        found = workspace.component(path)
        if found is None:
            continue
        root = output or path.parent
        chosen = middleware or _middleware_before(root) or DEFAULT_MIDDLEWARE
        model = Model(found.component, found.modules, path.name, found.params, chosen)
        jobs.append(_Job(model, root, generate(model)))
    show(workspace.report.diagnostics)
    return None if workspace.report.errors else jobs


def _components(models: list[Path], workspace: Workspace) -> list[Path]:
    """The CDSL files meant: those given, and those of the networks given."""
    found: list[Path] = []
    for path in models:
        match path.suffix.lower():
            case ".cdsl":
                found.append(path)
            case ".ddsl":
                found += workspace.components_of(path)
            case _:
                workspace.check(path)
                if path.suffix.lower() in (".idsl", ".pdsl"):
                    at = workspace.source(path)
                    if at:
                        message = "rcgen generates components: give it a .cdsl or .ddsl that uses this file"
                        workspace.report.error("not-a-component", message, at.span(0, 0))
    return list(dict.fromkeys(found))


def _middleware_before(root: Path) -> str | None:
    """What an existing generic part was generated for."""
    path = root / "generic" / "genericworker.py"
    if not path.is_file():
        return None
    found = re.search(r'^    middleware = "(\w+)"$', path.read_text(encoding="utf-8"), re.MULTILINE)
    return found[1] if found else None


def _check(jobs: list[_Job]) -> int:
    try:
        lines = [line for job in jobs for line in outdated(job.artifacts, job.root)]
    except GenerationError as exc:
        return complain(exc)
    for line in lines:
        print(line)
    return WRONG if lines else FINE


def _write(jobs: list[_Job]) -> int:
    code = FINE
    for job in jobs:
        try:
            changes = write(job.artifacts, job.root)
        except GenerationError as exc:
            code = complain(exc)
            continue
        done = [f"{len(changes.written)} written"] if changes.written else []
        done += [f"{len(changes.removed)} removed"] if changes.removed else []
        print(f"{job.model.component.name}: {', '.join(done) or 'up to date'} in {job.root}/ ({job.model.middleware})")
        _announce_missing(job)
    return code


def _announce_missing(job: _Job) -> None:
    """Say which methods the specific part has to add, and how they begin."""
    path = job.root / "specificworker.py"
    source = path.read_text(encoding="utf-8")
    stubs = missing_methods(source, job.model.component)
    if not stubs:
        return
    print(f"\n{path} lacks {', '.join(stubs)}; add to SpecificWorker:\n")
    imports = missing_imports(source, job.model.component)
    if imports:
        print(f"from .generic import {', '.join(imports)}\n")
    print("\n".join(stubs.values()))


def _new(name: str, root: Path, middleware: str | None) -> int:
    if not _NAME.match(name):
        return complain(f"rcgen: {name!r} is no name for a component: letters and digits, a letter first")
    name = name[:1].upper() + name[1:]
    if root.exists() and any(root.iterdir()):
        return complain(f"rcgen: {root}/ exists and is not empty; nothing was written")
    models = starter(name)
    cdsl = f"{name.lower()}.cdsl"
    workspace = Workspace(read=lambda path: models[path.name].encode() if path.name in models else path.read_bytes())
    found = workspace.component(root / cdsl)
    assert found is not None, "the starter is right, as tests show"
    model = Model(found.component, found.modules, cdsl, found.params, middleware or DEFAULT_MIDDLEWARE)
    instead = starter_specifics(model, name)
    artifacts = [Artifact(PurePosixPath(file), text, Owner.USER) for file, text in models.items()]
    artifacts += [Artifact(a.path, instead.get(a.path, a.text), a.owner) for a in generate(model)]
    try:
        write(artifacts, root)
    except GenerationError as exc:
        return complain(exc)
    print(f"{root}/ holds a component that runs as it is:\n\n    rc run {root}\n    pytest {root}\n")
    return FINE
