"""`rc lint`: check files of any of the languages."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..installed import asked_once
from . import outdated
from .common import FINE, WRONG, add_include, complain, files_of, show
from .completing import What, completed

if TYPE_CHECKING:  # running a component must not import the languages
    from ..dsl.diagnostics import Diagnostic
    from ..dsl.workspace import Workspace

NAME = "lint"

_ABOUT = """\
Say what is wrong with files, and with what they import: each mistake with its place, a code, and what may be meant.
"""
_EXAMPLES = """\
examples:
  rc lint .                         all files of the languages in this folder and below, and their etc/*.toml
  rc lint house.xml                 an InnerModel, with the files that it includes
  rc lint net.ddsl                  a network, with everything that it deploys
  rc lint --explain unknown-type    what a code means, with a wrong and a right example
  rc lint etc/config.toml           a configuration, by the component in whose folder it is
  rc lint --json . | jq .code       one diagnostic a line, for machines
  rc lint --sarif . > lint.sarif    for tools that show diagnostics beside the lines, in a review

exit status: 0 fine or warnings only, 1 an error, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = _ABOUT, _EXAMPLES
    to.add_argument(
        "files",
        nargs="*",
        type=Path,
        metavar="FILE",
        help="a file of any of the languages, a configuration, or a folder with everything below it",
    )
    how = to.add_mutually_exclusive_group()
    how.add_argument("--json", action="store_true", help="one diagnostic a line, as JSON on stdout")
    how.add_argument("--sarif", action="store_true", help="all diagnostics as SARIF 2.1.0 on stdout")
    completed(how.add_argument("--explain", metavar="CODE", help="what a code means, with examples"), What.CODE)
    to.add_argument(
        "--against", type=Path, metavar="MODEL", help="the .cdsl or .pdsl that configurations (.toml, config) are for"
    )
    add_include(to)
    to.set_defaults(usage_error=to.error)


def run(options: argparse.Namespace) -> int:
    if options.explain:
        return _explain(options.explain)
    if not options.files:
        options.usage_error("give it files, as in: rc lint interfaces/*.idsl")
    files, problems = files_of(options.files, linked=True, also=_is_checked)
    for problem in problems:
        complain(f"rc lint: {problem}")
    with asked_once():
        found = check(files, options.include, options.against)
    if options.sarif:
        from ..dsl.sarif import to_sarif

        print(json.dumps(to_sarif(found, Path.cwd()), indent=2))
    else:
        show(found, as_json=options.json)
    if found and not (options.json or options.sarif):
        print(_counted(found), file=sys.stderr)
    return WRONG if problems or any(each.severity == "error" for each in found) else FINE


def _is_checked(path: Path) -> bool:
    """Whether this is an InnerModel, or the configuration of a component, in its usual folder."""
    from ..deploy.configuration import model_beside
    from ..dsl.innermodel.check import is_innermodel

    return is_innermodel(path) or (
        path.suffix.lower() == ".toml" and path.parent.name == "etc" and model_beside(path) is not None
    )


def check(files: Sequence[Path], include: Sequence[Path] = (), against: Path | None = None) -> list[Diagnostic]:
    """The diagnostics of files and their imports, in order.

    Configurations are checked against a model, by default that of the component in whose folder they are.
    """
    from ..dsl.diagnostics import ordered
    from ..dsl.workspace import ENDINGS, Workspace

    workspace = Workspace(include)
    components: list[Path] = []
    for path in files:
        match path.suffix.lower():
            case ".ddsl":
                _check_network(path, workspace)
                components += workspace.components_of(path)
            case ".cdsl":
                _check_component(path, workspace)
                components.append(path)
            case ending if ending in (*ENDINGS, ".xml"):
                workspace.check(path)
            case _:
                _check_other(path, workspace, against)
    for path in {each.resolve(): each for each in components}.values():  # networks share components
        outdated.warn_of(path, workspace)
    return ordered(dict.fromkeys(workspace.report.diagnostics))


def _check_component(path: Path, workspace: Workspace) -> None:
    from ..usercode.check import check_component

    workspace.check(path)
    check_component(path, workspace)


def _check_other(path: Path, workspace: Workspace, against: Path | None) -> None:
    """Check a configuration, or what has no known ending."""
    from ..deploy.configuration import check_configuration, is_configuration

    if is_configuration(path) or against:
        check_configuration(path, workspace, against)
    else:
        workspace.check(path)


def _check_network(path: Path, workspace: Workspace) -> None:
    """Check a network like the deployer, except for conditions that only matter at a start."""
    from ..deploy.hosts.addresses import is_own
    from ..deploy.planner import make_plan
    from ..usercode.check import check_network

    make_plan(path, workspace, is_here=is_own)
    check_network(path, workspace)
    report = workspace.report
    report.diagnostics = [each for each in report.diagnostics if each.code != "not-generated"]


def _counted(found: Sequence[Diagnostic]) -> str:
    """`2 errors and 1 warning in 3 files`."""
    severities = Counter(str(each.severity) for each in found)
    counts = [_number(count, severity) for severity, count in sorted(severities.items())]
    return f"{' and '.join(counts)} in {_number(len({each.span.source.path for each in found}), 'file')}"


def _number(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _explain(code: str) -> int:
    from ..dsl.explanations import codes, explanation
    from ..spelling import unknown

    page = explanation(code)
    if page:
        print(page, end="")
        return FINE
    return complain(f"rc lint: {unknown('code', code, codes())}")
