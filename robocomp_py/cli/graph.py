"""`rc graph`: draw a state machine."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from .common import FINE, WRONG, complain, show

NAME = "graph"
HELP = "draw a state machine as SVG"


_EXAMPLES = """\
examples:
  rc graph game.smdsl -o game.svg    for a browser, or a page
  rc graph game.scxml > game.svg

exit status: 0 fine, 1 the file is wrong, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Draw the states of a machine, and the transitions between them, as SVG.", _EXAMPLES
    to.formatter_class = argparse.RawDescriptionHelpFormatter
    to.add_argument("file", type=Path, metavar="FILE", help="state machine (.smdsl, .scxml)")
    to.add_argument("-o", dest="output", type=Path, metavar="FILE.svg", help="where to write it (default: stdout)")


def run(options: argparse.Namespace) -> int:
    from ..dsl.workspace import Workspace
    from ..graph.statemachine import draw

    path, output = options.file, options.output
    if path.suffix.lower() not in (".smdsl", ".scxml"):
        return complain(f"rc graph: {path} is no state machine: give it a .smdsl or .scxml file")
    if output and output.suffix.lower() != ".svg":
        return complain(f"rc graph: {output}: what is written is SVG; let its name end in .svg")
    workspace = Workspace()
    machine = workspace.statemachine(path)
    show(workspace.report.diagnostics)
    if machine is None:
        return WRONG
    picture = draw(machine)
    if output is None:
        sys.stdout.write(picture)
        return FINE
    try:
        output.write_text(picture, encoding="utf-8")
    except OSError as exc:
        return complain(f"rc graph: {output}: {exc.strerror}")
    return FINE
