"""The goals of actions that an agent has begun: few at a time, each with a limit of time, all of them logged."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...contract.interface import Action
from ...errors import RobocompError, Timeout
from ...spelling import unknown
from ..actions import outcome, shown_feedback
from .bounds import Bounds, Refused

if TYPE_CHECKING:
    from ...actions.goal import Goal
    from ..actions import Offered

Begin = Callable[["Offered", tuple[Any, ...]], "Goal[Any, Any]"]
"""Begins a goal, and returns it once its server has accepted it. Raises what calls raise."""

_KEPT = 16
"""Goals that are over and can still be read."""

_SHORT = 8
"""Digits of the id of a goal by which an agent names it."""


@dataclass(frozen=True)
class _Begun:
    name: str
    action: Action
    goal: Goal[Any, Any]
    limit: threading.Timer


class Goals:
    """Safe to use from any thread."""

    def __init__(self, begin: Begin, write: Callable[[str, str], object], bounds: Bounds) -> None:
        self._begin, self._write, self._bounds = begin, write, bounds
        self._lock = threading.Lock()
        self._known: dict[str, _Begun] = {}
        self._starting = 0

    def begin(self, offered: Offered, action: Action, values: tuple[Any, ...], limit: float) -> dict[str, Any]:
        """Begin a goal, which is cancelled after `limit` seconds. Raises Refused, and what calls raise."""
        with self._lock:
            active = [key for key, each in self._known.items() if not each.goal.done]
            if len(active) + self._starting >= self._bounds.goals:
                raise Refused(f"at most {self._bounds.goals} goals at a time; these are not over: {', '.join(active)}")
            self._starting += 1
        try:
            goal = self._begin(offered, values)
            key = goal.id.hex()[:_SHORT]
            timer = threading.Timer(limit, self._expire, (key, limit))
            timer.name = f"goal {key}"
            with self._lock:
                self._known[key] = _Begun(offered.name, action, goal, timer)
                self._forget()
            timer.start()
            goal.future().add_done_callback(lambda _: self._over(key))
        finally:
            with self._lock:
                self._starting -= 1
        return {"goal": key, "status": goal.status.name, "cancelled_after_s": limit}

    def read(self, wanted: str, timeout: float) -> dict[str, Any]:
        """How a goal has ended, or after `timeout` seconds how it goes on. Raises Refused, and what it ended with."""
        key, begun = self._named(wanted)
        told = {"goal": key, "action": begun.name}
        try:
            return told | outcome(begun.goal, begun.action, timeout)
        except Timeout:
            if begun.goal.done:
                raise
        return told | {
            "status": begun.goal.status.name,
            "feedback": shown_feedback(begun.action, begun.goal.feedback),
        }

    def cancel(self, wanted: str) -> dict[str, Any]:
        """Ask the server of a goal to cancel it. Raises Refused, and what calls raise."""
        key, begun = self._named(wanted)
        if not begun.goal.done:
            begun.goal.cancel()
        return {"goal": key, "status": begun.goal.status.name}

    def close(self) -> None:
        """No goal is cancelled after this, because its time is over. Idempotent."""
        with self._lock:
            timers = [each.limit for each in self._known.values()]
        for each in timers:
            each.cancel()
            if each.ident and each is not threading.current_thread():
                each.join()

    def _named(self, wanted: str) -> tuple[str, _Begun]:
        with self._lock:
            known = dict(self._known)
        key = wanted.strip().lower()[:_SHORT]
        if key not in known:
            raise Refused(unknown("goal", wanted, known))
        return key, known[key]

    def _expire(self, key: str, limit: float) -> None:
        begun = self._known[key]
        self._write("WARNING", f"goal {key} of {begun.name}: not over in {limit:g} s; it is cancelled")
        try:
            begun.goal.cancel()
        except RobocompError as exc:
            self._write("WARNING", f"goal {key} of {begun.name}: not cancelled: {exc}")

    def _over(self, key: str) -> None:
        begun = self._known[key]
        begun.limit.cancel()
        ended = begun.goal.status.name if begun.goal.done else "cancelled with this server"
        self._write("INFO", f"goal {key} of {begun.name}: {ended}")

    def _forget(self) -> None:
        """Forget the oldest goals that are over."""
        over = [key for key, each in self._known.items() if each.goal.done]
        for key in over[: max(0, len(over) - _KEPT)]:
            del self._known[key]
