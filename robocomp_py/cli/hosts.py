"""The options of commands that look at other hosts, too; see `tools.hosts`."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from .common import FINE, UNREACHABLE
from .completing import What, completed

if TYPE_CHECKING:
    from ..tools.hosts import Hosts

HERE = "here"
"""The name of this host, for users."""


def add_hosts(to: argparse.ArgumentParser, *, network: bool = True) -> None:
    """Without `network`, for commands that have another argument for it."""
    if network:
        named = to.add_argument(
            "--network",
            metavar="NET",
            help="a network that rcdeploy runs here, by its name or file: also look at its other hosts (default: all "
            "that run here)",
        )
        completed(named, What.NETWORK)
    to.add_argument(
        "--keys",
        metavar="DIR",
        help="folder of the keys of a network with `security lan`, made by rcdeploy keys --operator (default: with "
        "--network, that of its rcdeploy, if it has such keys)",
    )
    add_host(to)


def add_host(to: argparse.ArgumentParser) -> None:
    host = to.add_argument(
        "--host",
        dest="hosts",
        action="append",
        default=[],
        metavar="HOST",
        help=f"look at this host only; `{HERE}` is this machine; may be repeated",
    )
    completed(host, What.HOST)


def hosts_of(options: argparse.Namespace, *, running: bool = True) -> Hosts:
    """The hosts that these options mean; to be closed.

    Unless `running`, the network need not run: then there is only this host. Raises RobocompError.
    """
    from ..tools.hosts import Hosts

    others = [each for each in options.hosts if each != HERE] if options.hosts else None
    here = not options.hosts or HERE in options.hosts
    found = Hosts(options.network, _warn, here=here, others=others, keys=options.keys, running=running)
    return found.renew()


def _warn(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr)


def code_of(hosts: Hosts, code: int = FINE) -> int:
    """The exit code of a command that would end with `code`: it says so if a host was out of reach."""
    return UNREACHABLE if hosts.lost else code
