"""Asks components what they are, and what they have counted, by their `Introspection`.

A component that does not implement it (one of RoboComp's, in another language, or older), that ends meanwhile, or that
answers nonsense, has no answer; nothing is raised for it. Another version may have more or fewer fields: what it lacks
has the default, and what is not known here is left out. Texts of others are made printable, since tools show them.
"""

from __future__ import annotations

import logging
import platform
from collections.abc import Callable, Collection, Iterable
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from ..contract import types
from ..errors import RobocompError, Unreachable
from ..printable import printable
from ..runtime.RoboCompCommonBehavior import COMMONBEHAVIOR_INTERFACE
from ..runtime.RoboCompIntrospection import Comment, Description, End, Measures
from ..transports.deployment import deployment_of
from .access import AT_ONCE as AT_ONCE
from .access import Access
from .network import Channel, Network

INTERFACE = "Introspection"

DEADLINE = 2.0
"""Seconds that a component has for an answer, unless the caller says otherwise."""

_MOST = 8
"""Components that are asked about one channel."""

log = logging.getLogger("robocomp.tools")

T = TypeVar("T")


def components(network: Network) -> list[str]:
    """The whole names of all instances that implement `Introspection`, as `robot1/world`."""
    return sorted({name for each in network.stock(INTERFACE) if (name := _instance(each))})


def with_log_levels(network: Network) -> list[str]:
    """The whole names of those whose levels `set_log_level` changes."""
    return network.offering(INTERFACE, ["setLogLevel"])


def hosts(network: Network) -> dict[str, str]:
    """The hosts of those instances which are on another one, by their whole names."""
    found = {_instance(each): end.host for each in network.stock(INTERFACE) for end in each.providers}
    return {name: host for name, host in found.items() if host}


def describe(access: Access, network: Network, component: str, deadline: float = DEADLINE) -> Description | None:
    """What a component is, by its whole name; None if it does not tell."""
    return _ask(access, network, component, "describe", Description, deadline)


def measure(access: Access, network: Network, component: str, deadline: float = DEADLINE) -> Measures | None:
    """What a component has counted since its start, by its whole name; None if it does not tell."""
    return _ask(access, network, component, "measure", Measures, deadline)


def prepare(access: Access, network: Network, components: Iterable[str], *operations: str) -> None:
    """Open the links for asking components. That is quicker than to open each when it is needed."""
    found = (_channel(network, name, operation) for name in components for operation in operations)
    access.keep([each for each in found if each])


def measure_all(access: Access, network: Network, instances: Iterable[str], deadline: float) -> dict[str, Measures]:
    """What components have counted, by their whole names: those that tell. At most `AT_ONCE` silent ones cost no more
    than one deadline."""
    names = list(instances)
    prepare(access, network, names, "measure")
    found = access.threads.map(lambda name: measure(access, network, name, deadline), names)
    return {name: told for name, told in zip(names, found, strict=True) if told is not None}


def set_log_level(access: Access, network: Network, component: str, logger: str, level: str, deadline: float) -> None:
    """Set the level of a logger of a component until it ends; `""` is that of all.

    Raises RemoteFailure with the component's reason, Unreachable, and what any call raises.
    """
    access.ask(_required(network, component, "setLogLevel"), (logger, level), deadline)


def watch(
    access: Access,
    network: Network,
    component: str,
    *,
    calls: bool,
    logs: bool,
    lease: float,
    deadline: float = DEADLINE,
) -> None:
    """Let a component publish its calls, its log records, or both, for `lease` seconds; see `tools.leases`.

    If components on several hosts have this name, all are asked. If all fail, raises the same as `set_log_level`.
    """
    asked = _required(network, component, "watch").each_way()
    errors: list[RobocompError] = []
    for each in asked:
        try:
            access.ask_again(each, (calls, logs, lease), deadline)
        except RobocompError as exc:
            errors.append(exc)
    if len(errors) == len(asked):
        raise errors[0]


def watched_on(network: Network, component: str) -> Collection[str]:
    """The hosts on which `watch` asks a component of this name."""
    channel = _channel(network, component, "watch")
    return channel.hosts if channel else ()


def about(access: Access, network: Network, channel: Channel, deadline: float = DEADLINE) -> End | None:
    """What one of the components at a channel tells of its operation, with comments; None if none tells.

    Those that provide it are asked first.
    """
    if channel.interface == COMMONBEHAVIOR_INTERFACE.short:
        return _of_common_behavior(channel)
    owners = [end.told.owner.rpartition("/")[2] for end in (*channel.providers, *channel.users)]
    known = components(network)
    asked = [name for owner in owners for name in known if name.rpartition("/")[2] == owner]
    for name in list(dict.fromkeys([*(each for each in known if channel.name.startswith(f"{each}/")), *asked]))[:_MOST]:
        told = describe(access, network, name, deadline)
        ends = told.ends if told else ()
        if found := next((end for end in ends if end.definition in channel.texts.values()), None):
            return found
    return None


