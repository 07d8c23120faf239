"""What the security of a network allows: pure, from how its instances will be configured.

local    nothing that another machine could reach: loopback, sockets and shared memory of the run-time folder
lan      beyond that only what authenticates and encrypts: ZeroMQ with CURVE, Zenoh with TLS; never DDS or Ice
open     everything, once `--insecure` says that this is meant
"""

from __future__ import annotations

import dataclasses
import ipaddress
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..runtime import settings
from ..runtime.document import Document
from ..runtime.notify import BETWEEN
from ..transports import iceoptions
from ..transports.iceoptions import IceEndpoint, IceOptions
from . import keys
from .auto import Way
from .plan import Plan, Security
from .process import Process
from .routes import Configured, Fault

ZEROMQ, ZENOH, DDS, ICE = "zeromq", "zenoh", "dds", "ice"

_UNPROTECTED = {
    DDS: "DDS as pip installs it has neither authentication nor encryption",
    ICE: "Ice as RoboComp's programs speak it has neither authentication nor encryption",
}
"""What no key of ours helps, and why."""

_SAY = "write `security lan;` and make keys by `rcdeploy keys`, or `security open;` if everybody may take part"
_SAY_UNPROTECTED = (
    f"stay on this machine, or use {ZEROMQ} or {ZENOH}, or write `security open;` if everybody may take part"
)


@dataclass(frozen=True)
class Opening:
    """A transport as an instance will open it, with everything that the network sets."""

    instance: str
    middleware: str
    options: Mapping[str, Any]


def openings_of(
    configured: Sequence[Configured], carriers: Mapping[str, Set[str]], wiring: Mapping[str, Sequence[str]]
) -> Iterator[Opening]:
    """What instances will open; `carriers` has what carries the messages of each, `wiring` further settings of each,
    `key=value`.
    """
    for each in configured:
        document = Document()
        for assignment in wiring.get(each.name, ()):
            settings.override(document, assignment)
        further = document.data.get("transports", {})
        for middleware in sorted((each.middlewares() | carriers.get(each.name, frozenset())) - {""}):
            given = dict(each.settings.transports.get(middleware, {}))
            yield Opening(each.name, middleware, given | further.get(middleware, {}))


def faults(security: Security, openings: Sequence[Opening], ways: Sequence[Way]) -> Iterator[Fault]:
    """What the security of a network does not allow of it."""
    for opening in openings:
        for what, address in _reached(opening):
            if is_loopback(address):
                continue
            if security is Security.LOCAL:
                message = f"`{opening.instance}` {what} {address}, which `security local` does not allow: {_BEYOND}"
                hint = _SAY_UNPROTECTED if opening.middleware in _UNPROTECTED else _SAY
                yield Fault("insecure", message, hint, opening.instance)
            elif security is Security.LAN and opening.middleware == ZENOH and not address.startswith("tls/"):
                message = f"`{opening.instance}` {what} {address}, which is not encrypted"
                hint = "write tls/ADDRESS:PORT, as `security lan` needs it, or leave it to rcdeploy"
                yield Fault("insecure", message, hint, opening.instance)
    if security is Security.LAN:
        yield from _unprotected(openings, ways)


def _unprotected(openings: Sequence[Opening], ways: Sequence[Way]) -> Iterator[Fault]:
    for middleware, why in _UNPROTECTED.items():
        users = [end for way in ways if way.middleware == middleware for end in (way.client, way.provider)]
        told = [opening.instance for opening in openings if opening.middleware == middleware]
        if instances := list(dict.fromkeys((*users, *told))):
            use = f"{_listed(instances)} {'uses' if len(instances) == 1 else 'use'} `{middleware}`"
            message = f"{use}, which `security lan` does not allow: {why}"
            hint = f"use {ZEROMQ} or {ZENOH}, or `security open;` on a network that you trust"
            yield Fault("insecure", message, hint, instances[0])


_LISTED = 5
"""More instances than these are counted."""


def _listed(instances: Sequence[str]) -> str:
    said = [f"`{each}`" for each in instances[:_LISTED]]
    if len(instances) > _LISTED:
        said.append(f"{len(instances) - _LISTED} more")
    return " and ".join(filter(None, (", ".join(said[:-1]), said[-1])))


