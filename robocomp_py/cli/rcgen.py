"""`rcgen`: components from their models."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from .. import installed
from ..codegen import porting
from ..codegen.existing import (
    WORKER,
    Finding,
    Verdict,
    beside,
    in_configuration,
    in_model,
    in_worker,
    is_existing,
    listed,
)
from ..codegen.exporting import Files
from ..codegen.formats import FORMATS, export
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
from ..contract.component import Component
from ..contract.parameters import ParameterSet
from ..dsl.cdsl.parser import parse as parse_cdsl
from ..dsl.diagnostics import Report
from ..dsl.format import format_text
from ..dsl.workspace import Workspace, read_file
from ..errors import ConfigurationError
from ..runtime import settings
from ..spelling import unknown
from .common import FINE, WRONG, add_include, command, complain, parser, show

_EXAMPLES = """\
examples:
  rcgen camera.cdsl                       generate camera's Python beside its model
  rcgen camera.cdsl --middleware zeromq   ... and choose what carries its messages
  rcgen net.ddsl                          generate every component of a network
  rcgen --check camera.cdsl               exit 1 if something is out of date (for CI)
  rcgen --new Hello                       write a starter component into hello/
  rcgen Laser.idsl --to slice -o ice/     write the interfaces in another language
  rcgen components/laser                  a component made by RoboComp: only generic/ is added; of one
                                          in C++, a skeleton and a list of what is to be written

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
    findings: tuple[Finding, ...] | None = None
    """What became of a component that RoboComp's generator made; None of one that is ours."""
    porting: porting.Porting | None = None
    """What is to be written in Python of a component in C++; None of others."""


@command
def main(arguments: Sequence[str] | None = None) -> int:
    made = _parser()
    options = made.parse_args(arguments)
    if options.underscore and options.to != "slice":
        made.error("--underscore is for --to slice")
    if options.to:
        if options.new or options.middleware or not options.models:
            made.error("--to is for interfaces: give it .idsl files, and neither --new nor --middleware")
    elif bool(options.new) == bool(options.models):
        made.error("give it components or networks (.cdsl, .ddsl), or --new NAME")
    if options.json and (options.new or options.to or options.check):
        made.error("--json is for generating components")
    if options.new and options.check:
        made.error("--check is for components that are there")
    if options.middleware and options.middleware not in installed.transports():
        return complain(f"rcgen: {unknown('middleware', options.middleware, installed.transports())}")
    try:
        if options.to:
            return _export(options)
        if options.new:
            return _new(options.new, options.output or Path(options.new.lower()), options.middleware)
        jobs = _jobs(options.models, options.include, options.output, options.middleware)
        if jobs is None:
            return WRONG
        for job in jobs:
            if library := _library(job.root):
                print(f"rcgen: warning: {library}; rename it", file=sys.stderr)
        if options.check:
            return _check(jobs)
        return _write_as_json(jobs) if options.json else _write(jobs)
    except GenerationError as exc:
        return complain(f"rcgen: {exc}")


def _parser() -> argparse.ArgumentParser:
    made = parser("rcgen", "Generate the Python of components from their CDSL, IDSL and PDSL files.", _EXAMPLES)
    made.add_argument(
        "models",
        nargs="*",
        type=Path,
        metavar="FILE",
        help="component (.cdsl, or its folder), network (.ddsl), or with --to interface (.idsl)",
    )
    made.add_argument("--middleware", metavar="NAME", help="what carries the messages (default: as before, or zeromq)")
    made.add_argument(
        "-o", dest="output", type=Path, metavar="DIR", help="folder of the component (default: the model's)"
    )
    add_include(made)
    made.add_argument("--check", action="store_true", help="write nothing; exit 1 and list what is out of date")
    made.add_argument("--json", action="store_true", help="what was written and found, one component a line")
    made.add_argument("--new", metavar="NAME", help="write a commented starter component")
    made.add_argument("--to", choices=FORMATS, metavar="FORMAT", help=_TO)
    made.add_argument("--underscore", action="store_true", help="with --to slice: names may have underscores")
    return made


_TO = (
    f"write .idsl files, and what they import, as {', '.join(FORMATS[:-1])} or {FORMATS[-1]} (-o: where; default: here)"
)


def _export(options: argparse.Namespace) -> int:
    """The interfaces in another language."""
    others = [path for path in options.models if path.suffix.lower() != ".idsl"]
    if others:
        return complain(f"rcgen: {others[0]} is no .idsl file; --to is for interfaces")
    workspace = Workspace(options.include)
    files = Files(tuple({each: None for path in options.models for each in workspace.interface_files(path)}))
    report = workspace.report
    artifacts = () if report.errors else export(files, options.to, report, underscore=options.underscore)
    show(report.diagnostics)
    if report.errors:
        return WRONG
    root = options.output or Path(".")
    if options.check:
        return _say(compare(artifacts, root).lines(root))
    [changes] = write((root, artifacts))
    done = f"{len(changes.written)} written" if changes.written else "up to date"
    print(f"{options.to}: {done} in {root}/")
    return FINE


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
        model = Model(linked.component, linked.modules, path.name, linked.params, chosen, linked.statemachine)
        if is_existing(root):
            findings = tuple(_findings(path, root, linked.component, workspace, chosen))
            jobs[root.resolve()] = _Job(model, root, beside(generate(model), root), findings)
        elif porting.is_cpp(path.parent):
            artifacts = porting.beside(generate(model), root)
            jobs[root.resolve()] = _Job(model, root, artifacts, porting=_to_port(path.parent, root, model))
        else:
            jobs[root.resolve()] = _Job(model, root, generate(model))
    return list(jobs.values())


