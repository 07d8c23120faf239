"""Named instances: a component provides one interface under several names, which it adds and removes while it runs.

    self.laser.add("front", FrontLaser())        implements Laser each;       serves front/Laser/getLaserData
    self.laserpub.add("front").pushLaserData(…)  publishes LaserPub each;     publishes on front/LaserPub/pushLaserData

Their channels are those of a component of that name, so clients do not know the difference.
"""

from __future__ import annotations

import functools
import logging
import threading
from abc import ABC
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from ..contract.component import Port
from ..errors import Closed, ComponentError, ConfigurationError
from ..spelling import unknown
from ..transports.base import Link
from ..wire import names
from .ports import Proxy
from .status import Bound
from .watching import Watched

if TYPE_CHECKING:
    from .settings import Settings
    from .worker import Worker

log = logging.getLogger("robocomp.worker")

_MOST_REFUSED = 10
"""Maximum number of refused names that are told."""

T = TypeVar("T")
H = TypeVar("H", bound="InstanceHandler")
X = TypeVar("X", bound=Proxy)


class InstanceHandler(ABC):  # noqa: B024 - the generated classes have abstract methods
    """Base of the generated classes whose objects answer the calls of one named instance.

    Its methods are handlers: only one of them, or of the worker's methods, runs at a time.
    """

    instance = ""
    """The name under which it was added; "" before that."""

    reads_caller = False
    """Whether methods may read `caller`. Set it to True in a derived class."""

    @property
    def caller(self) -> str:
        """In a handler: the instance that made the call; "" if it is not known, and outside of handlers.

        Raises ComponentError unless the class has `reads_caller = True`.
        """
        from .callers import caller_for  # only handlers that use this need it

        return caller_for(self)


@dataclass
class Entry(Generic[T]):
    """One named instance: its handler or proxy, and its links once they are open."""

    name: str
    given: T
    links: list[Link] = field(default_factory=list)
    watched: list[Watched] = field(default_factory=list)
    bound: Bound | None = None
    counters: Sequence[int] = ()
    """The numbers of its counters, if the component follows a clock in lock-step."""
    is_gone: bool = False

    @property
    def reads_caller(self) -> bool:
        """Whether its handlers may read `caller`."""
        return isinstance(self.given, InstanceHandler) and self.given.reads_caller

    def handlers(self, port: Port) -> object:
        """Its handlers. A call that begins after its end is refused."""
        methods = [port.handler(operation.name) for operation, _ in port.interface.under(port.verb)]
        return SimpleNamespace(**{name: _until_gone(self, getattr(self.given, name)) for name in methods})


class Binder(Protocol):
    """Connects named instances; see `Connections`."""

    def bind(self, port: Port, entry: Entry[Any]) -> None:
        """Open the links of an instance."""
        ...

    def unbind(self, entry: Entry[Any]) -> None:
        """Close them."""
        ...

    def suspended(self) -> AbstractContextManager[None]:
        """Let other handlers run meanwhile."""
        ...

    def changed(self) -> None:
        """Called when the instances differ from the declared ones in another way than before."""
        ...


