"""Answers `Introspection`. Imported with the first call."""

from __future__ import annotations

import logging
import os
import platform
import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ..contract.component import Component, Port
from ..contract.interface import Operation, Verb
from ..contract.parameters import ParameterKind, dotted, flat
from ..contract.types import ExceptionType, Struct, walk
from ..errors import ConfigurationError
from ..spelling import unknown
from ..version import __version__
from ..wire import names
from .effective import toml
from .RoboCompIntrospection import Comment, Description, End, Measure, Measures, Setting
from .settings import LOG_LEVELS
from .tally import Tally

if TYPE_CHECKING:
    from .commonbehavior import CommonBehavior
    from .lifecycle import State
    from .monitor import Monitor
    from .settings import Settings
    from .telling import Telling
    from .worker import Worker

_MOST_LOGGERS = 64
"""Maximum number of loggers whose level may be set."""


class Describable(Protocol):
    """A component, as far as it is told of; see `run.Running`."""

    component: Component
    settings: Settings
    worker: Worker[Any]
    monitor: Monitor
    state: State
    started: int
    """When it was made, in ns since 1970."""
    begun: float
    """The same on the monotonic clock, in seconds."""

    @property
    def clock_name(self) -> str: ...

    @property
    def computes(self) -> int: ...

    @property
    def all_overruns(self) -> int: ...

    def publish(self, port: Port) -> tuple[Any, Callable[[], None]]: ...


class Describing:
    """What one component answers. Safe to use from any thread."""

    def __init__(self, running: Describable, behavior: CommonBehavior) -> None:
        self._running, self._behavior = running, behavior
        self._levels: dict[str, int] = {}
        """The levels of loggers before they were set."""
        self._setting = threading.Lock()
        self._telling: Telling | None = None

    def description(self) -> Description:
        running, settings = self._running, self._running.settings
        return Description(
            instance=names.whole(settings.instance, settings.namespace)[1:],
            component=running.component.name,
            host=platform.node(),
            pid=os.getpid(),
            version=__version__,
            started=running.started,
            clock=running.clock_name,
            ends=[_end(each) for each in running.monitor.tallies.every],
            settings=list(self._settings()),
        )

    def measures(self) -> Measures:
        running = self._running
        queued, suspended = running.monitor.load
        return Measures(
            at=time.time_ns(),
            awake=time.monotonic() - running.begun,
            state=str(running.state),
            period=running.worker.period,
            computes=running.computes,
            overruns=running.all_overruns,
            queued=queued,
            suspended=suspended,
            revision=self._behavior.revision,
            processor=time.process_time(),
            memory=_memory(),
            operations=[_measure(each) for each in running.monitor.tallies.every],
        )

    def set_log_level(self, logger: str, level: str) -> None:
        if level.lower() not in LOG_LEVELS:
            raise ConfigurationError(unknown("level", level, LOG_LEVELS))
        with self._setting:
            if logger not in self._levels and len(self._levels) >= _MOST_LOGGERS:
                raise ConfigurationError(f"the levels of {_MOST_LOGGERS} loggers are set already")
            found = logging.getLogger(logger or None)
            self._levels.setdefault(logger, found.level)
            found.setLevel(level.upper())

    def watch(self, calls: bool, logs: bool, lease: float) -> None:
        from .telling import Telling  # with the first lease

        running, settings = self._running, self._running.settings
        with self._setting:
            self._telling = self._telling or Telling(
                running.publish, running.monitor.tallies, settings.instance, settings.namespace
            )
        self._telling.watch(calls, logs, lease)

    def close(self) -> None:
        with self._setting:
            telling = self._telling
        if telling:
            telling.close()
        with self._setting:
            while self._levels:
                logger, level = self._levels.popitem()
                logging.getLogger(logger or None).setLevel(level)

    def _settings(self) -> Iterator[Setting]:
        spec = self._running.component.params
        for key, parameter, value in flat(spec, self._behavior.params) if spec else ():
            yield Setting(
                name=dotted(key),
                type="float" if parameter.kind is ParameterKind.DOUBLE else str(parameter.kind),
                value=_text(value),
                initial="" if parameter.mandatory else _text(parameter.default),
                minimum=_limit(parameter.minimum),
                maximum=_limit(parameter.maximum),
                choices=list(parameter.choices),
                comment=parameter.description,
                editable=parameter.dynamic,
            )


def comments(operation: Operation[object]) -> Iterator[Comment]:
    """The comments of an operation, its parameters, and the types under them, as far as they are known."""
    found = [("", operation.doc)]
    fields = (*operation.inputs, *operation.outputs)
    found += ((each.name, each.doc) for each in fields)
    for kind in (*operation.raises, *walk(*(each.type for each in fields))):
        name = kind.name.rpartition("::")[2]
        found.append((name, kind.doc))
        if isinstance(kind, Struct | ExceptionType):
            found += ((f"{name}.{each.name}", each.doc) for each in kind.fields)
    return (Comment(about, text) for about, text in found if text)


def _end(tally: Tally) -> End:
    operation, route, verb = tally.operation, tally.route, tally.port.verb
    return End(
        port=tally.label,
        verb=str(verb),
        operation=operation.name,
        channel=route.channel,
        middleware=route.middleware,
        pattern=str(tally.pattern),
        definition=operation.text,
        qos=toml(route.qos) if verb.is_topic else "",
        deadline=route.deadline if verb is Verb.REQUIRES else 0.0,
        idempotent=operation.idempotent,
        confirm=operation.confirm,
        comments=list(comments(operation)),
    )


def _measure(tally: Tally) -> Measure:
    tally.time_next()
    stats = tally.link.stats if tally.link else None
    made = Measure(
        port=tally.label,
        verb=str(tally.port.verb),
        operation=tally.operation.name,
        channel=tally.route.channel,
        middleware=tally.route.middleware,
        count=tally.count,
        failed=tally.failed,
        timed=tally.timed,
        latest=np.array(tally.latest, np.float32),
        waited=np.array(tally.waited, np.float32),
    )
    if stats:
        made.received, made.malformed, made.mismatched = stats.received, stats.malformed, stats.mismatched
        made.expired, made.repeated, made.lost, made.dropped = stats.expired, stats.repeated, stats.lost, stats.dropped
    return made


def _text(value: object) -> str:
    """A value as `CommonBehavior` writes it."""
    return str(value)


def _limit(limit: float | None) -> str:
    return "" if limit is None else _text(limit)


def _memory() -> int:
    """Octets of this process that are in memory; 0 if the system does not tell."""
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return 0
