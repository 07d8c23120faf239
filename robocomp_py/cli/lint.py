"""`rc lint`: check files of any of the languages."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .common import FINE, WRONG, add_include, complain, show

if TYPE_CHECKING:  # running a component must not import the languages
    from ..dsl.diagnostics import Diagnostic
    from ..dsl.workspace import Workspace

NAME = "lint"
HELP = "check files of any of the languages"


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.add_argument("files", nargs="*", type=Path, metavar="FILE", help="of any of the languages, or a folder of them")
    how = to.add_mutually_exclusive_group()
    how.add_argument("--json", action="store_true", help="one diagnostic a line, as JSON on stdout")
    how.add_argument("--sarif", action="store_true", help="all diagnostics as SARIF 2.1.0 on stdout")
    how.add_argument("--explain", metavar="CODE", help="what a code means, with examples")
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
    files = [file for path in options.files for file in _files(path)]
    if not files:
        options.usage_error(f"there is nothing to check in {', '.join(map(str, options.files))}")
    found = check(files, options.include, options.against)
    if options.sarif:
        from ..dsl.sarif import to_sarif

        print(json.dumps(to_sarif(found, Path.cwd()), indent=2))
    else:
        show(found, as_json=options.json)
    if found and not (options.json or options.sarif):
        print(_counted(found), file=sys.stderr)
    return WRONG if any(each.severity == "error" for each in found) else FINE


def _files(path: Path) -> list[Path]:
    """A file; of a folder, all that are written in one of the languages, however deep."""
    from ..dsl.workspace import ENDINGS

    if not path.is_dir():
        return [path]
    inside = (each.relative_to(path) for each in path.rglob("*") if each.suffix.lower() in ENDINGS)
    return [path / each for each in sorted(inside) if not any(part.startswith(".") for part in each.parts)]


def check(files: Sequence[Path], include: Sequence[Path] = (), against: Path | None = None) -> list[Diagnostic]:
    """What is wrong with files and with what they import, in order.

    Configurations are checked against a model, by default against that of the component they are beside.
    """
    from ..deploy.configuration import check_configuration, is_configuration
    from ..dsl.diagnostics import ordered
    from ..dsl.workspace import ENDINGS, Workspace

    workspace = Workspace(include)
    for path in files:
        if path.suffix.lower() == ".ddsl":
            _check_network(path, workspace)
        elif is_configuration(path) or (against and path.suffix.lower() not in ENDINGS):
            check_configuration(path, workspace, against)
        else:
            workspace.check(path)
    return ordered(dict.fromkeys(workspace.report.diagnostics))


def _check_network(path: Path, workspace: Workspace) -> None:
    """Check a network as the deployer would, except for what only a start needs."""
    from ..deploy.plan import make_plan

    make_plan(path, workspace)
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