class NamedInstances(Mapping[str, T]):
    """The instances of one interface, by name. May be used from any thread."""

    def __init__(self, port: Port, owner: str, offered: frozenset[str] | None) -> None:
        """`offered` has the names that the network declares; None if any name may be added."""
        self._port, self._owner, self._offered = port, owner, offered
        self._entries: dict[str, Entry[T]] = {}
        self._changing = threading.Lock()
        self._binder: Binder | None = None
        """From the start of the component on; until then, added instances wait for it."""
        self._is_closed = False
        self._refused: dict[str, None] = {}
        """Names that the component wanted to add, and that the network does not declare."""

    def __getitem__(self, name: str) -> T:
        entry = self._entries.get(name)
        if entry is None:
            raise KeyError(unknown("instance", name, self._entries))
        return entry.given

    def __iter__(self) -> Iterator[str]:
        return iter(list(self._entries))

    def __len__(self) -> int:
        return len(self._entries)

    def __repr__(self) -> str:
        return f"<{self._port.interface.short} each: {', '.join(self) or 'none'}>"

    def is_declared(self, name: str) -> bool:
        """Whether a name may be added: the network declares it by `offers`, or the component runs without a network."""
        return self._offered is None or name in self._offered

    @property
    def absent(self) -> list[str]:
        """The names that the network declares and that were not added."""
        return sorted(set(self._offered or ()) - set(self._entries))

    def remove(self, name: str) -> None:
        """Stop providing an instance: later calls of it fail like calls of a component that has stopped.

        Waits for running handlers of the instance; meanwhile other handlers may run. Raises KeyError for a name that
        is not there.
        """
        with self._changing:
            entry = self._entries.pop(name, None)
            if entry is None:
                raise KeyError(unknown("instance", name, self._entries))
            entry.is_gone = True
            binder = self._binder
        if binder:
            with binder.suspended():
                binder.unbind(entry)
        self._tell_changed()

    def _add(self, entry: Entry[T]) -> None:
        self._check(entry.name)
        with self._changing:
            if self._is_closed:
                raise Closed("the component is stopping")
            if entry.name in self._entries:
                raise ValueError(f"`{entry.name}` was added before; remove it first")
            self._entries[entry.name] = entry
            binder = self._binder
        if binder is None:
            return
        try:
            binder.bind(self._port, entry)
        except BaseException:
            with self._changing:
                entry.is_gone = True
                if self._entries.get(entry.name) is entry:
                    del self._entries[entry.name]
            binder.unbind(entry)
            raise
        if entry.is_gone:  # removed by another thread meanwhile
            binder.unbind(entry)
        self._tell_changed()

    def _check(self, name: str) -> None:
        if not isinstance(name, str) or not names.is_segment(name):
            raise ValueError(f"{name!r} is not a name for an instance; allowed: letters, digits, `_`, `-`")
        if not self.is_declared(name):
            short = self._port.interface.short
            if len(self._refused) < _MOST_REFUSED:
                self._refused[name] = None
            self._tell_changed()
            there = f"declared: {', '.join(sorted(self._offered))}" if self._offered else "it declares none"
            raise ConfigurationError(
                f"the network does not declare that `{self._owner}` offers `{name} : {short}` ({there}); "
                f"write in its block: offers {name} : {short};"
            )

    def _tell_changed(self) -> None:
        binder = self._binder
        if binder and self._offered is not None and not self._is_closed:
            binder.changed()

    # For the component that they belong to.

    def begin(self, binder: Binder) -> None:
        """Connect the instances that were added before."""
        with self._changing:
            self._binder = binder
            waiting = list(self._entries.values())
        for entry in waiting:
            binder.bind(self._port, entry)

    def end(self) -> None:
        """Close all links. From now on, no instance can be added."""
        with self._changing:
            self._is_closed = True
            entries, self._entries = list(self._entries.values()), {}
            binder = self._binder
        for entry in reversed(entries):
            entry.is_gone = True
            if binder:
                binder.unbind(entry)

    @property
    def missing(self) -> list[str]:
        """The names that the network declares and that are not there."""
        return sorted((self._offered or frozenset()) - self._entries.keys())

    def differences(self) -> Iterator[str]:
        """How it differs from what the network declares, in words."""
        short = self._port.interface.short
        yield from (f"does not offer {name} : {short}, which the network declares" for name in self.missing)
        yield from (f"wanted to offer {name} : {short}, which the network does not declare" for name in self._refused)

    def tell_missing(self) -> None:
        """Warn of the names that the network declares and that are not added."""
        short, add = self._port.interface.short, f"self.{self._port.attribute}.add"
        for name in self.missing:
            log.warning(
                "the network declares that `%s` offers `%s : %s`, which it has not added: "
                "call %s(%r%s), or correct the network",
                *(self._owner, name, short, add, name, "" if self._port.verb.has_proxy else ", ..."),
            )


class NamedHandlers(NamedInstances[H]):
    """The instances that implement an interface, by name: `self.laser["front"]` is the handler of `front`."""

    def add(self, name: str, handler: H) -> H:
        """Implement the interface under a name, and return the handler.

        Calls are admitted when the component is ready, or at once if it is. Raises ValueError for a name that is not
        one or was added before, ConfigurationError if the network does not declare it, and AlreadyServed if another
        component has this name and interface.
        """
        _check_handler(self._port, handler)
        if handler.instance:
            raise ValueError(f"this handler was added as `{handler.instance}`; make one for each name")
        handler.instance = name  # first: calls may come as soon as it is bound
        try:
            self._add(Entry(name, handler))
        except BaseException:  # also Ctrl-C: the handler may be added again
            handler.instance = ""
            raise
        return handler

    def remove(self, name: str) -> None:
        handler = self.get(name)
        super().remove(name)
        if handler is not None:
            handler.instance = ""


class NamedProxies(NamedInstances[X]):
    """The instances that publish an interface, by name: `self.laserpub["front"]` is the proxy of `front`."""

    def add(self, name: str) -> X:
        """Publish the interface under a name, and return the proxy to publish by.

        Raises ValueError for a name that is not one or was added before, and ConfigurationError if the network does
        not declare it. After `remove`, publishing raises Closed.
        """
        assert self._port.proxy is not None
        proxy: X = self._port.proxy(_NotYet())
        self._add(Entry(name, proxy))
        return proxy


class _NotYet(dict[str, Any]):
    """The operations of a proxy before the component has begun."""

    def __missing__(self, operation: str) -> Any:
        raise ComponentError("nothing can be published before `initialize`: the links are not open")


def _until_gone(entry: Entry[Any], method: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(method)
    def run(*arguments: Any) -> Any:
        if entry.is_gone:
            raise Closed(f"{entry.name} was removed")
        return method(*arguments)

    return run


def _check_handler(port: Port, handler: object) -> None:
    """Raises TypeError for an object that cannot answer."""
    wanted = f"an object of a class derived from {port.interface.short}Handler"
    if isinstance(handler, type):
        raise TypeError(f"`add` needs {wanted}, not the class {handler.__name__} itself: write {handler.__name__}(…)")
    methods = [port.handler(operation.name) for operation, _ in port.interface.under(port.verb)]
    if not isinstance(handler, InstanceHandler) or not all(callable(getattr(handler, name, None)) for name in methods):
        raise TypeError(f"`add` needs {wanted}, not of {type(handler).__name__}")


def add_to(worker: Worker[Any], settings: Settings) -> None:
    """Give a worker the attributes of its named instances."""
    for port in worker.component.named:
        kind: type[NamedInstances[Any]] = NamedProxies if port.verb.has_proxy else NamedHandlers
        setattr(worker, port.attribute, kind(port, settings.instance, settings.offered(port)))
