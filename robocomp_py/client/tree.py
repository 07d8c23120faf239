"""The names of a running network as objects with attributes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NoReturn

from ..contract.interface import Pattern
from ..tools.announced import OWN
from ..tools.network import Channel, Network
from . import showing

if TYPE_CHECKING:
    from .hearing import Listening
    from .operations import Topic
    from .session import Session

_START = "-start"
"""The end of the channel that makes an action of its name."""


class Branch:
    """A part of a network: a namespace, a component or an interface. What it has are attributes, and items.

    An item may be any name, with slashes: `net["world"]["Laser"]` is `net["world/Laser"]`. It is the only way to what
    is called like a method of this object, or is no word in Python.
    """

    _methods: tuple[str, ...] = ()
    """What its class adds, which may be meant by a name that is not there."""

    def __init__(self, session: Session, path: tuple[str, ...]) -> None:
        self._session, self._path = session, path

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # notebooks ask for many of these
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        return self._child(name)

    def __setattr__(self, name: str, value: object) -> None:
        if not name.startswith("_"):
            raise AttributeError(f"{self._shown}: `{name}` cannot be set; call an operation, or publish to a topic")
        super().__setattr__(name, value)

    def __getitem__(self, name: str) -> Any:
        if not isinstance(name, str):
            raise TypeError(f'{self._shown}: brackets take a name, as in ["world/Laser"], not {name!r}; {self._has}')
        first, _, rest = name.strip("/").partition("/")
        found = self._child(first)
        return found[rest] if rest else found

    def __iter__(self) -> Iterator[Any]:
        raise TypeError(f"{self._shown} is not a topic; {self._has}")

    def __call__(self, *_values: Any, **_named: Any) -> NoReturn:
        raise TypeError(f"{self._shown} is not an operation; {self._has}")

    @property
    def _has(self) -> str:
        return f"it has {', '.join(self._names())}"

    def __contains__(self, name: str) -> bool:
        return name in self._names()

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self._names()})

    def __repr__(self) -> str:
        if self._session.is_closed:
            return f"{self._shown}: the connection is closed"
        return "\n".join(showing.lines(self._shown, self._rows()))

    def _repr_html_(self) -> str:
        if self._session.is_closed:
            return showing.table(f"{self._shown}: the connection is closed", ())
        return showing.table(self._shown, self._rows())

    @property
    def _shown(self) -> str:
        return "/".join(self._path) or self._session.network or "network"

    def _names(self) -> list[str]:
        """What it has now; of the framework's own interfaces, none."""
        return list(dict.fromkeys(_children(self._session.census(), self._path)))

    def _rows(self) -> Iterator[tuple[str, str]]:
        """What it has, and what that is."""
        network = self._session.census()
        for name in dict.fromkeys(_children(network, self._path)):
            path = (*self._path, name)
            channel = _channel(network, path)
            inside = list(dict.fromkeys(_children(network, path)))
            yield name, _kind(path, channel) if channel else ", ".join(inside)

    def _child(self, name: str) -> Any:
        session, path = self._session, (*self._path, name)

        def find(network: Network) -> Any:
            channel = _channel(network, path)
            if channel:
                return session.kept("/".join(path), partial(_made, session, path, channel, network))
            if any(_children(network, path, own=True)):
                is_interface = any(_channel(network, (*path, each)) for each in _children(network, path, own=True))
                return (Interface if is_interface else Branch)(session, path)
            return None

        found = session.looked_up(find)
        if found is None:
            raise session.missing(self._path, name, self._names(), self._methods)
        return found


class Interface(Branch):
    """An interface of a component. If it has one topic, it can be used as that topic."""

    _methods = ("latest", "listen", "publish", "plot")

    def __iter__(self) -> Iterator[Any]:
        return iter(self._topic)

    def latest(self, timeout: float | None = None, *, newer_than: float | None = None) -> Any:
        """See `Topic.latest`."""
        return self._topic.latest(timeout, newer_than=newer_than)

    def listen(self, timeout: float | None = None, *, depth: int | None = None) -> Listening:
        """See `Topic.listen`."""
        return self._topic.listen(timeout, depth=depth)

    def publish(self, *values: Any, **named: Any) -> None:
        """See `Topic.publish`."""
        self._topic.publish(*values, **named)

    def plot(self, *fields: str, seconds: float = 5.0, axes: Any = None) -> Any:
        """See `Topic.plot`."""
        return self._topic.plot(*fields, seconds=seconds, axes=axes)

    @property
    def _topic(self) -> Topic:
        prefix = "/".join(self._path) + "/"
        topics = self._session.looked_up(
            lambda network: (
                [
                    each.name.removeprefix(prefix)
                    for each in network.channels.values()
                    if each.name.startswith(prefix) and each.pattern is Pattern.PUBLISH and "-" not in each.name
                ]
                or None
            )
        )
        if topics is None:
            raise TypeError(f"{self._shown} has no topic; {self._has}")
        if len(topics) > 1:
            raise TypeError(f"{self._shown} has several topics, so name one: {', '.join(topics)}")
        topic: Topic = self._child(topics[0])
        return topic


def _children(network: Network, path: Sequence[str], *, own: bool = False) -> Iterator[str]:
    """The names directly below a path: those of actions, not of their parts. With `own`, all of them."""
    prefix = "".join(f"{each}/" for each in path)
    for channel in network.channels.values():
        if not channel.name.startswith(prefix) or (channel.interface in OWN and not own):
            continue
        name, _, below = channel.name.removeprefix(prefix).partition("/")
        if below or own or "-" not in name:
            yield name
        elif name.endswith(_START) and channel.providers:
            yield name.removesuffix(_START)


def _channel(network: Network, path: Sequence[str]) -> Channel | None:
    """The channel of this name; of an action, that which begins goals."""
    name = "/".join(path)
    start = network.channels.get(name + _START)
    return network.channels.get(name) or (start if start and start.providers else None)


def _kind(path: Sequence[str], channel: Channel) -> str:
    if channel.name != "/".join(path):
        return "action"
    return "topic" if channel.pattern is Pattern.PUBLISH else str(channel.pattern)


def _made(session: Session, path: Sequence[str], channel: Channel, network: Network) -> Any:
    from . import operations

    if channel.name != "/".join(path):
        from ..tools.actions import offered
        from .goals import Action

        return Action(session, offered(network)["/".join(path)])
    match channel.pattern:
        case Pattern.PUBLISH:
            return operations.Topic(session, channel)
        case Pattern.QUERY:
            return operations.Query(session, channel)
        case Pattern.COMMAND:
            return operations.Command(session, channel)
