"""The status of a component, for `CommonBehavior.getStatus` and for its launcher.

It is collected on request; until then a component only counts.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ..contract.component import Port
from ..contract.interface import Verb
from ..errors import TransportError
from ..transports.base import Link, SupportsSources
from ..version import __version__
from ..wire import names
from .lifecycle import State
from .RoboCompCommonBehavior import PortStatus, Status, TimerStatus
from .route import Route
from .timers import Timer
from .watching import Watched


@dataclass(frozen=True, slots=True)
class Bound:
    """A port, the middlewares of its operations, and its links."""

    port: Port
    routes: Sequence[Route]
    links: Sequence[Link]
    instance: str = ""
    """The name of a named instance; "" for the component's own."""


@dataclass(frozen=True, slots=True)
class Counts:
    """Counters of a component since its start."""

    computes: int
    overruns: int


def life(instance: str, state: State, counts: Counts, watched: Sequence[Watched]) -> str:
    """One line of status: name, state, overruns, missed deadlines, lost publishers and our version."""
    missed, lost = _totals(watched)
    return f"{instance} {state} {counts.overruns} {missed} {lost} {__version__}"


def status(
    instance: str,
    component: str,
    state: State,
    counts: Counts,
    bound: Sequence[Bound],
    watched: Sequence[Watched],
    timers: Iterable[Timer] = (),
) -> Status:
    missed, lost = _totals(watched)
    ports = [_port(each, [one for one in watched if one.port is each.port]) for each in bound]
    told = [TimerStatus(each.name, each.period, each.calls, each.overruns) for each in timers]
    return Status(
        instance, component, __version__, str(state), counts.computes, counts.overruns, missed, lost, ports, told
    )


def _port(bound: Bound, watched: Sequence[Watched]) -> PortStatus:
    port = bound.port
    missed, lost = _totals(watched)
    carriers = dict.fromkeys(route.middleware for each in bound.routes for route in each.all)
    return PortStatus(
        name=f"{bound.instance}/{port.label}" if bound.instance else port.label,
        verb=str(port.verb),
        type=port.interface.short,
        middleware=",".join(carriers),
        peers=_peers(bound),
        connected=all(_has_peer(link) for link in bound.links),
        missed=missed,
        lost=lost,
    )


def _peers(bound: Bound) -> list[str]:
    """The names of the peers: a client knows its server, and a subscriber its publishers.

    A server does not know its clients, nor a publisher its subscribers.
    """
    if bound.port.verb.provides:
        return []
    found = {names.instance(route.channel) for each in bound.routes for route in each.all}
    if bound.port.verb is Verb.SUBSCRIBES:
        for link in bound.links:
            if isinstance(link, SupportsSources):
                found |= {names.instance(channel) for channel, _ in link.sources()}
    return sorted(found - {names.ANY})


def _has_peer(link: Link) -> bool:
    try:
        return link.wait_peer(0.0)
    except TransportError:  # the link is being closed
        return False


def _totals(watched: Sequence[Watched]) -> tuple[int, int]:
    totals = [each.totals() for each in watched]
    return sum(missed for missed, _ in totals), sum(lost for _, lost in totals)
