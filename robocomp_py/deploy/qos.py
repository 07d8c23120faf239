"""What the ports of instances ask of middlewares that these do not offer.

What a subscriber asks for beyond what its publisher offers is told with their route (`routes.unmet`):
no middleware has to do with that.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..contract.component import Port
from ..contract.interface import Pattern
from ..contract.qos import QoS
from ..transports.base import Capability, Channel, TypeRef, find_transport, needs
from ..transports.network import Fault
from .routes import Configured, unfit

_WORDS = {
    Capability.RELIABLE: "reliable or keep_all",
    Capability.LATCHED: "transient_local",
    Capability.DEADLINE: "deadline",
    Capability.LIFESPAN: "lifespan",
    Capability.LIVELINESS: "lease or liveliness",
}
"""By what leads to it, in the words of `qos( … )`."""


def unsupported(configured: Sequence[Configured]) -> Iterator[Fault]:
    """A fault for each port whose QoS a middleware that carries it does not offer."""
    for each in configured:
        for port, operation, pattern in each.patterns():
            for middleware in each.settings.middlewares(port, operation, each.generated_for):
                yield from unsupported_over(middleware, each.origin(port, operation), each, port, operation, pattern)


def lacking(middleware: str, pattern: Pattern, qos: QoS) -> list[str]:
    """What a middleware does not offer of a QoS, in its words. Of one that does not say what it offers, nothing."""
    offered: Capability | None = getattr(find_transport(middleware), "capabilities", None)
    if offered is None:
        return []
    missing = needs(Channel("", pattern, TypeRef(""), qos)) & ~offered
    return [word for capability, word in _WORDS.items() if capability in missing]


def unsupported_over(
    middleware: str, origin: str, each: Configured, port: Port, operation: str, pattern: Pattern
) -> Iterator[Fault]:
    """A fault if a middleware does not offer the QoS of a port. `origin` is where it was chosen, for people."""
    if not middleware or unfit(middleware):
        return  # which is told elsewhere
    missing = lacking(middleware, pattern, each.qos(port, operation))
    if missing:
        message = (
            f"`{middleware}` ({origin}) does not offer {', '.join(missing)}, which `{each.name}` "
            f"asks for in its `{port.verb} {port.label}`{each.qos_origin(port, operation)}"
        )
        hint = "choose another middleware for it, or ask for less"
        yield Fault("unfit-middleware", message, hint, each.name, (each.name, port.name, middleware))
