"""`rcgen`: components from their models."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from .. import installed, plugins
from ..codegen import unchanged
from ..contract.middleware import AUTO, carrier, generated_for
from ..dsl.diagnostics import Diagnostic, Severity
from ..errors import ConfigurationError
from ..spelling import unknown
from . import completing, starting
from .common import FINE, USAGE, WRONG, add_include, command, complain, parser, show
from .completing import What, completed
from .progress import Progress

if TYPE_CHECKING:  # if nothing has changed, the generator is not loaded
    from ..codegen.generate import Artifact, Model
    from ..codegen.write import Changes
    from ..dsl.workspace import LinkedComponent, Workspace

_EXAMPLES = """\
examples:
  rcgen camera.cdsl                       generate camera's Python beside its model
  rcgen camera.cdsl --middleware zeromq   ... and choose what carries its messages
  rcgen net.ddsl                          generate every component of a network
  rcgen --stubs camera.cdsl               ... and append the methods that specificworker.py lacks
  rcgen --check camera.cdsl               exit 1 if something is out of date (for CI)
  rcgen --new Hello                       write a starter component into hello/
  rcgen Laser.idsl --to slice -o ice/     write the interfaces in another language
  rcgen components/laser                  a component made by RoboComp: only generic/ is added

The folder generic/ is rewritten on every run. specificworker.py, etc/config.toml, README.md
and tests/ are written once and then yours; --stubs only appends to specificworker.py. Imports
are looked for beside the importing file, in -I folders, $ROBOCOMP_INTERFACES,
$ROBOCOMP/interfaces/IDSLs, ~/robocomp/interfaces/IDSLs, /opt/robocomp/interfaces/IDSLs and
among the interfaces shipped with robocomp_py.

