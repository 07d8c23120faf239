"""What the network says of named instances, compared with the components that offer them."""

from __future__ import annotations

from collections.abc import Sequence

from ..contract.component import Port
from ..dsl.diagnostics import Report, did_you_mean
from ..dsl.source import Name
from .uses import Node


def read_offers(nodes: Sequence[Node], report: Report) -> None:
    """Note which ports each named instance provides; what is wrong with that goes into the report."""
    for node in nodes:
        named = {port.interface.short: port for port in node.component.named}
        for offer in node.instance.offers:
            ports = [port for each in offer.interfaces if (port := named.get(each.text) or _told(node, each, report))]
            node.offers[offer.local] = tuple(ports)
            for port in ports:
                node.places[f"{offer.local}/{port.name}"] = offer.name
        if named and not node.instance.offers:
            short = next(iter(named))
            message = f"`{node.name}` has named instances of `{'`, `'.join(named)}`, but the network declares none"
            hint = f"write in its block, for example: offers front : {short};"
            report.warning("missing-offers", message, node.instance.name.span, hint)


def _told(node: Node, interface: Name, report: Report) -> Port | None:
    """Report an interface of which the component has no named instances."""
    component = node.component
    provided = [port for port in component.ports if port.verb.provides and port.interface.short == interface.text]
    if provided:
        message = f"`{component.name}` provides `{interface}` by its own name only"
        hint = f"write in its CDSL: {provided[0].verb} {interface} each"
    else:
        named = [port.interface.short for port in component.named]
        message = f"`{component.name}` has no named instances of `{interface}`"
        hint = did_you_mean(interface.text, named) or (f"it has: {', '.join(named)}" if named else "remove it")
    report.error("wrong-offers", message, interface.span, hint)
    return None
