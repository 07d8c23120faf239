"""`rc logs`: what running components have logged."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import queue
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import date
from functools import partial
from typing import TYPE_CHECKING, Self

from .common import FINE, raise_if_signalled, raise_if_unread
from .completing import What, completed
from .hosts import HERE, add_host
from .live import (
    EXIT_STATUS,
    Absent,
    add_json,
    add_middleware,
    add_waiting,
    awaited,
    components_named,
    count,
    positive,
    reported,
    say,
)
from .logged import Wanted, add_filters, wanted

if TYPE_CHECKING:
    from ..deploy.client import Connection
    from ..deploy.ring import Line
    from ..deploy.snapshot import ProcessStatus
    from ..tools.logs import Entry
    from ..tools.network import Network
    from ..tools.tap import Tap

NAME = "logs"

_EXAMPLES = f"""\
examples:
  rc logs                                    the last log records of all components
  rc logs wander --level warning --since 5m  warnings and errors of the last five minutes
  rc logs -f --grep 'lost|late'              new ones as they come, with one of these words
  rc logs --network rescue --host base       only of this network, and of what runs on this host of it
  rc logs --json                             an object a line: time, level, component, text, file, trace and more

Past records are there of components that rcdeploy runs, also on other hosts; other components keep none, so of them
--follow shows what they log from then on. `rcdeploy logs` also shows what was printed, and networks that have ended.
A name may be a whole one, as robot1/wander, or its last part.

