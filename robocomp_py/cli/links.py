"""`rc links`: what carries the messages between the instances of a network."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from .common import FINE, USAGE, WRONG, print_table, show
from .network import add_network, overrides_of, tell_notes

if TYPE_CHECKING:
    from ..deploy.auto import Way

NAME = "links"


_EXAMPLES = """\
examples:
  rc links net.ddsl                            what `rcdeploy net.ddsl` would choose
  rc links net.ddsl --middleware 'auto(dds)'   ... with DDS where nothing faster is available
  rc links net.ddsl --json                     one link a line, for machines

exit status: 0 fine, 1 the network is wrong, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = (
        "Show which mechanism carries each operation between each two instances, and why: objects within one "
        "process, shared memory on one host, else a middleware."
    )
    to.epilog = _EXAMPLES
    add_network(to)
    to.add_argument("--json", action="store_true", help="one link a line, for machines")


def run(options: argparse.Namespace) -> int:
    from ..deploy.auto import usable
    from ..deploy.hosts.addresses import is_own
    from ..deploy.planner import make_plan
    from ..dsl.workspace import Workspace

    try:
        overrides = overrides_of(options)
    except ValueError as exc:
        print(f"rc links: {exc}", file=sys.stderr)
        return USAGE
    workspace = Workspace(options.include)
    plan = make_plan(options.network, workspace, overrides, usable, is_here=is_own)
    show(workspace.report.diagnostics, as_json=options.json and plan is None)
    if plan is None:
        return WRONG
    if options.json:
        for way in plan.ways:
            print(json.dumps({key: value for key, value in asdict(way).items() if key != "parts" or value}))
        return FINE
    _print(plan.ways)
    tell_notes(plan)
    return FINE


def _print(ways: Sequence[Way]) -> None:
    if not ways:
        print("no instance of this network uses another one")
        return
    rows = [(way.client, what, way.source, way.middleware, way.why) for way, what in _together(ways)]
    print_table(("instance", "uses", "of", "over", "why"), rows, wrapped=("why",))


def _together(ways: Sequence[Way]) -> list[tuple[Way, str]]:
    """The operations between two ports with the same middleware as one line, and their names."""
    found: dict[tuple[str, ...], list[Way]] = {}
    for way in ways:
        found.setdefault((way.client, way.port, way.verb, way.source, way.middleware, way.why), []).append(way)
    pairs = Counter((key[0], key[1], key[2], key[3]) for key in found)
    lines = []
    for key, (way, *others) in found.items():
        operations = (way.operation, *(other.operation for other in others))
        is_whole = pairs[key[0], key[1], key[2], key[3]] == 1
        lines += [(way, way.port)] if is_whole else [(way, f"{way.port}.{name}") for name in operations]
    return lines
