"""Checks the tables of a configuration against its component."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

from .. import installed
from ..contract.component import MAX_SECONDS, Component, Port
from ..contract.interface import Verb
from ..contract.parameters import Complaint, Key, ParameterSet
from ..contract.parameters import check as check_parameters
from ..contract.qos import DEFAULT_QOS, DEPTHS, PRESETS, TIMES, WORDS, QoS
from ..spelling import unknown
from ..wire import names
from .checked import STARTUP_TIMEOUT, ClockSettings, PortSettings, Settings, Way
from .keys import CLOCK_KEYS, COMPONENT_KEYS, KEYS, PORT_KEYS

LOG_LEVELS = ("debug", "info", "warning", "error")


class Checker:
    """Reads tables, and collects complaints instead of stopping."""

    def __init__(self, component: Component) -> None:
        self._component = component
        self.complaints: list[Complaint] = []

    def settings(self, data: Mapping[str, Any], instance: str) -> Settings:
        self._known(data, (), KEYS)
        own = self._table(data, "component", ())
        self._known(own, ("component",), COMPONENT_KEYS)
        params, wrong = check_parameters(
            self._component.params or ParameterSet(self._component.name), self._table(data, "params", ())
        )
        if isinstance(data.get("params", {}), Mapping):  # otherwise the table as a whole has been reported
            self.complaints += [Complaint(("params", *c.key), c.message, c.code) for c in wrong]
        namespace = self._text(data, "namespace", ()) or ""
        if not names.is_namespace(namespace):
            message = f"{namespace!r} is not a namespace; allowed: letters, digits, `_`, `-`, and `/` between parts"
            self._complain("config-bad-name", ("namespace",), message)
        if not names.is_segment(instance):
            message = f"{instance!r} is not a name for an instance; allowed: letters, digits, `_`, `-`"
            self._complain("config-bad-name", (), message)
        transports = self._table(data, "transports", ())
        self._known(transports, ("transports",), installed.transports())
        tables = {name: self._table(transports, name, ("transports",)) for name in transports}
        for name, options in tables.items():
            self._check_options(name, options)
        return Settings(
            instance=instance,
            namespace=namespace.strip("/"),
            middleware=self._text(data, "middleware", ()),
            period=self._seconds(own, "period", ("component",)) or self._component.period,
            log=self._choice(own, "log", ("component",), LOG_LEVELS) or "info",
            startup_timeout=self._seconds(own, "startup_timeout", ("component",)) or STARTUP_TIMEOUT,
            watchdog=0.0 if own.get("watchdog") == 0 else self._seconds(own, "watchdog", ("component",)),
            diary=self._text(own, "diary", ("component",)) or "",
            timers=self._timers(self._table(data, "timers", ())),
            clock=self._clock(self._table(data, "clock", ())) if "clock" in data else None,
            params=params,
            ports=self._ports(self._table(data, "ports", ()), {port.name: port for port in self._component.ports}),
            offers=self._offers(self._table(data, "offers", ())) if "offers" in data else None,
            transports=tables,
        )

    def _offers(self, data: Mapping[str, Any]) -> dict[str, dict[tuple[str, ...], PortSettings]]:
        known = {port.name: port for port in self._component.named}
        found = {}
        for name in data:
            if not names.is_segment(name):
                message = f"{name!r} is not a name for an instance; allowed: letters, digits, `_`, `-`"
                self._complain("config-bad-name", ("offers", name), message)
            found[name] = self._ports(self._table(data, name, ("offers",)), known, ("offers", name))
        return found

    def _timers(self, data: Mapping[str, Any]) -> dict[str, float]:
        declared = {each.name: each.period for each in self._component.timers}
        for name in data:
            if name not in declared:
                self._complain("config-unknown-key", ("timers", name), unknown("timer", name, declared))
        return {name: self._seconds(data, name, ("timers",)) or period for name, period in declared.items()}

    def _clock(self, data: Mapping[str, Any]) -> ClockSettings | None:
        at = ("clock",)
        self._known(data, at, CLOCK_KEYS)
        followers = data.get("followers", [])
        if not isinstance(followers, list) or not all(isinstance(each, str) for each in followers):
            message = f'`followers` must be a list of instances, as in ["camera"], not {followers!r}'
            self._complain("config-wrong-type", (*at, "followers"), message)
            followers = []
        every = [(self._text(data, "leader", at), "leader"), *((each, "followers") for each in followers)]
        for name, key in every:
            if name and not names.is_namespace(name):
                message = f"{name!r} names no instance; write `instance` or `/namespace/instance`"
                self._complain("config-bad-name", (*at, key), message)
        speed = 0.0 if data.get("speed") == 0 else self._seconds(data, "speed", at) or ClockSettings.speed
        lost = self._choice(data, "lost", at, ("keep", "stop")) or ClockSettings.lost
        leader = every[0][0]
        if not leader:
            self._complain("config-missing", at, "`clock` lacks its `leader`, the instance whose clock is followed")
            return None
        mode = self._choice(data, "mode", at, ("lockstep", "free")) or ClockSettings.mode
        if mode == "free" and not speed:
            message = "`speed` is 0, as fast as possible, which a clock can only be in lock-step"
            self._complain("config-out-of-range", (*at, "speed"), message)
        return ClockSettings(leader, tuple(followers), speed, lost, mode)

    def _ports(
        self, data: Mapping[str, Any], known: Mapping[str, Port], at: Key = ("ports",)
    ) -> dict[tuple[str, ...], PortSettings]:
        found: dict[tuple[str, ...], PortSettings] = {}
        for name in data:
            if name not in known:
                self._complain("config-unknown-key", (*at, name), unknown("port", name, known))
                continue
            table = self._table(data, name, at)
            operations = known[name].interface.called(known[name].verb)
            found[(name,)] = self._port(known[name], table, (*at, name), operations)
            for operation in operations:
                if operation in table and operation not in PORT_KEYS:
                    inner = self._table(table, operation, (*at, name))
                    found[(name, operation)] = self._port(known[name], inner, (*at, name, operation), ())
        return found

    def _port(self, port: Port, table: Mapping[str, Any], at: Key, operations: Iterable[str]) -> PortSettings:
        self._known(table, at, (*PORT_KEYS, *operations))
        return PortSettings(
            middleware=self._text(table, "middleware", at),
            source=self._source(table, at),
            also=self._ways(port, table, at),
            deadline=self._seconds(table, "deadline", at),
            qos=self._qos(table["qos"], (*at, "qos")) if "qos" in table else None,
        )

    def _source(self, table: Mapping[str, Any], at: Key) -> str | None:
        source = self._text(table, "from", at)
        try:
            names.resolve(source or "", "", "X")
        except ValueError as exc:
            self._complain("config-bad-name", (*at, "from"), str(exc))
        return source

    def _ways(self, port: Port, table: Mapping[str, Any], at: Key) -> tuple[Way, ...] | None:
        if "also" not in table:
            return None
        given, key = table["also"], (*at, "also")
        if port.verb is Verb.REQUIRES:
            message = "`also` has no meaning for a required interface, which has one server"
            self._complain("config-unknown-key", key, message)
            return None
        if not isinstance(given, list):
            message = f'`also` must be a list of middlewares, as in ["shm"], not {given!r}'
            self._complain("config-wrong-type", key, message)
            return None
        return tuple(self._way(port, each, (*key, number)) for number, each in enumerate(given))

    def _way(self, port: Port, given: Any, at: Key) -> Way:
        if isinstance(given, str):
            return Way(given)
        if not isinstance(given, Mapping):
            self._complain("config-wrong-type", at, f"an item must be a middleware or a table, not {given!r}")
            return Way()
        self._known(given, at, ("middleware", "from") if port.verb is Verb.SUBSCRIBES else ("middleware",))
        return Way(self._text(given, "middleware", at), self._source(given, at))

    def _qos(self, given: Any, at: Key) -> QoS | None:
        if isinstance(given, str):
            if given not in PRESETS:
                self._complain("config-unknown-value", at, unknown("QoS preset", given, PRESETS))
            return PRESETS.get(given)
        if not isinstance(given, Mapping):
            self._complain("config-wrong-type", at, f"`qos` must be a table or the name of a preset, not {given!r}")
            return None
        self._known(given, at, [f.name for f in fields(QoS)])
        values: dict[str, Any] = {}
        for name, kind in WORDS.items():
            if word := self._choice(given, name, at, [str(member) for member in kind]):
                values[name] = kind(word)
        for name in TIMES:
            if name in given:
                values[name] = self._seconds(given, name, at)
        depth = given.get("depth", DEFAULT_QOS.depth)
        if not isinstance(depth, int) or isinstance(depth, bool) or depth not in DEPTHS:
            message = f"`depth` is {depth!r}; allowed: {DEPTHS[0]} to {DEPTHS[-1]}"
            self._complain("config-out-of-range", (*at, "depth"), message)
        else:
            values["depth"] = depth
        return QoS(**values)

    def _check_options(self, name: str, options: Mapping[str, Any]) -> None:
        from ..transports.deployment import deployment_of  # only a component with such a table needs it

        for each in deployment_of(name).examine(options):
            self._complain(each.code, ("transports", name, *each.key), each.message)

    def _table(self, data: Mapping[str, Any], name: str, at: Key) -> Mapping[str, Any]:
        value = data.get(name, {})
        if isinstance(value, Mapping):
            return value
        self._complain("config-wrong-type", (*at, name), f"`{name}` must be a table, not {value!r}")
        return {}

    def _text(self, data: Mapping[str, Any], name: str, at: Key) -> str | None:
        value = data.get(name)
        if value is None or isinstance(value, str):
            return value
        self._complain("config-wrong-type", (*at, name), f"`{name}` must be a string, not {value!r}")
        return None

    def _seconds(self, data: Mapping[str, Any], name: str, at: Key) -> float | None:
        value = data.get(name)
        if value is None:
            return None
        if isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= MAX_SECONDS:
            return float(value)
        allowed = f"a positive number of seconds, at most {MAX_SECONDS:g}"
        self._complain("config-out-of-range", (*at, name), f"`{name}` is {value!r}; allowed: {allowed}")
        return None

    def _choice(self, data: Mapping[str, Any], name: str, at: Key, allowed: Sequence[str]) -> str | None:
        value = data.get(name)
        if value is None or value in allowed:
            return value
        self._complain("config-unknown-value", (*at, name), f"`{name}`: {unknown('value', str(value), allowed)}")
        return None

    def _known(self, data: Mapping[str, Any], at: Key, allowed: Iterable[str]) -> None:
        for name in data:
            if name not in allowed:
                self._complain("config-unknown-key", (*at, name), unknown("key", name, allowed))

    def _complain(self, code: str, key: Key, message: str) -> None:
        self.complaints.append(Complaint(key, message, code))