def have_one_clock(access: Access, network: Network, channel: Channel) -> bool:
    """Whether all publishers of a topic are known to be on the host that hears them: this one, or that of a scout."""
    if deployment_of(channel.middlewares[0]).directory:
        return True  # it lists processes of one host only
    if channel.via:
        return False
    known = components(network)
    for end in channel.providers[:_MOST]:
        named = [name for name in known if name == end.told.owner or name.endswith(f"/{end.told.owner}")]
        told = describe(access, network, named[0]) if len(named) == 1 else None
        if told is None or told.host != platform.node():
            return False
    return len(channel.providers) <= _MOST


def _of_common_behavior(channel: Channel) -> End | None:
    """The same for an interface that no component tells of, since all have it."""
    for each in COMMONBEHAVIOR_INTERFACE.operations:
        if channel.name.endswith(f"/{each.name}"):
            noted = [Comment(field.name, field.doc) for field in each.inputs if field.doc]
            return End(operation=each.name, confirm=each.confirm, comments=[Comment("", each.doc), *noted])
    return None


def _ask(
    access: Access, network: Network, component: str, operation: str, wanted: type[T], deadline: float
) -> T | None:
    channel = _channel(network, component, operation)
    if channel is None:
        return None
    try:
        (values,) = access.ask_again(channel, (), deadline)
        (field,) = channel.operation.outputs
        return _taken(field.type, values, wanted)
    except (RobocompError, ValueError, TypeError) as exc:
        log.debug("%s: %s", channel.name, exc)  # it may have ended meanwhile, and its answer is not ours to trust
        return None


def _required(network: Network, component: str, operation: str) -> Channel:
    channel = _channel(network, component, operation)
    if channel is None:
        raise Unreachable(f"{component} is not there, or has no {INTERFACE}.{operation}")
    return channel


def _channel(network: Network, component: str, operation: str) -> Channel | None:
    found = network.stocked.get(f"{component.strip('/')}/{INTERFACE}/{operation}")
    return found if found and found.providers else None


def _instance(channel: Channel) -> str:
    return channel.name.rsplit("/", 2)[0]


def _taken(kind: types.Type, values: Any, wanted: type[T]) -> T:
    """An object of a generated class from the tuple of a struct, by the names of fields.

    Raises TypeError if a field is of another type than ours.
    """
    if not isinstance(kind, types.Struct):
        raise TypeError(f"{wanted.__name__} is no struct there")
    taken: T = _reader(kind, wanted)(values)  # type: ignore[arg-type]  # mypy: a class would not be hashable
    return taken


_Reader = Callable[[Any], Any]
"""Makes a value of ours from one of theirs. Raises TypeError or ValueError."""


@lru_cache(100)
def _reader(kind: types.Struct, wanted: Any) -> _Reader:
    """Reads structs of a kind: made once, since hundreds of components answer every second or two."""
    contract: types.Struct = wanted.__contract__
    ours = {each.name: each.type for each in contract.fields}
    shared = [(number, each) for number, each in enumerate(kind.fields) if each.name in ours]
    same = [(number, each.name) for number, each in shared if _is_same(ours[each.name], each.type)]
    readers = [
        (number, each.name, _reader_of(ours[each.name], each.type))
        for number, each in shared
        if not _is_same(ours[each.name], each.type)
    ]

    def read(values: Any) -> Any:
        if not isinstance(values, tuple) or len(values) != len(kind.fields):
            raise TypeError(f"{wanted.__name__} is no struct there")
        fields = {name: values[number] for number, name in same}
        for number, name, read_field in readers:
            fields[name] = read_field(values[number])
        return wanted(**fields)

    return read


def _reader_of(ours: types.Type, theirs: types.Type) -> _Reader:
    match ours, theirs:
        case types.Struct(python=python), types.Struct() if python is not None:
            return _reader(theirs, python)  # type: ignore[arg-type]  # the same
        case types.Sequence(item), types.Sequence(other) if isinstance(item, types.Struct | types.Primitive):
            read, is_array = _reader_of(item, other), item == other
            return lambda value: value if is_array and isinstance(value, np.ndarray) else [*map(read, value)]
        case types.Primitive.STRING, types.Primitive.STRING:
            return printable
        case types.Primitive(), types.Primitive() if ours is theirs:
            return lambda value: value

    def refuse(value: Any) -> Any:
        raise TypeError(f"{types.spell(theirs)} where {types.spell(ours)} is expected")

    return refuse


def _is_same(ours: types.Type, theirs: types.Type) -> bool:
    """Whether their values are ours as they are: numbers, bools and times. Texts of others are made printable."""
    return isinstance(ours, types.Primitive) and ours is theirs and ours is not types.STRING
