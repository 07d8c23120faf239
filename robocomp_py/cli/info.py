"""`rc info`: the contract of a channel, and what uses it."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

from .common import FINE
from .completing import What, completed
from .hosts import add_hosts, hosts_of
from .live import EXIT_STATUS, TOPIC, add_definitions, add_json, add_middleware, add_waiting, awaited, reported

if TYPE_CHECKING:
    from ..tools.actions import Offered
    from ..tools.network import Channel, End, Network

NAME = "info"

_EXAMPLES = f"""\
examples:
  rc info LaserPub                      types, quality of service, publishers and subscribers
  rc info world/Laser/getLaserData      one operation
  rc info Laser --json                  for machines

Sides with different contracts are shown with their differences.

{EXIT_STATUS}
"""

_PATIENCE = 1.0
"""Seconds that a component has to tell its comments."""

_PROVIDES = {"publish": "published by", "query": "served by", "command": "received by"}
_USES = {"publish": "subscribed by", "query": "called by", "command": "sent by"}


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Show the operation, its types, and the processes on both sides, as they announce them."
    to.epilog = _EXAMPLES
    completed(to.add_argument("name", metavar="NAME", help=TOPIC), What.CHANNEL)
    add_definitions(to)
    add_waiting(to)
    add_hosts(to)
    add_middleware(to)
    add_json(to)


def run(options: argparse.Namespace) -> int:
    with reported("rc info") as code, hosts_of(options) as hosts:

        def pick(network: Network) -> tuple[Network, list[Offered], list[Channel]]:
            return network, *_meant(network, options.name)

        network, actions, found = awaited(options, pick, hosts)
        comments = _comments(network, found)
        if options.json:
            for action in actions:
                print(json.dumps(told_action(action)))
            for each in found:
                print(json.dumps(_told(each, comments[each.name])))
        else:
            blocks = [*map(described_action, actions), *(_described(each, comments[each.name]) for each in found)]
            print("\n\n".join(map("\n".join, blocks)))
        return FINE
    return code()


def _meant(network: Network, name: str) -> tuple[list[Offered], list[Channel]]:
    """The actions that a name means, and the channels that are no parts of these. Raises ValueError."""
    from ..tools.actions import offered

    actions = [each for each in offered(network).values() if each.is_meant_by(name) and each.is_understood]
    try:
        channels = network.named(name)
    except ValueError:
        if not actions:
            raise
        channels = []
    parts = {channel.name for each in actions for channel in each.parts.values()}
    return actions, [each for each in channels if each.name not in parts]


def told_action(offered: Offered) -> dict[str, object]:
    """An action for machines."""
    from ..tools.actions import told

    return {"action": offered.name, "contract": list(told(offered.action))}


def described_action(offered: Offered) -> Iterator[str]:
    """An action for people, as one operation."""
    from ..tools.actions import told

    yield f"{offered.name}: action"
    yield from (f"  {line}" for line in told(offered.action))
    for word, ends in (("served", offered.start.providers), ("used", offered.start.users)):
        yield from (f"  {word} by {end_line(end)}" for end in ends)


def _comments(network: Network, found: list[Channel]) -> dict[str, list[tuple[str, str]]]:
    """What components tell of these operations: of each the field that is meant, or "", and the text."""
    from ..tools import asking
    from ..tools.access import Access

    told: dict[str, list[tuple[str, str]]] = {}
    with Access() as access:
        for each in found:
            end = asking.about(access, network, each, _PATIENCE)
            notes = end.comments if end else ()
            told[each.name] = [(note.about, " ".join(note.text.split())) for note in notes if note.text.strip()]
    return told


def _told(channel: Channel, comments: list[tuple[str, str]]) -> dict[str, object]:
    """The same for machines."""
    return {
        "channel": channel.name,
        "pattern": channel.pattern,
        "contract": list(_contract(channel)),
        "comments": [{"about": about, "text": text} for about, text in comments],
        "ends": [
            {
                "role": end.role,
                "component": end.told.owner,
                "process": end.told.pid,
                "host": end.host,
                "middleware": end.middleware,
                "fingerprint": f"{end.told.fingerprint:016x}",
                "qos": _qos(end),
            }
            for end in channel.ends
        ],
    }


def _contract(channel: Channel) -> Iterator[str]:
    """Its operation and types, or why they are not known."""
    from ..tools.idsl import declared
    from ..tools.network import NotUnderstood

    try:
        yield from declared(channel.operation)
    except NotUnderstood as exc:
        yield str(exc)


def _qos(end: End) -> dict[str, object] | None:
    """What a publisher offers, or a subscriber asks for; None at other ends, and if it does not tell."""
    from ..contract.qos import from_traits

    has_qos = end.role in ("publishes", "subscribes") and end.told.traits
    return asdict(from_traits(end.told.traits)) if has_qos else None


def _described(channel: Channel, comments: list[tuple[str, str]]) -> Iterator[str]:
    from ..contract.interface import differences

    yield f"{channel.name}: {channel.pattern}"
    yield from (f"  // {about}: {text}" if about else f"  // {text}" for about, text in comments)
    yield from (f"  {line}" for line in _contract(channel))
    fingerprint, text = next(iter(channel.texts.items()))
    for word, ends in ((_PROVIDES, channel.providers), (_USES, channel.users)):
        for end in ends:
            yield f"  {word[channel.pattern]} {end_line(end)}"
            if end.told.fingerprint != fingerprint:
                for each in differences(end.told.text, text) if end.told.text else ["unknown"]:
                    yield f"    another contract: {each}"


def end_line(end: End) -> str:
    """What is at one end of a channel, for people."""
    from ..contract.qos import History, from_traits

    told = end.told
    where = f" on {end.host}" if end.host else ""
    line = f"{told.owner or '?'} (process {told.pid}{where}) over {end.middleware}"
    if end.role not in ("publishes", "subscribes") or not told.traits:
        return line
    qos = from_traits(told.traits)
    kept = f"depth {qos.depth}" if qos.history is History.KEEP_LAST else str(qos.history)
    policies = [str(qos.reliability), str(qos.durability), kept]
    policies += [f"{name} {value:g} s" for name in ("deadline", "lifespan", "lease") if (value := getattr(qos, name))]
    return f"{line}: {', '.join(policies)}"
