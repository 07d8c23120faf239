"""`rcdeploy`: networks of components, started, watched and stopped.

What takes long to import is imported when `main` runs, which ends quietly on Ctrl-C even then.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..dsl.diagnostics import Diagnostic, did_you_mean
from .common import FINE, USAGE, WRONG, command, complain, parser, show
from .network import add_overrides, overrides_of, tell_notes

if TYPE_CHECKING:
    from ..deploy.plan import Plan
    from ..dsl.workspace import LinkedComponent, Workspace

_EXAMPLES = """\
examples:
  rcdeploy net.ddsl                              start everything; Ctrl-C stops it, twice kills it
  rcdeploy net.ddsl --middleware zeromq          ... over that middleware and no other
  rcdeploy net.ddsl --for 30                     ... for half a minute
  rcdeploy net.ddsl --until mission              ... until that instance ends
  rcdeploy net.ddsl --set world.params.step=0.1  set a key of an instance's configuration (*: of all)
  rcdeploy plan net.ddsl                         show what would run, and start nothing
  rcdeploy --import deployment.xml -o net.ddsl   make a network of rcmanager's XML, or of a sub.toml

The whole network is checked first; nothing is started while anything is wrong.
Exit status: 0 fine, 1 wrong input or something failed, 2 usage, 130/143 stopped by a signal.
"""


@command
def main(arguments: Sequence[str] | None = None) -> int:
    options = _parse(arguments)
    if options.imported:
        return _import(options.imported, options.output)
    from ..deploy.auto import usable
    from ..deploy.plan import make_plan
    from ..dsl.workspace import Workspace

    try:
        overrides = overrides_of(options)
    except ValueError as exc:
        print(f"rcdeploy: {exc}", file=sys.stderr)
        return USAGE
    workspace = Workspace(options.include)
    plan = make_plan(options.network, workspace, overrides, usable)
    if plan and not _check_generated(options.network, workspace):
        plan = None
    _show(workspace.report.diagnostics, as_json=options.json and plan is None)
    if plan is None:
        return WRONG
    tell_notes(plan)
    if options.plan:
        return _print_plan(plan, options.json)
    ending = {name for process in plan.processes for name in (process.name, *process.instances)}
    if options.until and options.until not in ending:
        print(f"rcdeploy: --until {options.until}: there is no such instance", file=sys.stderr)
        return USAGE
    return _run(plan, options)


# Arguments.


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    made = _parser()
    options = made.parse_intermixed_args(arguments)
    words = options.words
    if options.output and not options.imported:
        made.error("-o is for --import")
    if options.imported and words:
        made.error(f"--import {options.imported} imports and starts nothing; leave out `{' '.join(words)}`")
    if options.imported:
        return options
    options.plan = words[:1] == ["plan"]
    if len(words) == 2 and not options.plan:
        proposal = did_you_mean(words[0], ["plan"])
        made.error(f"no command `{words[0]}`; {proposal or 'give it one network, or `plan` and a network'}")
    if len(words) != 1 + options.plan:
        made.error("give it one network (.ddsl)")
    if options.json and not options.plan:
        made.error("--json is for `rcdeploy plan`")
    if options.plan and (options.duration is not None or options.until):
        made.error("--for and --until are for running, not for `rcdeploy plan`")
    options.network = Path(words[-1])
    return options


def _parser() -> argparse.ArgumentParser:
    made = parser("rcdeploy", "Start, watch and stop a network of components described in DDSL.", _EXAMPLES)
    made.usage = "rcdeploy [plan] [options] NET.ddsl\n       rcdeploy --import FILE [-o NET.ddsl]"
    made.add_argument(
        "words", nargs="*", metavar="[plan] NET.ddsl", help="the network; after `plan`, only show what would run"
    )
    made.add_argument(
        "--for", dest="duration", type=_seconds, metavar="SECONDS", help="stop so long after everything was ready"
    )
    made.add_argument("--until", metavar="INSTANCE", help="stop everything when this one ends")
    made.add_argument("--json", action="store_true", help="plan: for machines")
    made.add_argument(
        "--import",
        dest="imported",
        type=Path,
        metavar="FILE",
        help="write a network of rcmanager's (.xml) or of sub.toml as DDSL",
    )
    made.add_argument("-o", dest="output", type=Path, metavar="NET.ddsl", help="with --import: where (default: stdout)")
    add_overrides(made)
    return made


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"`{text}` is no number of seconds; write it as in --for 30 or --for 0.5")
    return value


# Networks of other tools.


def _import(path: Path, output: Path | None) -> int:
    """Write a network as DDSL. A file that is there is never written over: it may have been edited."""
    from ..deploy.importers import FORMATS, import_deployment
    from ..deploy.importers.finding import Finder
    from ..dsl.workspace import Workspace

    if path.suffix.lower() not in FORMATS:
        return complain(f"rcdeploy: --import {path}: give it rcmanager's XML (.xml) or a sub.toml (.toml)")
    if output and output.suffix.lower() != ".ddsl":
        return complain(f"rcdeploy: -o {output}: a network is a .ddsl file")
    workspace = Workspace()
    source = workspace.source(path)
    folder = output.parent if output else Path.cwd()
    text = import_deployment(source, Finder(path), folder, workspace.report) if source else None
    show(workspace.report.diagnostics)
    if text is None:
        return WRONG
    if output is None:
        print(text, end="")
        return FINE
    try:
        _write_new(output, text)
    except FileExistsError:
        return complain(f"rcdeploy: {output} exists, and stays as it is; give another name, or move it away")
    except OSError as exc:
        return complain(f"rcdeploy: {output} cannot be written: {exc.strerror}")
    print(f"{output} is written; read its comments, then: rc lint {shlex.quote(str(output))}", file=sys.stderr)
    return FINE


def _write_new(path: Path, text: str) -> None:
    """Write a file that is not there: all of it, or none, for what is there would be in the way of another try."""
    with path.open("x", encoding="utf-8") as file:
        try:
            file.write(text)
            file.flush()
        except BaseException:
            path.unlink()
            raise


# What was generated.


def _check_generated(path: Path, workspace: Workspace) -> bool:
    """Whether every generic part is what its models come to; those that are not are reported."""
    model = workspace.deployment(path)
    paths = workspace.components_of(path)
    components = {linked.component.name.lower(): linked for each in paths if (linked := workspace.component(each))}
    seen: set[str] = set()
    for instance in model.instances if model else ():
        kind = instance.component.text.lower()
        if instance.path or kind in seen or kind not in components:
            continue  # a program of one's own is none of ours
        seen.add(kind)
        lines = _outdated(components[kind])
        if lines:
            message = "\n  ".join((f"`{instance.component}` is not generated from its models as they are now", *lines))
            hint = f"run: rcgen {shlex.quote(str(path))}"
            workspace.report.error("out-of-date", message, instance.component.span, hint)
    return not workspace.report.errors


def _outdated(linked: LinkedComponent) -> list[str]:
    from .. import __version__
    from ..codegen.generate import DEFAULT_MIDDLEWARE, GenerationError, Model, Owner, generate
    from ..codegen.write import compare
    from ..deploy.routes import generated_for

    folder = linked.path.parent
    try:
        first = (
            (folder / "generic" / "genericworker.py").read_text(encoding="utf-8", errors="replace").partition("\n")[0]
        )
        if f" by rcgen {__version__}:" not in first:
            return []  # another version writes other text for the same models: nothing can be told from that
        middleware = generated_for(folder) or DEFAULT_MIDDLEWARE
        artifacts = generate(Model(linked.component, linked.modules, linked.path.name, linked.params, middleware))
        return compare([each for each in artifacts if each.owner is Owner.GENERATOR], folder).lines(folder)
    except (OSError, GenerationError) as exc:
        return [str(exc)]


# Output.


def _show(diagnostics: Iterable[Diagnostic], *, as_json: bool) -> None:
    """Print diagnostics. That nobody can read them is no reason not to run a network that is right."""
    from ..deploy.terminal import discard

    stream = sys.stdout if as_json else sys.stderr
    try:
        show(diagnostics, as_json=as_json)
        stream.flush()
    except BrokenPipeError:
        raise
    except OSError:
        discard(stream)


def _print_plan(plan: Plan, as_json: bool) -> int:
    from ..deploy.terminal import discard

    try:
        _write_plan(plan, as_json)
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as exc:
        discard(sys.stdout)
        return complain(f"rcdeploy: the plan cannot be written: {exc.strerror}")
    return FINE


def _write_plan(plan: Plan, as_json: bool) -> None:
    if as_json:
        print(json.dumps(plan.to_json(), indent=2))
        return
    from rich.console import Console
    from rich.text import Text

    from ..deploy.terminal import table_of

    console = Console()
    console.print(table_of(plan))
    for process in plan.processes:
        console.print(Text(f"{process.name}: {shlex.join(process.command)}", style="dim"), soft_wrap=True)


def _run(plan: Plan, options: argparse.Namespace) -> int:
    from ..deploy.run import Options
    from ..deploy.terminal import run_on_terminal
    from ..errors import ConfigurationError, TransportError

    if not plan.processes:
        return FINE
    try:
        return run_on_terminal(plan, Options(options.duration, options.until))
    except (TransportError, ConfigurationError) as exc:
        return complain(f"rcdeploy: {exc}")


if __name__ == "__main__":
    raise SystemExit(main())