{EXIT_STATUS}
"""

_LOOK = 0.1
"""Seconds between two looks at the clock, at signals, and at what else has come."""

_WAITING = 1000
"""Records of launched networks that may wait to be printed."""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Show the log records of running components, in the order of their times."
    to.epilog = _EXAMPLES
    about = "robot1/wander, or its last part (default: all)"
    completed(to.add_argument("components", nargs="*", metavar="COMPONENT", help=about), What.COMPONENT)
    to.add_argument("-f", "--follow", action="store_true", help="also print new records as they come, until Ctrl-C")
    add_filters(to)
    to.add_argument("-n", "--lines", type=count, default=100, metavar="N", help="how many past records (default: 100)")
    to.add_argument(
        "--for", dest="seconds", type=positive, metavar="SECONDS", help="with --follow: end after this time"
    )
    about = "only components of a network that rcdeploy runs here, by its name or file (default: all that run here)"
    completed(to.add_argument("--network", metavar="NET", help=about), What.NETWORK)
    add_host(to)
    add_waiting(to)
    add_middleware(to)
    add_json(to)


def run(options: argparse.Namespace) -> int:
    show = _show_as_json if options.json else _show
    accepts = wanted(options)
    with reported("rc logs") as code:
        chosen = awaited(options, partial(_chosen, options))
        for each in chosen.troubles:
            say("rc logs", each)
        seen: set[Line] = set()
        since = time.time()
        past = [(line, entry) for each in chosen.launched for line, entry in each.past(accepts, options.lines)]
        for line, entry in sorted(past, key=lambda found: found[0].at)[-options.lines :]:
            show(entry)
            seen.add(line)
            raise_if_signalled()
        if options.follow:
            return _follow(options, chosen, _Live(chosen.launched, since, seen), accepts, show)
        if chosen.others:
            names = ", ".join(chosen.others)
            text = f"rcdeploy does not run {names}, so no past records are kept; --follow shows new ones"
            if not chosen.launched:
                raise Absent(text)
            print(f"rc logs: {text}", file=sys.stderr)
        return FINE
    return code()


@dataclass(frozen=True)
class _Launched:
    """The components of a network that rcdeploy runs."""

    network: str
    processes: Mapping[str, tuple[str, ...]]
    """All instances of each process, by its name; processes without a wanted one are left out."""
    wanted: Collection[str]

    def past(self, accepts: Wanted, most: int) -> list[tuple[Line, Entry]]:
        from ..deploy.client import Connection, chosen_lines

        def is_wanted(line: Line) -> bool:
            return accepts(line.at, line.level, line.message) and self.entry(line) is not None

        with Connection(self.network) as connection:
            found = chosen_lines(connection, self.processes, most, is_wanted, follow=False)
            return [(line, entry) for line in found if (entry := self.entry(line))]

    def entry(self, line: Line) -> Entry | None:
        """None if it is no log record of one of the wanted components."""
        from ..runtime.records import Record
        from ..tools.logs import Entry

        every = self.processes.get(line.name)
        if not every or not line.level:
            return None
        record = line.record or Record(line.at, line.level, "", "", "", "", 0, line.message)
        named = record.instance.rpartition("/")[2]
        alone = every[0] if len(every) == 1 else ""
        component = next((each for each in every if each.rpartition("/")[2] == named), alone)
        if component and component not in self.wanted:
            return None
        return Entry(component or line.name, record)


@dataclass(frozen=True)
class _Chosen:
    launched: Sequence[_Launched]
    others: Sequence[str]
    """The whole names of the components that rcdeploy does not run."""
    troubles: Sequence[str]
    """Why a network could not be asked."""


def _chosen(options: argparse.Namespace, network: Network) -> _Chosen:
    """The components that are meant. Raises ValueError if one is not there, and DeploymentError."""
    from ..deploy.client import Connection, NotRunning, network_of, networks, not_running
    from ..errors import DeploymentError
    from ..tools import asking
    from ..tools.hosts import check_hosts

    running, hosts = networks(), {"" if each == HERE else each for each in options.hosts}
    if options.network:
        name = network_of(options.network)
        if name not in running:
            raise NotRunning(not_running(name))
        running = [name]
    launched: dict[str, Sequence[ProcessStatus]] = {}
    troubles = []
    for each in running:
        try:
            with Connection(each) as connection:
                launched[each] = connection.status().processes
        except NotRunning:
            continue  # it has just ended
        except DeploymentError as exc:
            troubles.append(str(exc))
    every = [one for processes in launched.values() for one in processes]
    check_hosts(hosts - {""}, {one.host for one in every} - {""})
    there = [name for one in every if not hosts or one.host in hosts for name in one.instances]
    deployed = {name for one in every for name in one.instances}
    alone = [] if options.network or (hosts and "" not in hosts) else asking.components(network)
    known = list(dict.fromkeys([*there, *(each for each in alone if each not in deployed)]))
    try:
        found = components_named(known, options.components)
    except Absent as exc:
        raise ValueError("; ".join([str(exc), *troubles])) from exc
    if not found:
        raise ValueError("; ".join(["no component runs here", *troubles]))
    return _Chosen(
        [made for each, told in launched.items() if (made := _wanted_of(each, told, found)).processes],
        [name for name in found if name not in there],
        troubles,
    )


def _wanted_of(network: str, processes: Iterable[ProcessStatus], names: Collection[str]) -> _Launched:
    meant = {each.name: each.instances for each in processes if not set(each.instances).isdisjoint(names)}
    return _Launched(network, meant, names)


# New records.


def _follow(
    options: argparse.Namespace, chosen: _Chosen, live: _Live, accepts: Wanted, show: Callable[[Entry], None]
) -> int:
    from ..tools.logs import entry_of

    end = time.monotonic() + (options.seconds or math.inf)
    with ExitStack() as stack:
        tap = _told(options, chosen, stack) if chosen.others else None
        stack.enter_context(live)
        while time.monotonic() < end and (tap or live.goes_on):
            message = tap.take(_LOOK) if tap else None
            if message:
                entry, dropped = entry_of(message.channel.rsplit("/", 2)[0], message.message)
                _tell_dropped(message.dropped + dropped)
                if entry and accepts(entry.record.time, entry.record.level, entry.record.text):
                    show(entry)
            for launched, line in live.taken(0.0 if tap else _LOOK):
                if not line.name:
                    say("rc logs", line.text)
                elif accepts(line.at, line.level, line.message) and (entry := launched.entry(line)):
                    show(entry)
            raise_if_signalled()
            raise_if_unread()
    return FINE


def _told(options: argparse.Namespace, chosen: _Chosen, stack: ExitStack) -> Tap | None:
    """What components tell themselves. Raises Absent if they do not, and nothing else is followed."""
    from ..tools import leases
    from ..tools.access import Access
    from ..tools.census import take_census
    from ..tools.tap import tap

    census = partial(take_census, options.middleware, own=True)
    access = stack.enter_context(Access())
    told = stack.enter_context(leases.told(access, census, chosen.others, "logged", options.timeout))
    refused = [f"{name} does not tell what it logs: {why}" for name, why in told.silent.items()]
    if not told.topics and not chosen.launched:
        raise Absent("; ".join(refused))
    for each in refused:
        say("rc logs", each)
    return stack.enter_context(tap(told.topics)) if told.topics else None


def _tell_dropped(number: int) -> None:
    if number:
        print(f"rc logs: {number} records were dropped: they come faster than they are printed", file=sys.stderr)


class _Live:
    """New lines of networks that rcdeploy runs. A thread for each waits for them."""

    def __init__(self, launched: Iterable[_Launched], since: float, seen: Collection[Line]) -> None:
        """New are lines that came after a time, except for those that have been `seen`."""
        self._launched, self._since, self._seen = launched, since, seen
        self._lines: queue.Queue[tuple[_Launched, Line]] = queue.Queue(_WAITING)
        self._is_over = False
        self._error: Exception | None = None
        self._followed: list[tuple[Connection, threading.Thread]] = []

    def __enter__(self) -> Self:
        from ..deploy.client import Connection
        from ..errors import DeploymentError
        from ..threads import NO_THREAD, start_thread

        try:
            for each in self._launched:
                connection = Connection(each.network)
                thread = threading.Thread(target=self._follow, args=(each, connection), name=f"logs-{each.network}")
                self._followed.append((connection, thread))
                if not start_thread(thread):
                    raise DeploymentError(NO_THREAD)
        except BaseException:  # Ctrl-C, too: threads that follow a network must not outlive the command
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over = True
        for connection, thread in self._followed:
            connection.end()
            if thread.ident:
                thread.join()
            connection.close()

    @property
    def goes_on(self) -> bool:
        """Whether a network is still there, or a line left."""
        return any(thread.is_alive() for _, thread in self._followed) or not self._lines.empty()

    def taken(self, timeout: float) -> Iterator[tuple[_Launched, Line]]:
        """Those that have come; waits at most `timeout` seconds for the first."""
        if self._error:
            raise self._error
        with contextlib.suppress(queue.Empty):
            yield self._lines.get(timeout=timeout) if timeout else self._lines.get_nowait()
            while True:
                yield self._lines.get_nowait()

    def _follow(self, launched: _Launched, connection: Connection) -> None:
        from ..deploy.client import chosen_lines
        from ..errors import DeploymentError

        def is_new(line: Line) -> bool:
            return line.at >= self._since and line not in self._seen

        try:
            for line in chosen_lines(connection, launched.processes, _WAITING, is_new, follow=True):
                self._put(launched, line)
        except DeploymentError as exc:
            self._error = exc

    def _put(self, launched: _Launched, line: Line) -> None:
        while not self._is_over:
            with contextlib.suppress(queue.Full):
                self._lines.put((launched, line), timeout=_LOOK)
                return


# Output.


def _show_as_json(entry: Entry) -> None:
    print(json.dumps(entry.told), flush=True)


def _show(entry: Entry) -> None:
    from ..deploy.harmless import plain
    from ..deploy.table import clock_time, full_time

    record = entry.record
    at = clock_time(record.time) if _is_today(record.time) else full_time(record.time)
    first, *more = plain(record.text).split("\n")
    trace = f" (trace {plain(record.trace)})" if record.trace else ""
    print(f"{at} {record.level} {plain(entry.component)}: {first}{trace}", *(f"    {each}" for each in more), sep="\n")
    sys.stdout.flush()


def _is_today(at: float) -> bool:
    return date.fromtimestamp(at) == date.today()
