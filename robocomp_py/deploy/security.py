"""What the security of a network allows: pure, from how its instances will be configured.

local    nothing that another machine could reach: loopback, sockets and shared memory of the run-time folder
lan      beyond that only what authenticates and encrypts, as the deployment side of its transport declares
open     everything, once `--insecure` says that this is meant
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import installed
from ..contract.middleware import DEFAULT
from ..errors import ConfigurationError
from ..runtime import settings
from ..runtime.document import Document
from ..runtime.notify import BETWEEN
from ..spelling import enumerated
from ..transports.base import Capability, find_transport
from ..transports.deployment import Deployment, deployment_of, deployments, is_loopback
from ..transports.network import Fault, Helper
from ..transports.permissions import router_name
from . import keys
from .auto import Way
from .plan import Plan, Security
from .process import Process
from .routes import Configured

_SAY_OPEN = "write `security open;`"
_SAY = "write `security lan;` and make keys by `rcdeploy keys`, or `security open;` if any machine may take part"


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


def faults(
    security: Security, openings: Sequence[Opening], ways: Sequence[Way], crossing: Sequence[Way] = ()
) -> Iterator[Fault]:
    """Everything in a network that its security does not allow. `crossing` has the ways between hosts."""
    for opening in openings:
        deployment = deployment_of(opening.middleware)
        for reached in deployment.reached(opening.options):
            where = f"`{opening.instance}` {reached.what} {reached.address}"
            if is_loopback(reached.address):
                continue
            if security is Security.LOCAL:
                message = f"{where}, which `security local` does not allow: {_BEYOND}"
                yield Fault("insecure", message, _instead(deployment), opening.instance)
            elif security is Security.LAN and reached.unencrypted:
                yield Fault("insecure", f"{where}, which is not encrypted", reached.unencrypted, opening.instance)
    for way in crossing if security is Security.LOCAL else ():
        deployment = deployment_of(way.middleware)
        if deployment.crosses_hosts:  # if not, its wiring refuses the way
            message = (
                f"`{way.client}` and `{way.provider}` are on different hosts, and `{way.middleware}` connects them, "
                "which `security local` does not allow"
            )
            yield Fault("insecure", message, _instead(deployment), way.client)
    for middleware, instances in _users(openings, ways).items():
        if why := _why_not(security, middleware):
            use = f"{_listed(instances)} {'uses' if len(instances) == 1 else 'use'} `{middleware}`"
            message = f"{use}, which `security {security}` does not allow: {why}"
            hint = f"use {_protected()}, or `security open;` on a network that you trust"
            yield Fault("insecure", message, hint, instances[0])


def _why_not(security: Security, middleware: str) -> str:
    """Why a middleware is not allowed, wherever its instances are."""
    if security is Security.LAN:
        return deployment_of(middleware).unprotected
    if security is Security.LOCAL and _reaches_out(middleware):
        return "its transport declares that it reaches other machines (`Capability.CROSS_HOST`)"
    return ""


def _instead(deployment: Deployment) -> str:
    """What to write instead of `security local`, or to use."""
    if deployment.unprotected:
        return f"stay on this machine, or use {_protected()}, or {_SAY_OPEN} if any machine may take part"
    return _SAY


def _reaches_out(middleware: str) -> bool:
    """Whether a transport always reaches other machines. The shipped transports do so only if their options say so."""
    try:
        declared: Capability = getattr(find_transport(middleware), "capabilities", Capability.NONE)
    except ConfigurationError:
        return False
    return Capability.CROSS_HOST in declared


def _protected() -> str:
    """The transports that cross hosts and keep strangers out, the default one first."""
    names = [name for name, each in deployments().items() if each.crosses_hosts and not each.unprotected]
    return " or ".join(sorted(names, key=lambda name: (name != DEFAULT, name)))


def _users(openings: Sequence[Opening], ways: Sequence[Way]) -> dict[str, list[str]]:
    """The instances that use each middleware. A missing one is reported elsewhere."""
    found: dict[str, list[str]] = {}
    for way in ways:
        found.setdefault(way.middleware, []).extend((way.client, way.provider))
    for opening in openings:
        found.setdefault(opening.middleware, []).append(opening.instance)
    known = installed.transports()
    return {name: list(dict.fromkeys(users)) for name, users in found.items() if name in known}


_LISTED = 5
"""More instances than these are counted."""


def _listed(instances: Sequence[str]) -> str:
    said = [f"`{each}`" for each in instances[:_LISTED]]
    if len(instances) > _LISTED:
        said.append(f"{len(instances) - _LISTED} more")
    return enumerated(said)


_BEYOND = "other machines can reach it, and it has no keys to authenticate them"


def why_not(plan: Plan, *, insecure: bool) -> str:
    """Why a network is not started as it is; "" if it may be. `insecure`: whether the command line says so."""
    if plan.security is Security.OPEN and not insecure:
        return (
            f"{plan.name} has `security open;`: any program that reaches its machines can listen and send commands; "
            "add --insecure if that is intended, or write `security lan;`"
        )
    return ""


def warning(plan: Plan) -> str:
    """The warning at each start; "" if there is none."""
    if plan.security is Security.OPEN:
        return (
            f"{plan.name} runs WITHOUT SECURITY (`security open;`): no authentication, no encryption; "
            "any program that reaches its machines can listen and send commands"
        )
    return ""


def secured(plan: Plan, folder: Path) -> Plan:
    """The same network, with each of its processes and helpers given its own keys of that folder, if it needs any.

    Raises DeploymentError if there is not one for each.
    """
    if plan.security is not Security.LAN:
        return plan
    processes = tuple(_with_keys(each, keys.folder_of(folder, each.name).absolute()) for each in plan.processes)
    helpers = tuple(_with_own(each, plan, folder.absolute()) if each.addresses else each for each in plan.helpers)
    return dataclasses.replace(plan, processes=processes, helpers=helpers)


def _with_own(helper: Helper, plan: Plan, folder: Path) -> Helper:
    own = folder / router_name(helper.host or "")
    numbers = keys.numbers(plan, folder)
    graph = keys.graph_of(plan, operator=keys.has_operator(folder))
    options = deployment_of(helper.middleware).secured(helper, graph, own, numbers)
    return dataclasses.replace(helper, options=options, keys=str(own))


def _with_keys(process: Process, folder: Path) -> Process:
    """A foreign program gets no settings, but its keys are made."""
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
