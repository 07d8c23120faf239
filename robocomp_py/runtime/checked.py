"""A checked configuration of a component: values only."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ..contract.component import Port
from ..contract.middleware import carrier
from ..contract.qos import QoS
from .document import Document

DEADLINE = 5.0
"""Default of the longest duration of a call, in seconds."""

STARTUP_TIMEOUT = 60.0
"""Seconds that a starting component waits for required components, unless its configuration says otherwise."""


@dataclass(frozen=True)
class Way:
    """A further route of a port: another middleware or, for a subscription, another publisher. None: as the port."""

    middleware: str | None = None
    source: str | None = None


@dataclass(frozen=True)
class PortSettings:
    """The settings of a port or of one of its operations; None stands for the setting of the level above."""

    middleware: str | None = None
    source: str | None = None
    """`from` in the file: the instance whose channels are used."""
    deadline: float | None = None
    qos: QoS | None = None
    also: tuple[Way, ...] | None = None

    def under(self, above: PortSettings) -> PortSettings:
        """These settings, completed by those of the level above."""
        return PortSettings(
            above.middleware if self.middleware is None else self.middleware,
            above.source if self.source is None else self.source,
            above.deadline if self.deadline is None else self.deadline,
            above.qos if self.qos is None else self.qos,
            above.also if self.also is None else self.also,
        )


@dataclass(frozen=True)
class ClockSettings:
    """How a component follows the clock of another one, or leads."""

    leader: str
    followers: tuple[str, ...] = ()
    speed: float = 1.0
    """Of the clock's seconds in one second; 0 for as fast as possible."""
    lost: str = "keep"
    mode: str = "lockstep"
    """Or `free`: the clock passes by itself, and waits for no component."""


@dataclass(frozen=True)
class Settings:
    """A checked configuration."""

    instance: str
    namespace: str = ""
    middleware: str | None = None
    period: float = 0.1
    log: str = "info"
    startup_timeout: float = STARTUP_TIMEOUT
    watchdog: float | None = None
    """Seconds; 0 for no limit, None for the launcher's choice."""
    diary: str = ""
    """The file for its diary; "" for none."""
    timers: Mapping[str, float] = field(default_factory=dict)
    """Periods in seconds, of the timers that the component declares."""
    clock: ClockSettings | None = None
    """None for the machine's clock."""
    params: Mapping[str, Any] = field(default_factory=dict)
    ports: Mapping[tuple[str, ...], PortSettings] = field(default_factory=dict)
    """Keys are (port,) and (port, operation)."""
    offers: Mapping[str, Mapping[tuple[str, ...], PortSettings]] | None = None
    """The same for each named instance, of the ports that it provides; None if any name may be added."""
    transports: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    document: Document | None = field(default=None, compare=False, repr=False)
    """The document that these settings were read from."""
    _effective: dict[tuple[int, str, str], tuple[Port, PortSettings]] = field(
        default_factory=dict, init=False, compare=False, repr=False
    )
    """What `port` has returned. The plan of a large network asks for the same again and again."""

    def middlewares(self, port: Port, operation: str, generated_for: str) -> list[str]:
        """The middlewares of an operation of a port, the main one first."""
        chosen = self.port(port, operation)
        first = carrier(chosen.middleware, generated_for)
        return [first, *(carrier(way.middleware or first, generated_for) for way in chosen.also or ())]

    def port(self, port: Port, operation: str, instance: str = "") -> PortSettings:
        """The effective settings of one operation of a port, or of a named instance of it."""
        key = id(port), operation, instance
        if key not in self._effective:
            self._effective[key] = port, self._port(port, operation, instance)  # the port is kept, and so is its id
        return self._effective[key][1]

    def _port(self, port: Port, operation: str, instance: str) -> PortSettings:
        base = PortSettings(port.middleware or self.middleware, "", DEADLINE, port.qos)
        offered = (self.offers or {}).get(instance, {})
        for table in (self.ports, offered) if offered else (self.ports,):
            for key in ((port.name,), (port.name, operation)):
                if key in table:
                    base = table[key].under(base)
        return base

    def of(self, instance: str) -> Settings:
        """The settings of a named instance, as those of a component that provides its ports by its own name."""
        ports = dict(self.ports)
        offered = (self.offers or {}).get(instance, {})
        for key, chosen in sorted(offered.items(), key=lambda each: len(each[0])):
            for each in {key, *(known for known in ports if known[: len(key)] == key)}:
                ports[each] = chosen.under(ports.get(each, PortSettings()))
        return replace(self, instance=instance, ports=ports, offers=None)

    def offered(self, port: Port) -> frozenset[str] | None:
        """The names of the instances that may provide a port; None if all may."""
        if self.offers is None:
            return None
        return frozenset(name for name, tables in self.offers.items() if (port.name,) in tables)

    def peer_of(self, port: Port) -> str:
        """The peer that a port uses, for messages: the configured proxy if there is one, else the instance."""
        source = self.port(port, "").source
        proxies = ChainMap(*(options.get("proxies", {}) for options in self.transports.values()))
        return str(proxies.get(source, source)) if source else "any instance"
