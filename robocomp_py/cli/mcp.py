"""`rc mcp`: lets an agent read a running network, and call what the network allows."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
import time
from typing import TYPE_CHECKING, Any

from .common import FINE, USAGE
from .completing import What, completed
from .hosts import hosts_of
from .live import Absent, add_definitions, add_middleware, count, reported

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..actions.goal import Goal
    from ..deploy.logs import Logs
    from ..tools.actions import Offered

NAME = "mcp"

_EXAMPLES = """\
examples:
  rc mcp rescue                          what a client of MCP starts, for a network that runs
  rc mcp net.ddsl --calls-per-minute 5

A client starts it with a configuration such as this. Most clients pass few variables on: XDG_RUNTIME_DIR is needed
if the network was started with it.
  {"mcpServers": {"robot": {"command": "rc", "args": ["mcp", "rescue"], "env": {"XDG_RUNTIME_DIR": "/run/user/1000"}}}}

Topics, parameters and measures may be read. Operations are called, goals begun and topics published only if the
network lists them:
  allow wander/GotoPoint/go;
Everything that is asked is in rc-mcp.log beside the logs of the network, and on stderr. It needs:
  pip install 'robocomp-py[mcp]'

exit status: 0 the client has ended it, 1 the network does not run, 2 usage, 130/143 by a signal
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = (
        "Serve the Model Context Protocol at stdin and stdout, so that an agent can see what runs in a network, read "
        "its topics, and use the operations that the network lists with `allow`."
    )
    to.epilog = _EXAMPLES
    completed(
        to.add_argument("network", metavar="NET", help="a running network, by its name or its file"), What.NETWORK
    )
    about = "how many calls, goals and publications it may make in a minute (default: 30)"
    to.add_argument("--calls-per-minute", type=count, default=30, metavar="N", help=about)
    add_definitions(to)
    add_middleware(to)
    to.set_defaults(hosts=[], keys=None)  # of `hosts_of`: all hosts, and the keys of its rcdeploy


def run(options: argparse.Namespace) -> int:
    from ..tools.census import check_names
    from ..tools.mcp import need_mcp

    with reported("rc mcp") as code:
        need_mcp()
        check_names(options.middleware)
        if sys.stdin.isatty():
            print("rc mcp: a client of MCP starts this, and talks to it; see docs/guides/mcp.md", file=sys.stderr)
            return USAGE
        return _serve(options)
    return code()


def _serve(options: argparse.Namespace) -> int:
    import anyio

    from ..client.goals import Action
    from ..client.session import Session
    from ..definitions import Definitions
    from ..deploy.client import network_of, not_running, running_plan
    from ..tools.access import Access
    from ..tools.asking import DEADLINE
    from ..tools.mcp.bounds import Bounds
    from ..tools.mcp.permissions import permissions_of
    from ..tools.mcp.requests import Requests
    from ..tools.mcp.server import make_server, serve_stdio
    from ..tools.network import TOOL, Network
    from ..version import __version__

    network = network_of(options.network)
    plan = running_plan(network)
    if plan is None:
        file = shlex.quote(options.network) if os.path.isfile(options.network) else "FILE.ddsl"
        raise Absent(not_running(network, f"start it: rcdeploy up {file}{_elsewhere()}"))
    permissions = permissions_of(plan)
    logs, write = _log(network)
    try:
        with hosts_of(options) as hosts, Access() as access:
            definitions = Definitions(options.include)
            session = Session("", options.middleware, DEADLINE, TOOL)

            def census() -> Network:
                return hosts.census(options.middleware).complete(definitions.search)

            def begin(offered: Offered, values: tuple[Any, ...]) -> Goal[Any, Any]:
                key = f"{offered.name} {offered.start.middlewares} {list(offered.start.texts)}"
                made: Action = session.kept(key, lambda: Action(session, offered))
                return made(*values)

            bounds = Bounds(calls_a_minute=options.calls_per_minute)
            requests = Requests(access, census, permissions, write, begin, bounds)
            write("INFO", f"begins; allowed: {', '.join(permissions.all) or 'nothing'}")
            try:
                anyio.run(serve_stdio, make_server(requests, network, __version__))
            finally:
                requests.close()
                session.close()  # cancels goals
                write("INFO", "ends")
    finally:
        logs.close()
    return FINE


def _elsewhere() -> str:
    """A hint if this process has fewer variables than the terminal that has started the network."""
    if os.environ.keys() & {"XDG_RUNTIME_DIR", "ROBOCOMP_RUNTIME_DIR"}:
        return ""
    return "; if it runs already, let the client pass on XDG_RUNTIME_DIR, and ROBOCOMP_RUNTIME_DIR if it is set"


def _log(network: str) -> tuple[Logs, Callable[[str, str], Any]]:
    """Where the network keeps its logs, and what writes a line there and to stderr."""
    import threading

    from ..deploy.logs import AGENT, Logs
    from ..deploy.place import Place
    from ..deploy.ring import Line

    place = Place(network)
    last = place.last_run()
    logs, lock = Logs(last.logs if last else place.logs), threading.Lock()

    def write(level: str, text: str) -> None:
        with lock:
            logs.write(Line(time.time(), AGENT, f"{level}: {text}"))
            print(f"rc mcp: {text}", file=sys.stderr, flush=True)

    return logs, write
