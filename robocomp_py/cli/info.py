"""`rc info`: the contract of a channel, and what uses it."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from .common import FINE
from .live import EXIT_STATUS, add_middleware, add_waiting, awaited, reported

if TYPE_CHECKING:
    from ..contract.interface import Operation
    from ..contract.types import Field
    from ..tools.network import Channel, End, Network

NAME = "info"
HELP = "show the contract of a topic, query or command, and what uses it"

_EXAMPLES = f"""\
examples:
  rc info LaserPub                      types, quality of service, publishers and subscribers
  rc info world/Laser/getLaserData      one operation

Sides with different contracts are shown with their differences.

{EXIT_STATUS}
"""

_PROVIDES = {"publish": "published by", "query": "served by", "command": "received by"}
_USES = {"publish": "subscribed by", "query": "called by", "command": "sent by"}


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Show the operation, its types, and the processes on both sides, as they announce them."
    to.epilog = _EXAMPLES
    to.formatter_class = argparse.RawDescriptionHelpFormatter
    to.add_argument("name", metavar="NAME", help="world/LaserPub/pushLaserData, or a part of such a name")
    add_waiting(to)
    add_middleware(to)


def run(options: argparse.Namespace) -> int:
    with reported("rc info") as code:

        def pick(network: Network) -> list[Channel]:
            return network.named(options.name)

        print("\n\n".join("\n".join(_described(each)) for each in awaited(options, pick)))
        return FINE
    return code()


def _described(channel: Channel) -> Iterator[str]:
    from ..contract.interface import differences
    from ..tools.network import NotUnderstood

    yield f"{channel.name}: {channel.pattern}"
    try:
        yield from (f"  {line}" for line in _idsl(channel.operation))
    except NotUnderstood as exc:
        yield f"  {exc}"
    fingerprint, text = next(iter(channel.texts.items()))
    for word, ends in ((_PROVIDES, channel.providers), (_USES, channel.users)):
        for end in ends:
            yield f"  {word[channel.pattern]} {_end(end)}"
            if end.told.fingerprint != fingerprint:
                for each in differences(end.told.text, text) if end.told.text else ["unknown"]:
                    yield f"    another contract: {each}"


def _end(end: End) -> str:
    from ..contract.qos import from_traits

    told = end.told
    line = f"{told.owner or '?'} (process {told.pid}) over {end.middleware}"
    if end.role != "publishes" or not told.traits:
        return line
    qos = from_traits(told.traits)
    policies = [str(qos.reliability), str(qos.durability)]
    policies += [f"{name} {value:g} s" for name in ("deadline", "lifespan", "lease") if (value := getattr(qos, name))]
    return f"{line}: {', '.join(policies)}"


def _idsl(operation: Operation[Any]) -> Iterator[str]:
    """The operation and its types, much as an IDSL file has them."""
    from ..contract.types import Enumeration, Struct, walk

    outputs = list(operation.outputs)
    returned = _word(outputs.pop(0)) if outputs and outputs[0].name == "ret" else "void"
    given = [f"{_word(each)} {each.name}" for each in operation.inputs]
    given += [f"out {_word(each)} {each.name}" for each in outputs]
    thrown = ", ".join(_short(each.name) for each in operation.raises)
    yield f"{returned} {operation.name}({', '.join(given)}){' throws ' + thrown if thrown else ''};"
    fields = [each for kind in operation.raises for each in kind.fields]
    for kind in walk(*(each.type for each in (*operation.inputs, *operation.outputs, *fields))):
        match kind:
            case Struct():
                yield f"struct {_short(kind.name)} {{{_members(kind.fields)}}};"
            case Enumeration(members=members):
                yield f"enum {_short(kind.name)} {{ {', '.join(name for name, _ in members)} }};"
    for exception in operation.raises:
        yield f"exception {_short(exception.name)} {{{_members(exception.fields)}}};"


def _members(fields: tuple[Field, ...]) -> str:
    return "".join(f" {_word(each)} {each.name};" for each in fields) + " "


def _word(field: Field) -> str:
    """The type of a field, without the names of modules."""
    from ..contract.types import spell

    return re.sub(r"\w+::", "", spell(field.type))


def _short(name: str) -> str:
    return name.rpartition("::")[2]