def _to_port(folder: Path, root: Path, model: Model) -> porting.Porting:
    """What a component in C++ has that is to be written in Python."""
    source, ours = folder / porting.WORKER.parent, root / "specificworker.py"
    try:
        names = porting.sources([path.name for path in source.iterdir() if path.is_file()])
        texts = {f"{source.name}/{name}": read_file(source / name).decode(errors="replace") for name in names}
        written = read_file(ours).decode(errors="replace") if ours.exists() else ""
    except OSError as exc:
        raise GenerationError(f"{exc.filename} cannot be read: {exc.strerror}") from exc
    return porting.porting(texts, written, model)


def _findings(cdsl: Path, root: Path, component: Component, workspace: Workspace, middleware: str) -> Iterator[Finding]:
    """The report of a component that RoboComp's generator made."""
    source = workspace.source(cdsl)
    parsed = parse_cdsl(source, Report()) if source else None
    if parsed:
        yield from in_model(parsed, workspace.report.diagnostics)
    yield from in_worker(read_file(root / WORKER).decode(errors="replace"), component)
    configuration = settings.find(root)
    if configuration is None:
        return
    file = str(configuration.relative_to(root))
    try:
        params = component.params or ParameterSet("")
        document = settings.read_for(configuration, component)
        settings.settle(document, component, middleware)
    except ConfigurationError as exc:
        yield Finding(file, 1, "the file", Verdict.NOT_UNDERSTOOD, str(exc))
    else:
        yield from in_configuration(file, document.notes, params)


def _components(models: list[Path], workspace: Workspace) -> list[Path]:
    """The CDSL files meant: those given, and those of the networks given."""
    found: list[Path] = []
    for path in models:
        match path.suffix.lower():
            case _ if path.is_dir():
                found.append(_model_in(path))
            case ".cdsl":
                found.append(path)
            case ".ddsl":
                found += workspace.components_of(path)
            case ".idsl" | ".pdsl" | ".smdsl" | ".scxml":
                raise GenerationError(_no_component(path))
            case _:
                workspace.check(path)
    return list(dict.fromkeys(found))


def _model_in(folder: Path) -> Path:
    """The CDSL file of a component's folder."""
    found = sorted(folder.glob("*.cdsl"))
    found = [each for each in found if len(found) == 1 or each.stem.lower() == folder.resolve().name.lower()] or found
    if len(found) != 1:
        there = ", ".join(each.name for each in found) or "none"
        raise GenerationError(f"{folder} should hold one .cdsl, and holds {there}; give rcgen the one that is meant")
    return found[0]


def _no_component(path: Path) -> str:
    hint = ", or write it in another language by --to" if path.suffix.lower() == ".idsl" else ""
    return f"{path} is no component: give rcgen a .cdsl or .ddsl that uses it{hint}"


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
    return _say([line for job in jobs for line in compare(job.artifacts, job.root).lines(job.root)])


def _say(lines: list[str]) -> int:
    """What is out of date."""
    for line in lines:
        print(line)
    return WRONG if lines else FINE


def _write(jobs: list[_Job]) -> int:
    for job, changes in zip(jobs, write(*((job.root, job.artifacts) for job in jobs)), strict=True):
        done = [f"{len(changes.written)} written"] if changes.written else []
        done += [f"{len(changes.removed)} removed"] if changes.removed else []
        print(f"{job.model.component.name}: {', '.join(done) or 'up to date'} in {job.root}/ ({job.model.middleware})")
        if job.findings is None:
            _announce_stubs(job)
            if job.porting:
                print("\nIt is a component in C++, whose files stay as they are.")
                print("\n".join(porting.listed(job.porting, job.root)))
        else:
            print(
                f"\nIt was made by RoboComp's generator, its files stay as they are, and `rc run {job.root}` runs it."
            )
            print(f"What is in {job.root}/:\n")
            print("\n".join(listed(job.findings)))
    return FINE


def _write_as_json(jobs: list[_Job]) -> int:
    for job, changes in zip(jobs, write(*((job.root, job.artifacts) for job in jobs)), strict=True):
        found = {
            "component": job.model.component.name,
            "folder": str(job.root),
            "written": changes.written,
            "removed": changes.removed,
            "existing": job.findings is not None,
            "report": [each.to_json() for each in job.findings or ()],
            "porting": job.porting.to_json() if job.porting else None,
        }
        print(json.dumps(found))
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
    models = {root / file: format_text(text, file.rpartition(".")[2]) for file, text in starter(name).items()}
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
