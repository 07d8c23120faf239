"""What a component is: its ports, its parameters, how often it computes."""

from __future__ import annotations

import keyword
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from .interface import Action, Interface, Operation, Verb
from .parameters import ParameterSet
from .qos import DEFAULT_QOS, QoS
from .statemachine import StateMachine

MAX_SECONDS = 1e6
"""The longest period and deadline; clocks and locks refuse larger numbers."""

TAKEN = frozenset(
    {
        *("on_deadline_missed", "on_liveliness_lost", "reads_caller"),
        *("_abc_impl", "_in_front", "_is_protocol", "_set_period", "_takes_any_params"),
    }
)
"""Attributes of every worker that look like a handler's name: interface, underscore, operation."""

WORKER = frozenset(
    {
        *("after", "caller", "component", "compute", "emergency", "finish", "initialize", "instance", "log"),
        *("middleware", "now", "params", "period", "random", "reads_caller", "restore", "sleep"),
        *("state", "statemachine", "stop", "timers"),
    }
)
"""Attributes of every worker that look like the name of an interface in lower case."""

HANDLER = frozenset({"caller", "instance", "reads_caller"})
"""Attributes of every handler of a named instance."""


@dataclass(frozen=True)
class Port:
    """One use of an interface. `number` is "" for its first use, then "1", "2", ..."""

    verb: Verb
    interface: Interface
    number: str = ""
    qos: QoS = DEFAULT_QOS
    concurrent: bool = False
    """Whether its handlers may run beside other code of the worker."""
    middleware: str | None = None
    proxy: type[Any] | None = field(default=None, compare=False, repr=False)
    """The generated class through which user code calls this port."""
    each: bool = False
    """Whether it is provided by named instances, which the component adds while it runs."""
    policies: tuple[tuple[str, str], ...] = ()
    """By the name of an action, what happens to a goal that arrives while another one is active; see `Policy`."""

    @cached_property
    def name(self) -> str:
        """The key of its settings: `laser1` for a proxy, `Laser1` for handlers."""
        return self.interface.short.lower() + self.number if self.verb.has_proxy else self.label

    @cached_property
    def label(self) -> str:
        """Its name in messages, and the prefix of its handlers: `Laser1`."""
        return self.interface.short + self.number

    @property
    def attribute(self) -> str:
        """Where the worker finds its proxy: `laser1_proxy`; or its named instances: `laser`."""
        if self.each:
            return free_name(self.interface.short.lower(), WORKER)
        return f"{self.name}_proxy"

    def handler(self, operation: str) -> str:
        """The method that handles an operation: `Laser1_getLaserData`; for a named instance: `getLaserData`."""
        return free_name(operation, HANDLER) if self.each else f"{self.label}_{operation}"


@dataclass(frozen=True)
class PeriodicTimer:
    """A timer that a component declares."""

    name: str
    period: float
    """Seconds from one call to the next."""

    @property
    def method(self) -> str:
        """The method that it calls: `timer_poll`."""
        return f"timer_{self.name}"


@dataclass(frozen=True)
class Component:
    """What a CDSL file says, resolved."""

    name: str
    ports: tuple[Port, ...] = ()
    params: ParameterSet | None = None
    period: float = 0.1
    """Seconds from one `compute` to the next."""
    description: str = ""
    machine: StateMachine | None = None
    window: str = ""
    """The class of its window, `QWidget` or `QMainWindow`, if its CDSL has a `gui`."""
    timers: tuple[PeriodicTimer, ...] = ()

    @property
    def named(self) -> tuple[Port, ...]:
        """The ports that named instances provide."""
        return tuple(port for port in self.ports if port.each)

    @property
    def topics(self) -> list[str]:
        """The labels of its publication ports."""
        return [port.label for port in self.ports if port.verb.is_topic]

    def handlers(self) -> list[tuple[Port, Operation[Any]]]:
        """The operations that call the worker, each with its port. Those of named instances call other objects."""
        ports = [port for port in self.ports if not port.verb.has_proxy and not port.each]
        return [(port, operation) for port in ports for operation, _ in port.interface.under(port.verb)]

    def actions(self) -> list[tuple[Port, Action]]:
        """The actions whose goals the worker executes, each with its port."""
        return [(port, each) for port in self.ports if port.verb is Verb.IMPLEMENTS for each in port.interface.actions]

    @property
    def has_actions(self) -> bool:
        """Whether a port has actions, of its own or of others."""
        return any(port.interface.actions_under(port.verb) for port in self.ports)

    def fingerprints(self) -> dict[str, str]:
        """The fingerprints of all its operations, as 16 hexadecimal digits, by qualified name
        (`RoboCompLaser::Laser.getLaserData`)."""
        return {
            f"{operation.interface}.{operation.name}": f"{operation.fingerprint:016x}"
            for port in self.ports
            for operation in port.interface.contracts(port.verb)
        }

    def segment(self, port: Port) -> str:
        """The name of a port in the names of its channels: `Laser`, `Laser1`, ...

        Ports are counted per verb, so the name does not depend on other uses of the same interface or
        on their order.
        """
        short = port.interface.short
        same = [each for each in self.ports if each.verb is port.verb and each.interface.short == short]
        before = same.index(port) if port in same else 0
        return f"{short}{before}" if before else short


def free_name(name: str, taken: Collection[str]) -> str:
    """A name for Python: with an underscore appended if it is a keyword or taken, so that different names stay so."""
    bare = name.rstrip("_")
    return f"{name}_" if keyword.iskeyword(bare) or bare in taken else name


def numbers(uses: Iterable[tuple[Verb, str]]) -> list[str]:
    """Number the uses of each interface: "" for the first, then "1", "2", ...

    Proxies (requires, publishes) are numbered together, and so are handlers (implements,
    subscribesTo), because they share attribute and method names. See `Component.segment` for others.
    """
    seen: Counter[tuple[bool, str]] = Counter()
    result = []
    for verb, interface in uses:
        key = (verb.has_proxy, interface.lower() if verb.has_proxy else interface)
        result.append(str(seen[key]) if seen[key] else "")
        seen[key] += 1
    return result
