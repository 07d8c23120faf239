"""Runs a component: from its worker class and settings to its end."""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import inspect
import logging
import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from .. import __version__, installed
from ..arguments import Parser
from ..contract.component import MAX_SECONDS, Component, Port
from ..contract.interface import Operation, Verb
from ..contract.middleware import carrier
from ..contract.parameters import build
from ..contract.statemachine import label
from ..errors import (
    AlreadyServed,
    Closed,
    ComponentError,
    ConfigurationError,
    RobocompError,
    TransportError,
    Unreachable,
)
from ..threads import start_thread
from ..transports.base import (
    Link,
    Transport,
    TransportConfig,
    TransportFactory,
    find_transport,
    gathering,
    wait_connected,
)
from ..wire import names
from . import ports, settings
from .commonbehavior import CommonBehavior, port_of
from .ending import GRACE, STUCK, announced, end_after, grace_of, settle
from .introspection import Bound, Counts, life, status
from .lifecycle import Beat, Event, State, after
from .monitor import Monitor
from .notify import contract, notify
from .RoboCompCommonBehavior import Status
from .settings import Settings, Way
from .signals import Signals
from .statemachine import Machine, Trigger
from .tally import Tally
from .trace import user_trace
from .unsafe import write_out
from .watch import Lost, Missed
from .watchdog import Watchdog
from .watching import Watching
from .worker import Worker, check_methods

log = logging.getLogger("robocomp.worker")

_REMIND = 5.0
"""Seconds between messages that name the peer a component waits for."""

_SLOW = 10
"""Number of skipped periods after which a component is reported as too slow."""

_CONNECTING = 2.0
"""Seconds to wait for visible publishers and subscribers to connect; then the component starts without the rest."""

_MOST_LISTED = 8
"""Maximum number of keys without effect that the start lists; `rc lint` lists all."""


