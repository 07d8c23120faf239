"""`rc log`: what a running component logs."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from .common import FINE
from .completing import What, completed
from .hosts import add_hosts, hosts_of
from .live import (
    COMPONENT,
    EXIT_STATUS,
    Absent,
    add_json,
    add_middleware,
    add_waiting,
    awaited,
    check_component_of_one_host,
    components_named,
    reported,
)

if TYPE_CHECKING:
    from ..tools.network import Network

NAME = "log"

LEVELS = ("debug", "info", "warning", "error")

_EXAMPLES = f"""\
examples:
  rc log wander debug                             all that it logs, until it ends
  rc log wander error --logger robocomp.worker    only what one logger of it logs

Components that share a process share their loggers. `rcdeploy logs` shows the lines.

{EXIT_STATUS}
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Set the level from which on a component logs, until it ends."
    to.epilog = _EXAMPLES
    completed(to.add_argument("component", metavar="COMPONENT", help=COMPONENT), What.COMPONENT)
    to.add_argument("level", choices=LEVELS, metavar="LEVEL", help=", ".join(LEVELS))
    to.add_argument("--logger", default="", metavar="NAME", help="only this logger (default: all)")
    add_waiting(to)
    add_hosts(to)
    add_middleware(to)
    add_json(to)


def run(options: argparse.Namespace) -> int:
    from ..tools import asking
    from ..tools.access import Access

    def pick(network: Network) -> tuple[Network, list[str]]:
        try:
            found = components_named(asking.with_log_levels(network), [options.component])
        except Absent as exc:
            raise ValueError(str(exc)) from exc
        for each in found:
            check_component_of_one_host(network, each)
        return network, found

    with reported("rc log") as code, hosts_of(options) as hosts, Access() as access:
        network, names = awaited(options, pick, hosts)
        if len(names) > 1:
            raise Absent(f"there are several: {', '.join(names)}; write more of the name")
        asking.set_log_level(access, network, names[0], options.logger, options.level, options.timeout)
        if options.json:
            print(json.dumps({"component": names[0], "logger": options.logger, "level": options.level}))
        return FINE
    return code()
