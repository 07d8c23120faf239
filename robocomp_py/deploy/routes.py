"""Over what, and to whom, the operations of configured instances really go.

The middleware of an operation may be chosen in many places, from the generated code to the command
line, and so may the instance a port uses. What counts is what comes out of all of them together.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from .. import installed
from ..contract.component import Component, Port
from ..contract.interface import Verb
from ..dsl.diagnostics import did_you_mean
from ..errors import ConfigurationError
from ..runtime.settings import Document, Settings
from ..spelling import unknown
from ..transports.base import Capability, find_transport
from ..wire import names

_MIDDLEWARE = re.compile(r'^    middleware = "([^"]+)"$', re.MULTILINE)


@dataclass(frozen=True)
class Fault:
    """Something wrong, in the terms of a diagnostic. `instance` is the one to blame; "" if it is none."""

    code: str
    message: str
    hint: str = ""
    instance: str = ""
    subject: tuple[str, ...] = ()
    """Of several faults with one subject, the first is worth telling."""

    def __str__(self) -> str:
        return f"{self.message}; {self.hint}" if self.hint else self.message


@dataclass(frozen=True)
class Configured:
    """An instance as it will run."""

    name: str
    component: Component
    settings: Settings
    document: Document
    generated_for: str
    """The middleware of its generic part."""

    def middleware(self, port: Port, operation: str) -> str:
        return self.settings.port(port, operation).middleware or self.generated_for

    def middlewares(self) -> set[str]:
        """All that it will open, also for its own `CommonBehavior`."""
        ways = {self.middleware(*at) for at in (*self.operations(providing=True), *self.operations(providing=False))}
        return (ways | {self.settings.middleware or self.generated_for}) - {""}

    def origin(self, port: Port, operation: str) -> str:
        """Where that middleware was chosen, for people."""
        for key in ((port.name, operation), (port.name,)):
            chosen = self.settings.ports.get(key)
            if chosen and chosen.middleware:
                return self.document.place(("ports", *key, "middleware"))
        if port.middleware:
            return "its model"
        return self.document.place(("middleware",)) if self.settings.middleware else "generated for it"

    def source(self, port: Port, operation: str) -> tuple[str, str, str]:
        """Whose channels a port that uses an interface looks for: namespace, instance and interface."""
        asked = self.settings.port(port, operation).source or ""
        return names.resolve(asked, self.settings.namespace, port.interface.short)

    def operations(self, *, providing: bool) -> Iterator[tuple[Port, str]]:
        for port in self.component.ports:
            if port.verb.provides is providing:
                yield from ((port, operation.name) for operation, _ in port.interface.under(port.verb))

    def offers(self, wanted: Port, segment: str | None = None) -> list[Port]:
        """Its ports that offer what a port of somebody else uses; with a segment, those called so in channels."""
        verb = Verb.IMPLEMENTS if wanted.verb is Verb.REQUIRES else Verb.PUBLISHES
        ports = [p for p in self.component.ports if p.verb is verb and p.interface.short == wanted.interface.short]
        return [port for port in ports if segment in (None, self.component.segment(port))]


def generated_for(folder: Path) -> str:
    """The middleware that a component's generic part was generated for; "" if there is none."""
    try:
        text = (folder / "generic" / "genericworker.py").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    found = _MIDDLEWARE.search(text)
    return found[1] if found else ""


def unfit(middleware: str) -> Fault | None:
    """Why a middleware cannot carry a network, if it cannot."""
    known = installed.transports()
    if middleware not in known:
        hint = did_you_mean(middleware, known) or f"installed: {', '.join(known)}"
        return Fault("unknown-middleware", f"no middleware `{middleware}`", hint)
    try:
        capabilities = getattr(find_transport(middleware), "capabilities", Capability.CROSS_PROCESS)
    except ConfigurationError as exc:
        return Fault("unfit-middleware", str(exc))
    if Capability.CROSS_PROCESS not in capabilities:
        message = f"`{middleware}` does not reach other processes, and every component is one"
        return Fault("unfit-middleware", message)
    return None


def check_routes(configured: Sequence[Configured], instances: Collection[str], told: Collection[str]) -> list[Fault]:
    """What is wrong between instances. `instances` names all of the network, also those not configured by us;

    `told` are the middlewares whose unfitness has been told already.
    """
    found = [fault for each in configured for fault in _unfit_choices(each, told)]
    for client in configured:
        for port, operation in client.operations(providing=False):
            found += _check_route(client, port, operation, configured, instances)
    once: dict[tuple[str, ...], Fault] = {}
    for fault in found:
        once.setdefault((fault.code, *(fault.subject or (fault.message,))), fault)
    return list(once.values())


def _unfit_choices(each: Configured, told: Collection[str]) -> Iterator[Fault]:
    ports = [*each.operations(providing=True), *each.operations(providing=False)]
    for name, origin in dict.fromkeys((each.middleware(*at), each.origin(*at)) for at in ports):
        fault = unfit(name) if name and name not in told else None
        if fault:
            yield Fault(fault.code, f"`{each.name}` ({origin}): {fault.message}", fault.hint, each.name)


def _check_route(
    client: Configured, port: Port, operation: str, configured: Sequence[Configured], instances: Collection[str]
) -> Iterator[Fault]:
    namespace, instance, segment = client.source(port, operation)
    if namespace != client.settings.namespace:
        return  # another network's, of which nothing is known here
    if instance != names.ANY and instance not in instances:
        origin = client.document.place(("ports", port.name, "from"))
        message = f"`{client.name}` ({origin}): {unknown('instance', instance, instances)}"
        yield Fault("unknown-instance", message, "", client.name)
        return
    for server in configured:
        if server.settings.namespace != namespace or instance not in (names.ANY, server.name):
            continue
        if server is client and instance == names.ANY:
            continue  # any instance is any other one
        offers = server.offers(port, None if instance == names.ANY else segment)
        if instance != names.ANY and not offers:
            what = "implement" if port.verb is Verb.REQUIRES else "publish"
            origin = client.document.place(("ports", port.name, "from"))
            message = f"`{client.name}` ({origin}): `{server.name}` does not {what} `{segment}`"
            yield Fault("nobody-provides", message, "", client.name)
        for theirs in offers:
            yield from _check_ends(client, port, server, theirs, operation)


def _check_ends(client: Configured, port: Port, server: Configured, theirs: Port, operation: str) -> Iterator[Fault]:
    here, there = client.middleware(port, operation), server.middleware(theirs, operation)
    if here == there or unfit(here) or unfit(there):
        return  # what is unfit has been told
    what = f"`{port.interface.short}.{operation}`"
    message = (
        f"`{client.name}` uses {what} over `{here}` ({client.origin(port, operation)}), "
        f"but `{server.name}` offers it over `{there}` ({server.origin(theirs, operation)})"
    )
    yield Fault(
        "middleware-mismatch", message, "choose one for both", client.name, (client.name, port.name, server.name)
    )