class Running:
    """One component of this process, from its start to its end.

    `run` is called once and returns when it has ended; the rest may be used from other threads.
    """

    def __init__(
        self,
        worker_class: type[Worker[Any]],
        settings: Settings,
        find: Callable[[str], TransportFactory] = find_transport,
        tell: Callable[[str], None] = notify,
    ) -> None:
        """`tell` sends status messages to the launcher of the process."""
        check_methods(worker_class)
        self._tell = tell
        self.component = worker_class.component
        self.settings = settings
        self.ready = threading.Event()
        self.state = State.STARTING
        self.computes = 0
        """How often `compute` was called."""
        self.overruns = 0
        """Number of periods skipped because a call took too long."""
        self._generated_for = worker_class.middleware
        self._wake = threading.Event()
        self._changing = threading.Lock()
        self.monitor = Monitor(f"worker-{settings.instance}")
        self._watching = Watching(settings.instance, self._call_qos_hook)
        self._tally = Tally(settings.namespace, settings.instance)
        self._transports = _Transports(settings, find, lambda: not self.is_over)
        self._links: list[Link] = []
        """Links of handlers."""
        self._proxied: list[Link] = []
        """Links of proxies."""
        self._bound: list[Bound] = []
        """The ports with their routes and links."""
        self._was_slow = False
        self._failed = False
        self._last_hindrance = ""
        self.doing = ""
        """The name of the hook that is running; "" if none is."""
        self._machine: Machine | None = None
        self.worker = self._build(worker_class)

    def run(self) -> bool:
        """Start, compute until stopped, finish, close. Returns False if the component failed."""
        self._tell_contract()
        try:
            self._connect()
            self._live()
        except (RobocompError, OSError) as exc:
            if not (self.is_over and isinstance(exc, Closed)):  # Closed: stopped while it waited for its middleware
                self._fail(str(exc))
        finally:
            self._tell("STOPPING=1")
            self.monitor.turn_away()
            self._watching.end()
            self._tally.write(self._bound)
            self._close_links()
            self._watching.close()
            self.monitor.close()
            self._transports.close()
            self.state = State.ENDED
        return not self._failed

    @property
    def is_up(self) -> bool:
        return self.ready.is_set() and self.state not in (State.FINISH, State.ENDED)

    @property
    def is_over(self) -> bool:
        return self.state is State.ENDED

    @property
    def life(self) -> str:
        """Its status, as one line for its launcher."""
        return life(self.settings.instance, self.state, self._counts, self._watching.all)

    @property
    def _counts(self) -> Counts:
        return Counts(self.computes, self.overruns)

    def _status(self) -> Status:
        name, component = self.settings.instance, self.component.name
        return status(name, component, self.state, self._counts, self._bound, self._watching.all)

    @property
    def is_running_here(self) -> bool:
        """Whether the calling thread runs code of its worker."""
        pool = rf"{re.escape(self.monitor.name)}(-concurrent)?_\d+"
        return self.monitor.is_inside or bool(re.fullmatch(pool, threading.current_thread().name))

    def stop(self) -> None:
        """Ask it to stop: after the current call, `finish` is called and everything is closed."""
        self.signal(Event.STOP)

    def signal(self, event: Event, during: State | None = None) -> None:
        """Apply an event to the life cycle; with `during`, only if the component is still in that state."""
        with self._changing:
            if during is None or self.state is during:
                self.state = after(self.state, event)
        self._wake.set()
        if self.state in (State.FINISH, State.ENDED):
            self.monitor.turn_away()

    # Starting.

    def _build(self, worker_class: type[Worker[Any]]) -> Worker[Any]:
        worker = worker_class.__new__(worker_class)
        spec = self.component.params
        worker._configured = build(spec, self.settings.params) if spec else None
        worker.log = logging.getLogger(self.settings.instance)
        worker._period = self.settings.period
        worker._signal = self.signal
        worker._state = lambda: self.state
        worker._set_period = self._set_period
        worker._wake = self._wake.set
        worker._suspended = self.monitor.suspended
        worker._settings = self.settings
        if self.component.machine:
            self._machine = Machine(self.component.machine, self._enter, self._wake.set)
            triggers = self.component.machine.triggers().items()
            found = {name: Trigger(self._machine, transition) for name, transition in triggers}
            vars(worker).update(found, statemachine=self._machine)
        self._beat = Beat(self.settings.period, time.monotonic())
        try:
            worker_class.__init__(worker)  # last, so that a user's __init__ can use all of the above
        except ComponentError:
            raise
        except Exception as exc:
            raise ComponentError(self._init_failed(exc)) from exc
        return worker

    def _init_failed(self, exc: Exception) -> str:
        name = exc.name if isinstance(exc, AttributeError) else ""
        early = name in {port.attribute for port in self.component.ports}
        hint = f"\nproxies exist from `initialize` on: move code that uses `{name}` there" if early else ""
        return f"{user_trace(exc)}{hint}"

    def _tell_contract(self) -> None:
        """Report the contracts of this component, so that the launcher can compare them with those of its peers."""
        if lines := list(contract(self.settings.instance, self.component.fingerprints())):
            self._tell("\n".join(lines))

    def _connect(self) -> None:
        with self._transports.gathering():
            required = self._bind_all()
        self._await(required)
        self._connect_topics()
        if self.state is State.STARTING:
            self.signal(Event.CONNECTED)

    def _bind_all(self) -> list[tuple[Port, Link]]:
        """Open all links. Returns those of required interfaces."""
        provided = [port for port in self.component.ports if port.verb.provides]
        wanted = [port for port in self.component.ports if not port.verb.provides]
        own = port_of(self.component)
        if own:
            machine = vars(self.worker).get("statemachine")
            handlers = CommonBehavior(self.worker, self.settings.params, self.monitor.held, self._status, machine)
            try:
                self._links += ports.bind_handlers(own, handlers, self._route, self.monitor, lazy=True)
            except AlreadyServed as exc:
                name = self.settings.instance
                raise AlreadyServed(
                    f"an instance `{name}` is already running; stop it, or give this one another name: with --name, "
                    f"or in the .ddsl of its network ({exc})"
                ) from exc
        required: list[tuple[Port, Link]] = []
        for port in (*provided, *wanted):
            links = self._bind(port)
            (self._proxied if port.verb.has_proxy else self._links).extend(links)
            if port.verb is Verb.REQUIRES:
                required += ((port, link) for link in links)
        return required

    def _close_links(self) -> None:
        try:
            with self._transports.gathering():
                ports.close_all(self._proxied)  # first, because it ends the calls that handlers and hooks wait for
                ports.close_all(self._links)
        except TransportError as exc:
            log.warning("%s", exc)  # closing the transport closes the remaining links

    def _bind(self, port: Port) -> list[Link]:
        routes: list[ports.Route] = []

        def route(port: Port, operation: Operation[Any]) -> ports.Route:
            routes.append(self._route(port, operation))
            return routes[-1]

        if port.verb.has_proxy:
            proxy, links = ports.bind_proxy(port, route, self.monitor, self._watching)
            self._tally.watch(port, proxy)
            setattr(self.worker, port.attribute, proxy)
        else:
            links = ports.bind_handlers(port, self.worker, route, self.monitor, self._watching)
        self._bound.append(Bound(port, routes, links))
        return links

    def _route(self, port: Port, operation: Operation[Any]) -> ports.Route:
        chosen = self.settings.port(port, operation.name)
        if port.verb.provides:
            where = (self.settings.namespace, self.settings.instance, self.component.segment(port))
        else:
            where = names.resolve(chosen.source or "", self.settings.namespace, port.interface.short)
        assert chosen.qos is not None
        assert chosen.deadline is not None
        middleware = self._carrier(chosen.middleware)
        route = ports.Route(
            self._transports[middleware],
            middleware,
            names.channel(*where, operation.name),
            chosen.qos,
            chosen.deadline,
        )
        if not chosen.also:
            return route
        return replace(route, also=tuple(self._further(route, port, operation, way) for way in chosen.also))

    def _further(self, route: ports.Route, port: Port, operation: Operation[Any], way: Way) -> ports.Route:
        middleware = self._carrier(way.middleware) if way.middleware else route.middleware
        channel = route.channel
        if way.source is not None:
            where = names.resolve(way.source, self.settings.namespace, port.interface.short)
            channel = names.channel(*where, operation.name)
        return replace(route, transport=self._transports[middleware], middleware=middleware, channel=channel)

    def _carrier(self, middleware: str | None) -> str:
        return carrier(middleware, self._generated_for)

    def _await(self, required: Sequence[tuple[Port, Link]]) -> None:
        """Wait until all required components are visible."""
        begun = told = time.monotonic()
        for port, link in required:
            while self.state is State.STARTING and not link.wait_peer(0.2):
                now = time.monotonic()
                peer = self.settings.peer_of(port)
                if now - begun > self.settings.startup_timeout:
                    waited = f"(waited {self.settings.startup_timeout:g} s for {peer})"
                    lacking = _lacking(port, required)
                    raise Unreachable(
                        f"{lacking} {waited}"
                        if lacking
                        else f"no component implements {port.interface.short} {waited}; "
                        f"start one, or set ports.{port.name}.from"
                    )
                if now - told > _REMIND or told == begun:
                    lacking = _lacking(port, required) if told != begun else ""  # at first, discovery is not complete
                    told = now
                    what = lacking or f"waiting for a component that implements {port.interface.short}"
                    log.info("%s (%s)", what, peer)

    def _connect_topics(self) -> None:
        """Wait until visible publishers and subscribers are connected, so that no message from now on is lost."""
        end = time.monotonic() + _CONNECTING
        topics = [link for bound in self._bound if bound.port.verb.is_topic for link in bound.links]
        for link in topics:
            while self.state is State.STARTING and not wait_connected(link, min(0.2, max(0.0, end - time.monotonic()))):
                if time.monotonic() >= end:
                    log.info("some publishers or subscribers are not connected after %g s; starting", _CONNECTING)
                    return

    # Living.

    def _live(self) -> None:
        while self.state is not State.ENDED:
            match self.state:
                case State.INITIALIZE:
                    self._once(self.worker.initialize, early=True)
                    self._get_going()
                case State.COMPUTE:
                    self._take_transitions()
                    self.computes += self._on_the_beat(self.worker.compute)
                case State.EMERGENCY:
                    self._on_the_beat(self.worker.emergency)
                case State.RESTORE:
                    self._once(self.worker.restore)
                case State.FINISH:
                    self._once(self.worker.finish, early=True)
                case State.STARTING:
                    raise AssertionError("connected, but still starting")

    def _get_going(self) -> None:
        """Enter the initial states, admit handlers and report readiness, unless the component was stopped meanwhile."""
        if self._machine and self.state is State.COMPUTE:
            self._move(self._machine._begin, early=True)
        if self.state is not State.COMPUTE:
            return
        self.monitor.open()
        self._watching.begin()
        self._beat = self.worker._beats(time.monotonic())
        self.ready.set()
        log.info("ready")
        self._tell("READY=1")  # last: the launcher then starts components that depend on this one

    def _take_transitions(self) -> None:
        """Take the transitions fired until now, one at a time. Handlers may run between two of them."""
        for _ in range(self._machine._waiting if self._machine else 0):
            if self._machine and self.state is State.COMPUTE:
                self._move(self._machine._step)

    def _move(self, move: Callable[[], None], *, early: bool = False) -> None:
        """Run a step of the state machine inside the monitor. `_enter` handles the errors of each method, so that one
        that raises does not leave the step half done."""
        with contextlib.suppress(Closed), self.monitor.held(early=early):  # Closed: the component is stopping
            move()

    def _enter(self, state: str) -> None:
        """Call the worker's method for a state that is entered, unless an earlier one has failed."""
        method = getattr(self.worker, f"sm_{label(state)}")
        if not self._failed:
            with self._guarded(method):
                method()

    def _on_the_beat(self, hook: Callable[[], None]) -> bool:
        """Call a hook if it is due. Otherwise wait until it is, or until an event, and return False."""
        wait = self._beat.due(time.monotonic())
        if wait:
            self._wake.wait(wait)
            self._wake.clear()
            return False
        begun = time.monotonic()
        self._call(hook)
        now = time.monotonic()
        self._beat.done(now)
        if self.overruns != self._beat.overruns:
            self.overruns = self._beat.overruns
            self._tell_slow(hook, now - begun)
        return True

    def _tell_slow(self, hook: Callable[[], None], took: float) -> None:
        """Warn once if a component skips more than half of its periods. A single late step is not reported."""
        if not self._was_slow and self.overruns >= max(_SLOW, self.computes):
            self._was_slow = True
            log.warning(
                "%s took %.3g s, longer than the period of %.3g s: %d periods were skipped (more are only counted)",
                hook.__qualname__, took, self._beat.period, self.overruns,
            )  # fmt: skip

    def _call_qos_hook(self, port: Port, operation: str, event: Missed | Lost) -> None:
        """Call the hook for a missed deadline or a lost publisher, inside the monitor."""
        instance = names.instance(event.channel)
        hook = self.worker.on_deadline_missed if isinstance(event, Missed) else self.worker.on_liveliness_lost
        try:
            with self.monitor.held():
                hook(port.label, operation, instance, event.total)
        except Closed:
            return  # the component is stopping
        except SystemExit:
            self.stop()
        except Exception as exc:
            log.error("%s raised\n%s", hook.__qualname__, user_trace(exc))

    def _once(self, hook: Callable[[], None], *, early: bool = False) -> None:
        state = self.state
        self._call(hook, early=early)
        self.signal(Event.DONE, during=state)

    def _call(self, hook: Callable[[], None], *, early: bool = False) -> None:
        """Run a hook inside the monitor, and handle what it raises."""
        with self._guarded(hook), self.monitor.held(early=early):
            hook()

    @contextlib.contextmanager
    def _guarded(self, hook: Callable[[], None]) -> Iterator[None]:
        self.doing = hook.__qualname__
        try:
            yield
            self._last_hindrance = ""
        except TransportError as exc:
            self._note_transport_error(hook, exc)
        except SystemExit as exc:
            if exc.code:
                self._fail(f"{hook.__qualname__} called sys.exit({exc.code!r})")
            self.stop()
        except Exception as exc:
            self._fail(f"{hook.__qualname__} raised {type(exc).__name__}\n{user_trace(exc)}")
        finally:
            self.doing = ""

    def _note_transport_error(self, hook: Callable[[], None], exc: TransportError) -> None:
        """A peer is gone, slow or closed. This is only logged, except in `initialize`, which must succeed."""
        if self.state is State.INITIALIZE:
            self._fail(f"initialize failed: {exc}")
        elif not isinstance(exc, Closed) and str(exc) != self._last_hindrance:
            self._last_hindrance = str(exc)
            log.warning("%s did not complete: %s", hook.__qualname__, exc)

    def _fail(self, message: str) -> None:
        log.error("%s", message)
        self._failed = True
        self.signal(Event.STOP)

    def _set_period(self, seconds: float) -> None:
        self._beat.period = seconds
        self._wake.set()


