"""`rc graph`: draw a state machine, or a network."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from .common import FINE, USAGE, WRONG, complain, show
from .completing import What, completed
from .hosts import add_hosts, code_of, hosts_of
from .live import reported
from .model import declared
from .network import add_overrides, overrides_of

NAME = "graph"


_EXAMPLES = """\
examples:
  rc graph net.ddsl -o net.svg       components, hosts, systems, processes, and the links between them
  rc graph net.ddsl -o net.png       ... as pixels (needs: pip install 'robocomp-py[png]')
  rc graph net.ddsl -o net.dot       ... for Graphviz
  rc graph net.ddsl -o net.mmd       ... for Mermaid, which GitHub draws in Markdown
  rc graph net.ddsl --middleware dds -o net.svg   ... as it would be over that middleware
  rc graph net.ddsl --live -o now.svg   ... as it runs now, beside what it declares
  rc graph rescue --live -o now.svg  ... by the name of a network that rcdeploy runs
  rc graph game.smdsl -o game.svg    the states of a machine, and the transitions between them
  rc graph game.scxml > game.svg
  rc graph net.ddsl --json           components and links for machines; also with --live, and of a state machine

With --live, what is declared and not there is red, and what is there and not declared is grey and dotted. An arrow
has the messages or calls of one second, and the median and the 99th percentile of durations: of calls the round trip,
of messages the run of the subscriber's handler. It is thick if it fails, loses messages, or is near a deadline. A
topic without a subscriber ends at a small circle; in JSON its `to` is empty.

exit status: 0 fine, 1 the file is wrong or what runs cannot be seen, 2 usage, 3 a host is out of reach
"""

_PIXELS = 2
"""Pixels of a PNG per unit of SVG, for screens with a high resolution."""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Draw a network, or a state machine.", _EXAMPLES
    about = "network (.ddsl) or state machine (.smdsl, .scxml)"
    completed(to.add_argument("file", type=Path, metavar="FILE", help=about), What.NETWORK, ".ddsl", ".smdsl", ".scxml")
    to.add_argument("--live", action="store_true", help="what runs, beside what the network FILE declares")
    form = to.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="one JSON object instead of a picture, for machines")
    form.add_argument(
        "-o",
        dest="output",
        type=Path,
        metavar="PICTURE",
        help="where to write it: .svg, .png, and for networks .dot or .mmd (default: SVG on stdout)",
    )
    add_hosts(to, network=False)
    add_overrides(to)


def _runs(path: Path) -> bool:
    """Whether a network of this name runs here."""
    from ..deploy.client import networks

    return str(path) in networks()


def run(options: argparse.Namespace) -> int:
    path, output = options.file, options.output
    kind, ending = path.suffix.lower(), output.suffix.lower() if output else ".svg"
    if options.live:
        return _live(options, ending)
    if kind not in (".ddsl", ".smdsl", ".scxml"):
        how = (
            f"to draw the network that runs: rc graph {path} --live"
            if _runs(path)
            else "give it .ddsl, .smdsl or .scxml"
        )
        return complain(f"rc graph: {path} is neither the file of a network nor of a state machine; {how}")
    endings = (".svg", ".png", ".dot", ".mmd") if kind == ".ddsl" else (".svg", ".png")
    if ending not in endings:
        what = "a network" if kind == ".ddsl" else "a state machine"
        complain(f"rc graph: {output}: {what} is drawn as {', '.join(endings)}; use one of these")
        return USAGE
    drawn = _network(options, ending) if kind == ".ddsl" else _machine(options)
    return drawn if isinstance(drawn, int) else _written(drawn, output)


def _machine(options: argparse.Namespace) -> str | int:
    from ..dsl.workspace import Workspace
    from ..graph.statemachine import as_json, draw

    workspace = Workspace()
    machine = workspace.statemachine(options.file)
    show(workspace.report.diagnostics)
    if machine is None:
        return WRONG
    return as_json(machine) if options.json else draw(machine)


def _network(options: argparse.Namespace, ending: str) -> str | int:
    from ..deploy.auto import usable
    from ..deploy.hosts.addresses import is_own
    from ..deploy.planner import make_plan
    from ..dsl.workspace import Workspace
    from ..graph import netsvg, nettext
    from ..graph.network import Graph, graph_of

    try:
        overrides = overrides_of(options)
    except ValueError as exc:
        print(f"rc graph: {exc}", file=sys.stderr)
        return USAGE
    workspace = Workspace(options.include)
    plan = make_plan(options.file, workspace, overrides, usable, is_here=is_own)
    show(workspace.report.diagnostics)
    if plan is None:
        return WRONG
    ways: Mapping[str, Callable[[Graph], str]] = {".dot": nettext.dot, ".mmd": nettext.mermaid}
    return (nettext.as_json if options.json else ways.get(ending, netsvg.draw))(graph_of(plan))


def _live(options: argparse.Namespace, ending: str) -> int:
    """Draw what runs now; it is looked at twice, for rates."""
    from ..graph.netsvg import draw
    from ..graph.nettext import as_json
    from ..tools.access import Access
    from ..tools.lookout import Lookout, seen_twice
    from ..tools.monitor.view import picture

    if ending not in (".svg", ".png"):
        complain(f"rc graph: {options.output}: what runs is drawn as .svg, .png; use one of these")
        return USAGE
    if options.middleware or options.set:
        print("rc graph: --live shows what runs: leave out --middleware and --set", file=sys.stderr)
        return USAGE
    options.network = str(options.file)
    with reported("rc graph") as code:
        plan = declared(options.network, options.include)
        with hosts_of(options, running=False) as hosts, Access() as access:
            look = seen_twice(Lookout(access, lambda: plan, partial(hosts.look, ())))
        for each in look.troubles:
            print(f"rc graph: could not look: {each}", file=sys.stderr)
        return code_of(hosts, _written((as_json if options.json else draw)(picture(look)), options.output))
    return code()


def _written(drawn: str, output: Path | None) -> int:
    if output is None:
        sys.stdout.write(drawn)
        return FINE
    content = drawn.encode()
    if output.suffix.lower() == ".png":
        try:
            import resvg_py
        except ImportError:
            return complain(f"rc graph: {output}: to write PNG, run: pip install 'robocomp-py[png]'; or write .svg")
        content = bytes(resvg_py.svg_to_bytes(svg_string=drawn, zoom=_PIXELS))
    try:
        output.write_bytes(content)
    except OSError as exc:
        return complain(f"rc graph: {output}: {exc.strerror}")
    return FINE
