"""`rc monitor`: a page in the browser that shows what runs, beside what is declared."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from .common import WRONG, add_include
from .completing import What, completed
from .hosts import add_hosts, hosts_of
from .live import Absent, add_json, add_middleware, port, positive, reported
from .model import declared

if TYPE_CHECKING:
    from ..tools.census import Seen

NAME = "monitor"

_EXAMPLES = """\
examples:
  rc monitor                   the network that rcdeploy runs here, else all components of this host
  rc monitor rescue            this one, by its name
  rc monitor rescue.ddsl       ... by its file; what does not run is red
  rc monitor --allow-control   processes can be restarted, stopped and started from the page
  rc monitor --port 8800       at this port, for an SSH tunnel: ssh -L 8800:127.0.0.1:8800 robot

Open the URL that it prints. It is for browsers on this machine, and only for those that know its token. Unless
--allow-control is given, nothing can be changed by it. At most 16 pages may be open. Components are asked only while
one is. End it with Ctrl-C.

exit status: 0 done, 1 the port is taken or the network cannot be read, 2 usage, 130/143 by a signal
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = (
        "Serve a page that shows components within their hosts, systems and processes, and the topics and calls "
        "between them with rates, durations and failures. Red: declared and missing. Grey and dotted: not declared. "
        "Thick: failing, losing messages, or near a deadline."
    )
    to.epilog = _EXAMPLES
    about = "a network, by its DDSL file or by its name if it runs"
    completed(to.add_argument("network", nargs="?", metavar="NET", help=about), What.NETWORK)
    to.add_argument("--port", type=port, default=0, help="where to listen on 127.0.0.1 (default: any free port)")
    to.add_argument(
        "--every", type=positive, default=1.0, metavar="SECONDS", help="the time between two looks (default: 1)"
    )
    to.add_argument(
        "--allow-control",
        action="store_true",
        help="let the page restart, stop and start processes of the network, after a question",
    )
    add_include(to)
    add_hosts(to, network=False)
    add_middleware(to)
    add_json(to)


def run(options: argparse.Namespace) -> int:
    from ..tools.access import Access
    from ..tools.census import check_names
    from ..tools.lookout import Lookout
    from ..tools.monitor.server import Board, Server
    from ..tools.monitor.watching import watch

    with reported("rc monitor") as code:
        check_names(options.middleware)
        name = _network(options)
        plan = _plan(name, options)
        try:
            board = Board()
            server = Server(board, options.port, _control(name) if options.allow_control else None)
        except OSError as exc:
            print(f"rc monitor: port {options.port}: {exc.strerror}; choose another --port", file=sys.stderr)
            return WRONG
        options.network = name
        with contextlib.ExitStack() as end:
            see = sight(options, end)
            access = end.enter_context(Access())
            end.enter_context(server)
            print(json.dumps({"url": server.url}) if options.json else server.url, flush=True)
            watch(board, Lookout(access, plan, see, except_pid=os.getpid()).look, options.every)
    return code()


def _network(options: argparse.Namespace) -> str:
    """The name of the network; "" without a network. Raises Absent and RobocompError."""
    from ..deploy.client import network_of, networks

    name = network_of(options.network) if options.network else ""
    if not name:
        running = networks()
        if len(running) > 1:
            raise Absent(f"several networks run here; name one of {', '.join(running)}")
        name = "".join(running)
    if options.allow_control and not name:
        raise Absent("--allow-control is for a network that rcdeploy runs here, and none runs")
    return name


def _control(network: str) -> Callable[[str, str], None]:
    """What does something to a process of this network. Raises RobocompError."""
    from ..deploy.client import Connection
    from ..printable import printable

    def control(do: str, process: str) -> None:
        print(f"rc monitor: {do} of {printable(process)} was requested from the page", file=sys.stderr)
        with Connection(network) as connection:
            connection.ask("stop" if do == "stop" else "restart", names=[process])

    return control


def _plan(name: str, options: argparse.Namespace) -> Callable[[], Mapping[str, Any] | None]:
    """What tells the plan of the network: again with each look, if it runs, since it may be changed meanwhile."""
    from ..deploy.client import running_plan

    if not name:
        return lambda: None
    last = running_plan(name) or declared(options.network or name, options.include)

    def plan() -> Mapping[str, Any]:
        nonlocal last
        last = running_plan(name) or last  # a network that has ended is missing
        return last

    return plan


def sight(options: argparse.Namespace, end: contextlib.ExitStack) -> Callable[[], Seen]:
    """What tells what runs on all hosts. A network may be started later, and then has other hosts."""
    hosts = end.enter_context(hosts_of(options, running=False))
    return lambda: hosts.renew().look(options.middleware)