class _Transports:
    """The transports a component uses, each opened when first used, all closed together."""

    def __init__(self, settings: Settings, find: Callable[[str], TransportFactory], wanted: Callable[[], bool]) -> None:
        self._settings, self._find, self._wanted = settings, find, wanted
        self._open: dict[str, Transport] = {}
        self._gathering: contextlib.ExitStack | None = None

    @contextlib.contextmanager
    def gathering(self) -> Iterator[None]:
        """While entered, transports may delay the announcement of links that are opened or closed."""
        with contextlib.ExitStack() as self._gathering:
            for transport in self._open.values():
                self._gathering.enter_context(gathering(transport))
            yield
        self._gathering = None

    def __getitem__(self, name: str) -> Transport:
        if name not in self._open:
            options: Mapping[str, Any] = self._settings.transports.get(name, {})
            try:
                config = TransportConfig(options, self._settings.instance, self._wanted)
                self._open[name] = self._find(name)(config)
            except ConfigurationError as exc:
                raise ConfigurationError(f"transports.{name}: {exc}") from exc
            if self._gathering:
                self._gathering.enter_context(gathering(self._open[name]))
        return self._open[name]

    def close(self) -> None:
        while self._open:
            name, transport = self._open.popitem()
            try:
                transport.close()
            except Exception:  # of any transport: the others must be closed, too
                log.exception("closing the transport %s", name)