_BEYOND = "other machines reach it, and it would know nobody"


def _reached(opening: Opening) -> Iterator[tuple[str, str]]:
    """Where an instance listens or connects, in whatever the transport calls that."""
    options = opening.options
    match opening.middleware:
        case "zeromq":
            if bind := options.get("bind"):
                yield "listens at", str(bind)
            connect = options.get("connect")
            for address in connect.values() if isinstance(connect, Mapping) else ():
                yield "connects to", str(address)
        case "zenoh":
            if connect := options.get("connect"):
                yield "connects to", str(connect)
        case "dds":
            interface = options.get("interface", "lo")
            if interface != "lo":
                yield "uses the network interface", str(interface) or "of DDS's own choice"
        case "ice":
            yield from _reached_by_ice(iceoptions.read(options))


def _reached_by_ice(options: IceOptions) -> Iterator[tuple[str, str]]:
    served = [each for text in options.endpoints.values() for each in iceoptions.parse_endpoints(text)]
    for each in (IceEndpoint("tcp", options.host), *served):
        yield "listens at", _address(each, options)
    said = [] if options.storm == iceoptions.STORM else [options.storm]  # else it is wherever we are
    for text in (*options.proxies.values(), *said):
        for each in iceoptions.parse_proxy(text).endpoints:
            yield "connects to", _address(each, options)


def _address(endpoint: IceEndpoint, options: IceOptions) -> str:
    host = endpoint.host or options.host
    return f"tcp://{f'[{host}]' if ':' in host else host}:{endpoint.port or '*'}"


def is_loopback(address: str) -> bool:
    """Whether only this machine reaches what is at an address of a transport."""
    kind, _, rest = address.partition("://") if "://" in address else address.partition("/")
    if not rest:
        rest = address
    elif kind not in ("tcp", "tls", "udp", "quic", "ws"):
        return kind in ("here", "ipc", "inproc", "unixsock-stream", "unixpipe")  # names of others are not known to us
    host = re.sub(r"[?#].*", "", rest)
    host = host.rpartition(":")[0] if re.search(r":(\d+|\*)$", host) else host
    host = host.strip("[]")
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False  # a name, which may be anybody's, or `*`


def why_not(plan: Plan, *, insecure: bool) -> str:
    """Why a network is not started as it is; "" if it may be. `insecure`: whether the command line says so."""
    if plan.security is Security.OPEN and not insecure:
        return (
            f"{plan.name} has `security open;`: whoever reaches its machines may listen and command; "
            "say --insecure as well if that is meant, or write `security lan;`"
        )
    return ""


def warning(plan: Plan) -> str:
    """What is told at each start; "" if there is nothing to tell."""
    if plan.security is Security.OPEN:
        return (
            f"{plan.name} runs WITHOUT SECURITY (`security open;`): no authentication, no encryption; "
            "whoever reaches its machines may listen and command"
        )
    return ""


def secured(plan: Plan, folder: Path) -> Plan:
    """The same network, with each of its processes and routers given its own keys of that folder, if it needs any.

    Raises DeploymentError if there is not one for each.
    """
    if plan.security is not Security.LAN:
        return plan
    processes = tuple(_with_keys(each, keys.folder_of(folder, each.name).absolute()) for each in plan.processes)
    routers = {
        host: {
            **options,
            "router": {**options.get("router", {}), **keys.router_settings(plan, host, folder.absolute())},
        }
        for host, options in plan.routers.items()
    }
    return dataclasses.replace(plan, processes=processes, routers=routers)


def _with_keys(process: Process, folder: Path) -> Process:
    """What is not ours is told nothing; its keys are there for it all the same."""
    if process.is_program:
        return process
    words: list[str] = []
    done = False
    for number, word in enumerate(process.command):
        words.append(word)
        done = done and word != BETWEEN
        if not done and number and process.command[number - 1] == "--name":
            words += ["--keys", str(folder)]
            done = True
    return dataclasses.replace(process, command=tuple(words), files=(*process.files, folder))
