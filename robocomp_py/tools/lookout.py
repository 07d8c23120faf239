"""Looks at a running network again and again."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..errors import ConfigurationError
from ..garbage import no_collection
from ..runtime.RoboCompIntrospection import Description, Measures
from . import asking
from .access import Access
from .census import Seen
from .drift import Drift, compare, observed
from .flows import Flow, Told, flows, without_subscriber
from .measure import Load, load
from .network import TOOL, Network

_PATIENCE = 1.0
"""Seconds that a component has for an answer, so that one that is stopped does not delay a look for long."""


@dataclass(frozen=True)
class Look:
    """What one look found."""

    drift: Drift
    told: Mapping[str, Told]
    """By the whole name of a component."""
    silent: frozenset[str]
    """The whole names of components that did not answer."""
    flows: Mapping[Any, Flow] = field(default_factory=dict)
    plan: Mapping[str, Any] | None = None
    troubles: tuple[str, ...] = ()
    """What could not be looked at, and why."""
    at: float = 0.0
    """When, in seconds since 1970."""


class Lookout:
    """Rates are those between two looks; at the first, they are averages since the start of each component.

    `plan` tells what the network declares, as `Plan.to_json`; None if that is not known. `see` tells what runs, such as
    `census.take_each`. Both may raise RobocompError. For one thread.
    """

    def __init__(
        self,
        access: Access,
        plan: Callable[[], Mapping[str, Any] | None],
        see: Callable[[], Seen],
        *,
        except_pid: int = 0,
    ) -> None:
        self._plan, self._see, self._except = plan, see, except_pid
        self._rounds = Rounds(access)

    def look(self) -> Look:
        """Takes about a second if a component does not answer. Raises RobocompError."""
        with no_collection():  # with hundreds of components, collecting would take a third of the time
            return self._look()

    def _look(self) -> Look:
        plan = self._plan()
        seen = self._see()
        network = Network([each for each in seen.ends if (each.told.owner, each.told.pid) != (TOOL, self._except)])
        try:
            drift = compare(plan, network, seen.tellers) if plan is not None else observed(network)
        except ValueError as exc:
            raise ConfigurationError(f"{exc}; start the network again") from exc
        names = asking.components(network)
        told = self._rounds.ask(network, names, _PATIENCE)
        drift = without_subscriber(drift, told)
        silent = frozenset(names) - set(told)
        return Look(drift, told, silent, flows(drift, told), plan, tuple(seen.troubles), time.time())


_ASKED = "describe", "measure"
"""What a new component is asked."""


class Rounds:
    """Asks components what they have counted, again and again. For one thread."""

    def __init__(self, access: Access) -> None:
        self._access = access
        self._measured: dict[str, Measures] = {}
        self._loads: dict[str, Load] = {}
        self._abouts: dict[str, Description | None] = {}
        self._silent: dict[str, None] = {}
        """Those that did not answer, beginning with the one that was asked first."""

    def ask(self, network: Network, names: Sequence[str], patience: float) -> dict[str, Told]:
        """What those of these components that answer tell, by their whole names in order, and what they told before.

        Each has `patience` seconds. Of those that did not answer the last time, only some are asked in each round, so
        that many that are stopped do not delay it for longer than that.
        """
        retried = [name for name in self._silent if name in names][: asking.AT_ONCE]
        asked = [*(name for name in names if name not in self._silent), *retried]
        asking.prepare(self._access, network, (name for name in asked if name not in self._measured), *_ASKED)
        now = asking.measure_all(self._access, network, asked, patience)
        again = {name: None for name in self._silent if name in names and name not in retried}
        self._silent = again | {name: None for name in asked if name not in now}
        before, loads = self._measured, self._loads
        for name in now:
            if name not in before or now[name].awake < before[name].awake or not self._abouts.get(name):
                self._abouts[name] = asking.describe(self._access, network, name, patience)
        self._measured = now
        self._loads = {
            name: load(name, measures, before.get(name), self._abouts[name]) for name, measures in sorted(now.items())
        }
        self._abouts = {name: about for name, about in self._abouts.items() if name in now}
        return {name: Told(each, loads.get(name), self._abouts[name]) for name, each in self._loads.items()}


def seen_twice(lookout: Lookout) -> Look:
    """Look twice, and return the second look: its rates are those of the second between."""
    lookout.look()
    time.sleep(1.0)
    return lookout.look()