def main(
    worker_class: type[Worker[Any]],
    arguments: Sequence[str] | None = None,
    options: argparse.Namespace | None = None,
    missed: Callable[[], int] = lambda: 0,
) -> int:
    """Run a component as a program: `python -m PACKAGE`, `rc run DIR`. Returns the exit code.

    `options` are its arguments, if they have been parsed already. `missed` returns the number of a signal that arrived
    before this function handled signals, and 0 if there was none.
    """
    if options is None:
        parser = parser_of(worker_class.component)
        options = parser.parse_args(arguments)
        if options.json and not options.print_config:
            parser.error("--json is for --print-config")
    try:
        chosen, document = prepare(worker_class, options)
        if options.print_config:
            _print_config(worker_class, chosen, document, as_json=options.json)
            return 0
        _configure_logging(chosen)
        tell_notes(document)
        running = Running(worker_class, chosen)
    except (ConfigurationError, ComponentError) as exc:
        print(exc, file=sys.stderr)
        return exit_code(options)
    received: list[int] = []
    grace = grace_of([options.grace])
    stop_by = partial(_stop_by, running, received, grace)
    try:
        with Signals(stop_by, partial(end_after, grace)), Watchdog([running], [chosen.watchdog], notify):
            if number := missed():
                stop_by(number)
            front = running.worker._in_front
            fine = front(running.run, running.stop) if front else running.run()
            write_out()
    except ComponentError as exc:
        print(exc, file=sys.stderr)
        return 1
    settle()
    return 1 if not fine else 128 + received[0] if received else 0


