"""The order in which the processes of a network start and stop, and the instances inside of each. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..contract.interface import Verb
from ..dsl.ddsl.model import Deployment
from ..dsl.ddsl.order import start_order
from ..dsl.source import Name
from .ordering import Edge, Order, ordered
from .plan import Link
from .uses import Node

_MOST_CIRCLES = 3
"""Maximum number of circles of requirements that are listed."""


@dataclass(frozen=True)
class Start:
    """How the processes of a network start."""

    processes: Mapping[str, list[Node]]
    """The instances of each process: those that others depend on or require come first; otherwise as written."""
    between: Order
    """Of processes."""
    inside: Mapping[str, Order]
    """By process, of its instances."""

    def circles(self) -> Iterator[str]:
        """One line about instances that require each other."""
        orders = (self.between, *self.inside.values())
        circles = [circle for order in orders for circle in order.circles]
        broken = [f"{provider} before {client}" for order in orders for client, provider in order.broken]
        if circles:
            told = "; ".join(", ".join(circle) for circle in circles[:_MOST_CIRCLES])
            more = f"; and {len(circles) - _MOST_CIRCLES} more circles" if len(circles) > _MOST_CIRCLES else ""
            order = ", ".join(broken[:_MOST_CIRCLES]) + (", ..." if len(broken) > _MOST_CIRCLES else "")
            yield f"these require each other and start at the same time: {told}{more}; when the network stops: {order}"


def start_of(
    model: Deployment, nodes: Sequence[Node], links: Sequence[Link], dependences: Mapping[str, Sequence[Name]]
) -> Start:
    """The start of these instances. `dependences` are the processes that each process depends on by its clauses."""
    between, inside = _orders(nodes, links, dependences)
    earlier = {
        node.name: (*node.instance.dependences, *_names(node, inside[node.instance.runs_in.text])) for node in nodes
    }
    first, _ = start_order(earlier)
    by_name = {node.name: node for node in nodes}
    together = _together(map(by_name.__getitem__, first))
    name = model.name
    order, _ = start_order(
        {
            each: (*others, *(Name(other, name.span) for other in between.ready_after.get(each, ())))
            for each, others in dependences.items()
        }
    )
    return Start({name: together[name] for name in order if name in together}, between, inside)


def _names(node: Node, order: Order) -> Iterator[Name]:
    return (Name(other, node.instance.name.span) for other in order.stops_before.get(node.name, ()))


def _together(nodes: Iterable[Node]) -> dict[str, list[Node]]:
    """The instances by their processes."""
    together: dict[str, list[Node]] = {}
    for node in nodes:
        together.setdefault(node.instance.runs_in.text, []).append(node)
    return together


def _orders(
    nodes: Sequence[Node], links: Sequence[Link], dependences: Mapping[str, Sequence[Name]]
) -> tuple[Order, dict[str, Order]]:
    """The order that `requires` makes, between processes and inside each of them."""
    by_name = {node.name: node for node in nodes}
    between: Counter[Edge] = Counter()
    inside: dict[str, Counter[Edge]] = {node.instance.runs_in.text: Counter() for node in nodes}
    for link in links:
        if link.verb is Verb.REQUIRES and link.client != link.provider:
            client, provider = by_name[link.client], by_name[link.provider]
            ends = client.instance.runs_in.text, provider.instance.runs_in.text
            apart = ends[0] != ends[1]
            edges, edge = (between, ends) if apart else (inside[ends[0]], (link.client, link.provider))
            edges[edge] += _operations(client, link.interface)
    fixed = {name: [other.text for other in dependences[name] if other.text in inside] for name in inside}
    found: dict[str, Order] = {}
    for name, together in _together(nodes).items():
        members = {node.name: node.instance.dependences for node in together}
        own = {each: [other.text for other in others if other.text in members] for each, others in members.items()}
        found[name] = ordered(members, own, inside[name])
    return ordered(inside, fixed, between), found


def _operations(client: Node, interface: str) -> int:
    """How many operations of an interface an instance may call."""
    wanted = (port for port in client.component.ports if port.verb is Verb.REQUIRES)
    return max(
        (len([*port.interface.contracts(port.verb)]) for port in wanted if port.interface.short == interface), default=1
    )
