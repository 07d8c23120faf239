"""Calls the code of a component that is no handler, and handles what it raises."""

from __future__ import annotations

import logging
from collections.abc import Callable

from ..errors import Closed, ConfigurationError, TransportError
from .clock import Clock
from .lifecycle import State
from .monitor import Monitor
from .trace import user_trace

log = logging.getLogger("robocomp.worker")

Hook = Callable[[], object]


class Hooks:
    """Calls hooks, methods of timers and of states, and functions of one component.

    An exception is logged and ends the component. A peer that is gone or slow is only logged.
    """

    def __init__(
        self,
        monitor: Monitor,
        clock: Clock,
        state: Callable[[], State],
        stop: Callable[[], None],
        fail: Callable[[str], None],
    ) -> None:
        """`state` is that of the component, `stop` asks it to stop, and `fail` ends it with a message."""
        self._monitor, self._clock = monitor, clock
        self._state, self._stop, self._fail = state, stop, fail
        self._running: list[Hook] = []
        self._hindered: dict[str, str] = {}
        """Why hooks, by their names, did not complete the last time. This is logged once."""
        self.entered = 0
        """When a call last entered the monitor after it had to wait: a time of the clock."""

    @property
    def doing(self) -> str:
        """The name of the hook that is running; "" if none is."""
        return name_of(self._running[-1]) if self._running else ""

    def call(self, hook: Hook, *, early: bool = False) -> None:
        """Call it inside the monitor; `early`: even before or after handlers are admitted."""
        self._guard(hook, self._held, hook, early)

    def call_inside(self, hook: Hook) -> None:
        """Call it when inside the monitor."""
        self._guard(hook, hook)

    def tell(self, hook: Callable[..., object], *arguments: object) -> None:
        """Call a hook that is told of an event, inside the monitor. An exception does not end the component."""
        try:
            with self._monitor.held():
                hook(*arguments)
        except Closed:
            return  # the component is stopping
        except SystemExit:
            self._stop()
        except Exception as exc:
            log.error("%s raised %s\n%s", name_of(hook), type(exc).__name__, user_trace(exc))
            self._monitor.tallies.note_failure(name_of(hook), exc)

    def _held(self, hook: Hook, early: bool) -> None:
        if self._monitor.enter(early=early):  # on the path of every instant: `with` costs more
            self.entered = self._clock.now()
        try:
            hook()
        finally:
            self._monitor.leave()

    def _guard(self, hook: Hook, run: Callable[..., object], *arguments: object) -> None:
        """Run a hook by `run`, with these arguments, and handle what it raises."""
        self._running.append(hook)
        try:
            run(*arguments)
            if self._hindered:
                self._hindered.pop(name_of(hook), None)
        except TransportError as exc:
            self._note_transport_error(hook, exc)
        except SystemExit as exc:
            if exc.code:
                self._fail(f"{name_of(hook)} called sys.exit({exc.code!r})")
                self._monitor.tallies.note_failure(name_of(hook), exc)
            self._stop()
        except ConfigurationError as exc:
            # In `initialize` it is about a setting, or a file that a setting names: the code is not at fault.
            is_setting = self._state() is State.INITIALIZE
            self._fail(str(exc) if is_setting else _raised(hook, exc))
            self._monitor.tallies.note_failure(name_of(hook), exc)
        except Exception as exc:
            self._fail(_raised(hook, exc))
            self._monitor.tallies.note_failure(name_of(hook), exc)
        finally:
            self._running.remove(hook)

    def _note_transport_error(self, hook: Hook, exc: TransportError) -> None:
        """A peer is gone, slow or closed. This is only logged, except in `initialize`, which must succeed."""
        if self._state() is State.INITIALIZE:
            self._fail(f"initialize failed: {exc}")
            self._monitor.tallies.note_failure(name_of(hook), exc)
        elif not isinstance(exc, Closed) and str(exc) != self._hindered.get(name_of(hook)):
            self._hindered[name_of(hook)] = str(exc)
            log.warning("%s did not complete: %s", name_of(hook), exc)


def name_of(hook: Callable[..., object]) -> str:
    return getattr(hook, "__qualname__", None) or repr(hook)


def _raised(hook: Hook, exc: Exception) -> str:
    return f"{name_of(hook)} raised {type(exc).__name__}\n{user_trace(exc)}"
