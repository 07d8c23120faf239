"""What a plan says for tools: the instances that rcgen generated, and the channels of foreign programs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from ..contract.component import Port
from ..contract.interface import Pattern, Verb
from ..contract.told import supplement
from ..transports.deployment import deployment_of
from ..wire import names
from .plan import Ours, Programs, Served
from .routes import Configured
from .wiring import Placement


def describe_ours(each: Configured, folder: Path, middlewares: Iterable[str]) -> Ours:
    """An instance whose generic part is in a folder, and which opens these middlewares."""
    over = {f"{name} {each.settings.transports.get(name, {}).get('domain', '')}".strip() for name in middlewares}
    topics = tuple(
        "/".join((part.channels, part.component.segment(port), name))
        for part in each.parts
        for port in part.component.ports
        if port.verb.provides
        for name in _topics(port)
    )
    return Ours(folder.resolve(), each.component.fingerprints(), each.channels, tuple(sorted(over)), topics)


def _topics(port: Port) -> Iterator[str]:
    """What a port publishes, parts of actions included."""
    for operation, pattern in port.interface.under(port.verb):
        if pattern is Pattern.PUBLISH:
            yield operation.name
    for action in port.interface.actions_under(port.verb):
        yield from (part.name for part in action.topics)


def describe_programs(programs: Sequence[Configured], placement: Placement) -> Iterator[Programs]:
    """What foreign programs serve at known places, and publish, for tools: they announce nothing themselves."""
    for middleware in dict.fromkeys((*placement.programs, *placement.publishers)):
        calls, topics = _reached(programs, middleware, placement), list(_heard(programs, middleware, placement))
        if calls and topics:
            first, *topics = topics  # a tool opens the middleware once for each set of options
            calls = Programs(middleware, {**calls.options, **first.options}, (*calls.serve, *first.serve))
        yield from ([calls] if calls else [])
        yield from topics


def _reached(programs: Sequence[Configured], middleware: str, placement: Placement) -> Programs | None:
    """The queries and commands of foreign programs."""
    places = placement.programs.get(middleware, {})
    found: list[Served] = []
    at: dict[str, str] = {}
    for each, part, port in _provided(programs, Verb.IMPLEMENTS):
        segment = part.component.segment(port)
        place = places.get((each.name, names.within(part.instance if part.owner else "", segment)))
        for served in _described(each, part, port) if place else ():
            found.append(served)
            at[served.channel] = str(place)
    return Programs(middleware, deployment_of(middleware).reaching(at), tuple(found)) if found else None


def _heard(programs: Sequence[Configured], middleware: str, placement: Placement) -> Iterator[Programs]:
    """The topics of foreign programs."""
    publishers = placement.publishers.get(middleware, {})
    topics = {
        served.channel: served
        for each, part, port in _provided(programs, Verb.PUBLISHES)
        if each.name in publishers
        for served in _described(each, part, port)
    }
    by_channel = {channel: publishers[each.instance] for channel, each in topics.items()}
    for options, channels in deployment_of(middleware).hearing(by_channel):
        yield Programs(middleware, options, tuple(topics[each] for each in channels))


def _provided(configured: Iterable[Configured], verb: Verb) -> Iterator[tuple[Configured, Configured, Port]]:
    """The interfaces that instances implement or publish: each with the instance, and with the part that offers it."""
    for each in configured:
        for part in each.parts:
            yield from ((each, part, port) for port in part.component.ports if port.verb is verb)


def _described(program: Configured, part: Configured, port: Port) -> Iterator[Served]:
    """The channels of an interface of a foreign program."""
    for operation, pattern in port.interface.under(port.verb):
        channel = "/".join((part.channels, part.component.segment(port), operation.name))
        contract = operation.fingerprint, operation.text, supplement(operation)
        yield Served(program.name, program.channels, channel, pattern, *contract)