def exit_code(*every: argparse.Namespace) -> int:
    """The exit code if components could not be configured: 2 if a middleware does not exist, else 1."""
    named = {carrier(each.middleware, "") for each in every} - {""}
    return 1 if named <= installed.transports().keys() else 2


def parser_of(component: Component) -> argparse.ArgumentParser:
    """The parser for the command line of a component."""
    name = component.name
    parser = Parser(
        prog=name,
        description=f"{component.description or f'Run the component {name}.'} Stop it with Ctrl-C or SIGTERM.",
        epilog="Every key of the configuration can be set with --set component.period=0.02 --set params.NAME=VALUE, or "
        "in the environment with ROBOCOMP__COMPONENT__PERIOD=0.02. The command line overrides the environment, which "
        "overrides the file.",
    )
    parser.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="configuration file (default: the one in etc/ of the component's folder)",
    )
    parser.add_argument("--name", help=f"name of this instance (default: {name.lower()})")
    parser.add_argument("--middleware", help="middleware that carries its messages, like the key `middleware`")
    parser.add_argument(
        "--set", action="append", default=[], type=_assignment, metavar="KEY=VALUE", help="set one key; may be repeated"
    )
    parser.add_argument(
        "--keys", metavar="FOLDER", help="keys for connections between hosts, as made by `rcdeploy keys`"
    )
    parser.add_argument(
        "--grace",
        type=_grace,
        metavar="SECONDS",
        help=f"time to stop after a request, before the process is ended by force (default: {GRACE:g})",
    )
    parser.add_argument(
        "--print-config",
        action="store_true",
        help="print the effective configuration and where each value comes from, and exit",
    )
    parser.add_argument("--json", action="store_true", help="with --print-config: one JSON object per key")
    parser.add_argument("--version", action="version", version=f"robocomp_py {__version__}")
    return parser


