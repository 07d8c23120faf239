"""`rc list`: what runs, and what it offers and uses."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from typing import TYPE_CHECKING

from .common import FINE, WRONG, print_table
from .hosts import HERE, add_hosts, code_of, hosts_of
from .live import EXIT_STATUS, add_json, add_middleware, reported

if TYPE_CHECKING:
    from ..tools.network import Network, Running

NAME = "list"

_EXAMPLES = f"""\
examples:
  rc list                       components: what they offer, and what they use of others
  rc list --channels            topics, queries and commands, with what provides and uses each
  rc list --topics --json       only topics, one a line, for machines
  rc list --all                 also the interfaces of the framework, such as CommonBehavior
  rc list --host base           only this host of a network that rcdeploy runs here
  rc list --network lab         this network's hosts, and this machine

{EXIT_STATUS}
"""

_KINDS = {"topics": "publish", "queries": "query", "commands": "command"}


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = (
        "List what runs now on this host, and on the other hosts of networks that rcdeploy runs here, as processes "
        "announce it. Neither models nor generated code are needed. "
        "Components that share one process and use no middleware are not seen."
    )
    to.epilog = _EXAMPLES
    to.add_argument("--channels", action="store_true", help="list channels instead of components")
    for name in _KINDS:
        to.add_argument(f"--{name}", action="store_true", help=f"list {name} instead of components")
    to.add_argument("--all", action="store_true", help="also interfaces of the framework, and commands such as rc echo")
    add_hosts(to)
    add_middleware(to)
    add_json(to)


def run(options: argparse.Namespace) -> int:
    with reported("rc list") as code, hosts_of(options) as hosts:
        network = hosts.census(options.middleware, own=options.all)
        kinds = [kind for name, kind in _KINDS.items() if getattr(options, name)]
        if options.channels or kinds:
            shown = _channels(network, kinds or list(_KINDS.values()), as_json=options.json)
            return code_of(
                hosts, _told(shown, " or ".join(name for name in _KINDS if getattr(options, name)) or "channels")
            )
        found = network.components(tools=options.all)
        shown = _components(found, as_json=options.json, with_hosts=bool(hosts.posts))
        return code_of(hosts, _told(shown, "components"))
    return code()


def _components(found: list[Running], *, as_json: bool, with_hosts: bool) -> bool:
    if as_json:
        for each in found:
            print(json.dumps(asdict(each)))
    elif found:
        rows = [
            (
                each.owner or "?",
                *([each.host or HERE] if with_hosts else ()),
                str(each.pid),
                *map(_listed, (each.middlewares, each.offers, each.uses)),
            )
            for each in found
        ]
        where = ("host",) if with_hosts else ()
        print_table(("component", *where, "process", "over", "offers", "uses"), rows, wrapped=("offers", "uses"))
    return bool(found)


def _channels(network: Network, kinds: list[str], *, as_json: bool) -> bool:
    found = [each for each in network.channels.values() if each.pattern in kinds]
    rows = []
    for each in found:
        providers, users = ([end.told.owner or "?" for end in ends] for ends in (each.providers, each.users))
        provided, used = list(dict.fromkeys(providers)), list(dict.fromkeys(users))
        if as_json:
            print(
                json.dumps(
                    {
                        "channel": each.name,
                        "pattern": each.pattern,
                        "middlewares": each.middlewares,
                        "providers": provided,
                        "users": used,
                    }
                )
            )
        rows.append((each.name, str(each.pattern), *map(_listed, (each.middlewares, provided, used))))
    if found and not as_json:
        print_table(("channel", "pattern", "over", "provided by", "used by"), rows, wrapped=("provided by", "used by"))
    return bool(found)


def _told(found: bool, what: str) -> int:
    if not found:
        print(f"rc list: there are no {what} here", file=sys.stderr)
    return FINE if found else WRONG


def _listed(names: list[str]) -> str:
    return ", ".join(names)