exit status: 0 fine, 1 wrong input or (with --check) out of date, 2 usage
"""


@dataclass(frozen=True)
class _Job:
    """One component to generate, and where."""

    model: Model
    root: Path
    artifacts: tuple[Artifact, ...]
    is_as_before: bool
    """Whether its middleware was chosen in an earlier run."""
    linked: LinkedComponent
    trace: unchanged.Trace
    """The workspace that read its files."""
    adopted: plugins.Adopted | None = None
    """A component of another framework, as understood by a plug-in; None for a component of ours."""

    @property
    def complaints(self) -> list[Diagnostic]:
        """The errors in its specific part, as it is now."""
        from ..dsl.workspace import Workspace
        from ..usercode.check import complaints

        return complaints(self.linked, Workspace(read=self.trace.read), self.root)

    @property
    def command(self) -> str:
        """The command that appends the missing stubs."""
        from ..usercode.check import stubs_command

        return stubs_command(self.linked.path, self.root)


@command
def main(arguments: Sequence[str] | None = None) -> int:
    if completing.is_asked(arguments):
        from .candidates import answer

        return answer(completer, sys.argv[1:])
    with installed.asked_once(), Progress("rcgen") as progress:
        return _run(arguments, progress)


def completer(words: Sequence[str], word: str) -> tuple[argparse.ArgumentParser, Sequence[str]]:
    """The parser for a word behind these, and those of them that it reads."""
    return _parser(), words


def _run(arguments: Sequence[str] | None, progress: Progress) -> int:
    made = _parser()
    options = made.parse_args(arguments)
    if options.to:
        if options.new or options.middleware or not options.models:
            made.error("--to is for interfaces: give it .idsl files, and neither --new nor --middleware")
    elif bool(options.new) == bool(options.models):
        made.error("give it components or networks (.cdsl, .ddsl), or --new NAME")
    if options.json and (options.new or options.to or options.check):
        made.error("--json is for generating components")
    if options.new and options.check:
        made.error("--check is for components that are there")
    if options.stubs and (options.new or options.to or options.check):
        made.error("--stubs is for generating components that are there")
    if wrong := _unknown(options.middleware):
        print(f"rcgen: --middleware {options.middleware}: {wrong}", file=sys.stderr)
        return USAGE
    made_by = ""
    if options.models and not options.to and not (options.check and not _request(options).record.is_file()):
        made_by = unchanged.generator()
        found = unchanged.up_to_date(_request(options), made_by)
        if found is not None and all(options.middleware in (None, each.middleware) for each in found):
            return _tell_unchanged(found, options)
    from ..codegen.generate import GenerationError

    try:
        if options.to:
            return _export(options)
        if options.new:
            return _new(options.new, options.output or Path(options.new.lower()), options.middleware)
        return _generate(options, made_by, progress)
    except (GenerationError, ConfigurationError) as exc:
        progress.erase()
        return complain(f"rcgen: {exc}")


def _request(options: argparse.Namespace) -> unchanged.Request:
    return unchanged.Request(tuple(options.models), tuple(options.include), options.output)


def _generate(options: argparse.Namespace, made_by: str, progress: Progress) -> int:
    from ..codegen.write import write
    from ..dsl.workspace import read_file

    trace = unchanged.Trace(read_file)
    jobs = _jobs(options.models, options.include, options.output, options.middleware, trace, progress)
    if jobs is None:
        return WRONG
    warnings = [f"rcgen: warning: {library}; rename it" for job in jobs if (library := starting.library(job.root))]
    warnings += [f"rcgen: warning: {wrong}" for name in _middlewares(jobs) if (wrong := starting.absent(name))]
    for warning in warnings:
        print(warning, file=sys.stderr)
    if options.check:
        return _check(jobs, progress)
    amended = _amended(jobs) if options.stubs else {}
    progress.show("writing")
    changes = write(*((job.root, job.artifacts) for job in jobs))
    for path, text in amended.items():
        _amend(path, text)
    progress.erase()
    told = _tell_as_json(jobs, changes) if options.json else _tell(jobs, changes, amended)
    is_fine = told and not warnings
    if is_fine:
        components = [each for job in jobs if (each := _up_to_date(job))]
        if len(components) == len(jobs):
            unchanged.remember(_request(options), trace, components, made_by)
    return FINE


def _middlewares(jobs: Sequence[_Job]) -> Collection[str]:
    """What components, and single ports of them, are to use."""
    ports = [port.middleware for job in jobs for port in job.model.component.ports if port.middleware]
    return dict.fromkeys((*(job.model.middleware for job in jobs), *ports)).keys()


def _up_to_date(job: _Job) -> unchanged.Component | None:
    """The record of a written component; None if a file has changed since."""
    from ..codegen.generate import Owner
    from ..codegen.write import origin

    now = unchanged.generic_part(str(job.root))
    own = {str(each.path): each.text for each in job.artifacts if each.owner is Owner.GENERATOR}
    user = [str(each.path) for each in job.artifacts if each.owner is Owner.USER]
    is_whole = not job.adopted and {"specificworker.py", "etc/config.toml"} <= set(user)  # otherwise a plug-in decides
    is_as_written = all(now.get(name) == unchanged.digest(text.encode()) for name, text in own.items())
    others = [name for name, content in now.items() if name not in own and content not in ("link", "special")]
    if not (is_whole and is_as_written) or any(origin(job.root / name) for name in others):
        return None
    if generated_for(job.root) != job.model.middleware or _depends_on_other_folder(job):
        return None
    folders = {str(parent) for each in job.artifacts for parent in each.path.parents} - {"."}
    middleware = job.model.middleware
    name = job.model.component.name
    digest = unchanged.together(now)
    return unchanged.Component(name, str(job.root), middleware, digest, tuple(user), tuple(sorted(folders)))


def _depends_on_other_folder(job: _Job) -> bool:
    """Whether plug-ins are asked about the folder of the model, which is not that of the component."""
    model = job.linked.model
    return job.root != job.linked.path.parent and (model is None or any(model.all("gui")))


def _parser() -> argparse.ArgumentParser:
    made = parser("rcgen", "Generate the Python of components from their CDSL, IDSL and PDSL files.", _EXAMPLES)
    models = made.add_argument(
        "models",
        nargs="*",
        type=Path,
        metavar="FILE",
        help="component (.cdsl, or its folder), network (.ddsl), or with --to interface (.idsl)",
    )
    completed(models, ".cdsl", ".ddsl", ".idsl")
    completed(made.add_argument("--middleware", metavar="NAME", help=_MIDDLEWARE), What.MIDDLEWARE)
    made.add_argument(
        "-o", dest="output", type=Path, metavar="DIR", help="folder of the component (default: the model's)"
    )
    add_include(made)
    made.add_argument("--check", action="store_true", help="write nothing; exit 1 and list what is out of date")
    made.add_argument("--stubs", action="store_true", help="append what specificworker.py lacks to its class")
    made.add_argument(
        "--json", action="store_true", help="print what was written and found as JSON, one component a line"
    )
    made.add_argument("--new", metavar="NAME", help="write a commented starter component")
    languages = plugins.exporters()
    made.add_argument(
        "--to",
        choices=languages,
        metavar="FORMAT",
        help=f"write .idsl files, and what they import, in another language: {plugins.listed(languages)} (-o: where; "
        "default: here)",
    )
    return made


_MIDDLEWARE = (
    "what carries the messages, unless the deployment or its command line says otherwise; auto: the fastest for each "
    "link (default: as before, or auto)"
)


def _export(options: argparse.Namespace) -> int:
    """The interfaces in another language."""
    from ..codegen.exporting import Files
    from ..codegen.formats import export
    from ..codegen.write import compare, write
    from ..dsl.workspace import Workspace

    others = [path for path in options.models if path.suffix.lower() != ".idsl"]
    if others:
        return complain(f"rcgen: {others[0]} is not an .idsl file; --to is for interfaces")
    workspace = Workspace(options.include)
    files = Files(tuple({each: None for path in options.models for each in workspace.interface_files(path)}))
    report = workspace.report
    artifacts = () if report.errors else export(files, options.to, report)
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


def _jobs(
    models: list[Path],
    include: list[Path],
    output: Path | None,
    middleware: str | None,
    trace: unchanged.Trace,
    progress: Progress,
) -> list[_Job] | None:
    """The components to generate; None, after printing the errors, if a model is wrong."""
    from ..codegen.generate import GenerationError, Model, generate
    from ..dsl.workspace import Workspace

    workspace = Workspace(include, trace.read)
    progress.show("reading")
    paths = _components(models, workspace, trace)
    found = [(path, workspace.component(path)) for path in progress.over(paths, "components read")]
    show(workspace.report.diagnostics)
    if workspace.report.errors:
        return None
    trace.is_steady &= not workspace.report.diagnostics  # a warning is repeated in the next run
    jobs: dict[Path, _Job] = {}
    for path, linked in progress.over(found, "components generated"):
        assert linked is not None, "there was no error"
        root = output or path.parent
        if root.resolve() in jobs:
            other = jobs[root.resolve()].model.cdsl
            raise GenerationError(f"{other} and {path.name} would share {root}/; nothing was written")
        before = generated_for(root)
        if not middleware and (wrong := _unknown(before)):
            worker = root / "generic" / "genericworker.py"
            raise GenerationError(f"{worker}: {wrong}; choose one: rcgen {path} --middleware NAME")
        chosen = middleware or before or AUTO
        model = Model(linked.component, linked.modules, path.name, linked.params, chosen, linked.statemachine)
        as_before = not middleware and chosen != AUTO
        artifacts, adopted = _not_configured_yet(generate(model), root), None
        if loader := plugins.worker_loader(root):
            adopted = loader.adopted(linked.component, linked.model, workspace.report.diagnostics, root, chosen)
            artifacts = tuple(each for each in artifacts if _serves_adopted(each))
        jobs[root.resolve()] = _Job(model, root, artifacts, as_before, linked, trace, adopted)
    return list(jobs.values())


def _not_configured_yet(artifacts: tuple[Artifact, ...], root: Path) -> tuple[Artifact, ...]:
    """The artifacts without a configuration, if the folder has one in another form, which stays in use."""
    from ..runtime import settings

    ours = root / "etc" / "config.toml"
    if settings.find(root) in (None, ours):
        return artifacts
    return tuple(each for each in artifacts if root / each.path != ours)


def _serves_adopted(artifact: Artifact) -> bool:
    """Whether an artifact is written for a component that has its own specific part."""
    from ..codegen.generate import Owner

    return artifact.owner is Owner.GENERATOR or artifact.path == PurePosixPath("etc/config.toml")


def _components(models: list[Path], workspace: Workspace, trace: unchanged.Trace) -> list[Path]:
    """The given CDSL files, and those of the given networks."""
    from ..codegen.generate import GenerationError

    found: list[Path] = []
    for path in models:
        match path.suffix.lower():
            case _ if path.is_dir():
                trace.note_models_in(path)
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
    from ..codegen.generate import GenerationError

    found = sorted(folder.glob("*.cdsl"))
    found = [each for each in found if len(found) == 1 or each.stem.lower() == folder.resolve().name.lower()] or found
    if len(found) != 1:
        there = ", ".join(each.name for each in found) or "none"
        raise GenerationError(f"{folder} should hold one .cdsl, but holds {there}; give rcgen the right file")
    return found[0]


def _no_component(path: Path) -> str:
    hint = ", or write it in another language by --to" if path.suffix.lower() == ".idsl" else ""
    return f"{path} is not a component: give rcgen a .cdsl or .ddsl that uses it{hint}"


def _unknown(middleware: str | None) -> str:
    """Why the choice of a middleware is wrong; "" if it is not."""
    name, known = carrier(middleware, ""), installed.transports()
    return unknown("middleware", name, known) if name and name not in known else ""


def _check(jobs: list[_Job], progress: Progress) -> int:
    from ..codegen.write import compare

    progress.erase()
    code = _say([line for job in jobs for line in compare(job.artifacts, job.root).lines(job.root)])
    found = [each for job in jobs for each in job.complaints]
    show(found)
    return WRONG if any(each.severity is Severity.ERROR for each in found) else code


def _say(lines: list[str]) -> int:
    """Print which files are out of date."""
    for line in lines:
        print(line)
    return WRONG if lines else FINE


def _amended(jobs: list[_Job]) -> dict[Path, bytes]:
    """The specific parts that lack methods, with stubs for these methods."""
    from ..codegen.stubs import find_stubs, with_stubs
    from ..usercode.reading import FILE

    found = {}
    for job in jobs:
        stubs = find_stubs(job.root, job.model, job.trace.read)
        if stubs.missing:
            found[job.root / FILE] = with_stubs(job.root, stubs, job.trace.read)
    return found


def _amend(path: Path, text: bytes) -> None:
    from ..codegen.generate import GenerationError
    from .replacing import replace_file

    try:
        replace_file(path, text)
    except OSError as exc:
        raise GenerationError(
            f"{path}: {exc.strerror}; the file was not changed, everything else was generated"
        ) from exc


def _tell(jobs: list[_Job], changed: list[Changes], amended: Collection[Path]) -> bool:
    """Print what was done, and the errors of specific parts. Returns whether there are none."""
    from ..usercode.check import as_warnings
    from ..usercode.reading import FILE

    is_fine = True
    for job, changes in zip(jobs, changed, strict=True):
        done = [f"{len(changes.written)} written"] if changes.written else []
        done += [f"{len(changes.removed)} removed"] if changes.removed else []
        print(_line(job.model.component.name, ", ".join(done), job.root, job.model.middleware, job.is_as_before))
        if job.root / FILE in amended:
            print(f"{job.root / FILE}: stubs of the missing methods are at the end of its class")
        if job.adopted is None:
            sys.stdout.flush()
            found = as_warnings(job.complaints)
            show(found)
            is_fine &= not _announce_stubs(job) and not found
        else:
            print()
            print("\n".join(job.adopted.lines()))
    return is_fine


def _line(name: str, done: str, root: Path | str, middleware: str, is_as_before: bool) -> str:
    return f"{name}: {done or 'up to date'} in {root}/ ({middleware}{', as before' if is_as_before else ''})"


def _tell_as_json(jobs: list[_Job], changed: list[Changes]) -> bool:
    """The same for machines."""
    from ..usercode.check import as_warnings

    is_fine = True
    for job, changes in zip(jobs, changed, strict=True):
        report = job.adopted.to_json() if job.adopted else []
        found = as_warnings(job.complaints)
        said = _as_json(job.model.component.name, job.root) | {
            "written": changes.written,
            "removed": changes.removed,
            "existing": job.adopted is not None,
            "report": report,
            "diagnostics": [each.to_json() for each in found],
        }
        print(json.dumps(said))
        is_fine &= not found and _fits(job)
    return is_fine


def _as_json(name: str, root: Path | str) -> dict[str, Any]:
    """The JSON of a component that is up to date."""
    said = {"component": name, "folder": str(root), "written": [], "removed": []}
    return said | {"existing": False, "report": [], "diagnostics": []}


def _fits(job: _Job) -> bool:
    """Whether a specific part needs no additions and no changes."""
    from ..codegen.stubs import find_stubs

    stubs = find_stubs(job.root, job.model, job.trace.read)
    return not (stubs.missing or stubs.unfit or stubs.gone)


def _tell_unchanged(components: Sequence[unchanged.Component], options: argparse.Namespace) -> int:
    """Print that components are up to date."""
    for each in components:
        if options.json:
            print(json.dumps(_as_json(each.name, each.root)))
        elif not options.check:
            as_before = not options.middleware and each.middleware != AUTO
            print(_line(each.name, "", each.root, each.middleware, as_before))
    return FINE


def _announce_stubs(job: _Job) -> bool:
    """Print the methods to add or change in the specific part, by first lines. Returns whether there are any."""
    from ..codegen.stubs import find_stubs

    path = job.root / "specificworker.py"
    stubs = find_stubs(job.root, job.model, job.trace.read)
    if stubs.missing:
        print(f"\n{path} lacks {', '.join(stubs.missing)}; run `{job.command}`, or add to SpecificWorker:\n")
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
    return bool(stubs.missing or stubs.unfit or stubs.gone)


def _new(name: str, root: Path, middleware: str | None) -> int:
    from ..codegen.generate import starter, starter_specifics

    lower, spelt = name.lower(), "".join(word[:1].upper() + word[1:] for word in name.split("_"))
    specifics = partial(starter_specifics, name=spelt)
    wrong = starting.unfit(name, root) or starting.begin(
        root, f"{lower}.cdsl", starter(spelt, lower), specifics, middleware
    )
    if wrong:
        return complain(f"rcgen: {wrong}")
    needed = "" if find_spec("pytest") else "    # needs: pip install pytest"
    print(f"{root}/ holds a component that runs as it is:\n\n    rc run {root}\n    pytest {root}{needed}\n")
    return FINE


if __name__ == "__main__":
    raise SystemExit(main())