def read_plain(arguments: Sequence[str]) -> argparse.Namespace | None:
    """Parse arguments that consist of options with values only, as rcdeploy writes them; None for any other.

    The result equals that of `parser_of`. A process of many components saves memory this way: a parser takes a quarter
    of the memory of a component.
    """
    options = argparse.Namespace(
        config=None, name=None, middleware=None, set=[], keys=None, grace=None, print_config=False, json=False
    )
    if len(arguments) % 2:
        return None
    for option, value in zip(arguments[::2], arguments[1::2], strict=True):
        match option:
            case _ if value.startswith("-") or not value.strip():
                return None
            case "--set" if settings.is_assignment(value):
                options.set.append(value)
            case "--config":
                options.config = Path(value)
            case "--name" | "--middleware" | "--keys":
                setattr(options, option.removeprefix("--"), value)
            case _:
                return None
    return options


def _assignment(text: str) -> str:
    """The argument of `--set`, if its form is valid."""
    if not settings.is_assignment(text):
        raise argparse.ArgumentTypeError(f"`{text}` is not key=value, as in --set params.max_speed=0.5")
    return text


def _grace(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0 < seconds <= MAX_SECONDS:
        raise argparse.ArgumentTypeError(
            f"`{text}` is not a number of seconds above 0 and up to {MAX_SECONDS:g}, as in --grace 10"
        )
    return seconds


def _lacking(port: Port, required: Sequence[tuple[Port, Link]]) -> str:
    """The message about an interface of which only some operations are found; "" if that is not the case."""
    found = [link.wait_peer(0) for each, link in required if each is port]
    names = [operation.name for operation, _ in port.interface.under(port.verb)]
    if len(found) != len(names):  # an operation has several routes
        return ""
    absent = [f"`{name}`" for name, there in zip(names, found, strict=True) if not there]
    if not any(found) or not absent:
        return ""
    return (
        f"a component implements {port.interface.short} without {', '.join(absent)}: it was generated from another "
        "definition; run rcgen for both and restart them"
    )


def prepare(worker_class: type[Worker[Any]], options: argparse.Namespace) -> tuple[Settings, settings.Document]:
    """The checked settings of a component, given its options, and the document that holds them.

    Raises ConfigurationError.
    """
    document = _document(worker_class, options)
    chosen = settings.check(worker_class.component, document, options.name)
    _check_middlewares(worker_class, chosen, document)
    return chosen, document


def _document(worker_class: type[Worker[Any]], options: argparse.Namespace) -> settings.Document:
    component = worker_class.component
    path = options.config or settings.find(worker_class._home or Path(inspect.getfile(worker_class)).parent)
    document = settings.read_for(_short(path), component) if path else settings.Document(params=component.params)
    document.passed_on = worker_class._takes_any_params and component.params is None
    settings.environment(document, component, os.environ)
    for assignment in options.set:
        settings.override(document, assignment)
    if options.middleware:
        origin = f"--middleware {options.middleware}"
        settings.override(document, f"middleware={options.middleware}", origin)
    if options.keys:
        _set_keys(document, options.keys)
    settings.settle(document, component, worker_class.middleware)
    return document


def _set_keys(document: settings.Document, folder: str) -> None:
    from ..transports.deployment import deployments  # only a component with keys needs these
    from .effective import toml

    if not Path(folder).is_dir():
        raise ConfigurationError(f"--keys {folder}: no such folder; create it with `rcdeploy keys`")
    for transport in (name for name, each in deployments().items() if each.keyed):
        value = toml(str(Path(folder).absolute()))
        settings.override(document, f"transports.{transport}.keys={value}", f"--keys {folder}")


def _print_config(
    worker_class: type[Worker[Any]], chosen: Settings, document: settings.Document, *, as_json: bool
) -> None:
    from . import effective  # only --print-config needs it

    found = effective.effective(worker_class.component, chosen, document, worker_class.middleware)
    print(effective.as_json(found) if as_json else effective.as_toml(found), end="")


def tell_notes(document: settings.Document) -> None:
    """Log renamed keys, and how the lines of a file in a foreign format were read."""
    other = {"config.toml": "config", "config": "config.toml"}.get(document.path.name) if document.path else None
    if document.path and other and document.path.with_name(other).is_file():
        unread = document.path.with_name(other)
        log.info("%s is not read, because %s exists; to read it: --config %s", unread, document.path, _short(unread))
    for each in document.renamed:
        log.warning("%s: %s", each.origin or document.place(each.key), each.message)
    for note in document.notes:
        if not note.understood:
            log.warning("%s:%d: %s", document.path, note.line, note.why)
    idle = [
        note.key
        for note in document.notes
        if note.understood and not note.became and not (note.undeclared and document.passed_on)
    ]
    if document.notes:
        more = f" and {len(idle) - _MOST_LISTED} more" if len(idle) > _MOST_LISTED else ""
        shown = f"{', '.join(idle[:_MOST_LISTED])}{more}"
        log.info("configured by %s, written for RoboComp; without effect here: %s", document.path, shown or "nothing")


def _short(path: Path) -> Path:
    """The path relative to the working directory, if it is below it."""
    try:
        return path.resolve().relative_to(Path.cwd())
    except ValueError:
        return path


def _check_middlewares(worker_class: type[Worker[Any]], chosen: Settings, document: settings.Document) -> None:
    """Check that every middleware named is installed, and that those in use can be imported.

    Raises ConfigurationError with the place of the first that is not.
    """
    used = _middlewares(worker_class, chosen)
    for key, middleware in settings.middlewares(chosen).items():
        try:
            if middleware in used or middleware not in installed.transports():
                find_transport(middleware)
        except ConfigurationError as exc:
            raise ConfigurationError(f"{document.place(key)}: {exc}") from exc
    for middleware in sorted(used):
        find_transport(middleware)


def _middlewares(worker_class: type[Worker[Any]], chosen: Settings) -> set[str]:
    """The middlewares that its operations use, including those of `CommonBehavior`."""
    component, generated_for = worker_class.component, worker_class.middleware
    routed = {
        middleware
        for port in component.ports
        for operation, _ in port.interface.under(port.verb)
        for middleware in chosen.middlewares(port, operation.name, generated_for)
    }
    return routed | {carrier(chosen.middleware, generated_for)} if port_of(component) else routed


def _configure_logging(chosen: Settings) -> None:
    tell_where_on_abort()
    launched = "NOTIFY_SOCKET" in os.environ  # then the launcher adds time and name
    form = "%(levelname)s: %(message)s" if launched else f"%(asctime)s {chosen.instance} %(levelname)s: %(message)s"
    logging.basicConfig(level=chosen.log.upper(), format=form, datefmt="%H:%M:%S", stream=sys.stderr)


def tell_where_on_abort() -> None:
    """Print the stacks of all threads on SIGABRT, which watchdogs send, and on crashes of native code."""
    with contextlib.suppress(ValueError, OSError):  # stderr is closed
        faulthandler.enable()


def _stop_by(running: Running, received: list[int], grace: float | None, number: int) -> None:
    end_after(grace)
    received.append(number)
    running.stop()
    reminder = threading.Timer(STUCK, _tell_stuck, [running, grace])
    reminder.daemon = True
    start_thread(reminder)  # if it cannot start, the component stops without this message


def _tell_stuck(running: Running, grace: float | None) -> None:
    """Print what keeps a component from stopping, and how to end it."""
    if running.state is not State.ENDED:
        doing = running.doing or "closing"
        print(f"asked to stop {STUCK:g} s ago, but still busy with {doing}{announced(grace)}", file=sys.stderr)
