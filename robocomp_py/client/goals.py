"""Actions of a running network."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable, Iterator
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from ..actions.client import GoalClient
from ..actions.goal import Goal
from ..contract import interface as contract
from ..contract.goal import OCTETS
from ..contract.interface import Operation, qos_of
from ..tools.actions import Offered, action_of, told
from .operations import Described, asking

if TYPE_CHECKING:
    from .session import Session

_LOOK = 0.2
"""Seconds between two looks at whether the connection is closed."""


class Action(Described):
    """An action: called like a function, it begins a goal, and returns it once the server has accepted it.

    The goal has `feedback`, `status`, `done`, `result(timeout)`, `future()` and `cancel()`, and asyncio code may await
    it. It is cancelled when the connection is closed, unless `detached=True`.
    """

    def __init__(
        self, session: Session, offered: Offered, heard: Callable[[bytes, Any], object] = lambda goal, feedback: None
    ) -> None:
        """`heard` gets the feedback of all goals of the server, on a thread of the transport."""
        self._offered, self._heard = offered, heard
        super().__init__(session, offered.start)

    def __call__(self, *values: Any, **named: Any) -> Goal[Any, Any]:
        limit = self._deadline(named)
        own = {each.name for each in self._inputs}
        detached = bool(named.pop("detached", False)) if "detached" not in own else False
        return self._client.begin(self._action, self._arguments(values, named), detached, limit)

    @property
    def _inputs(self) -> Any:
        return self._action.inputs

    @cached_property
    def _action(self) -> contract.Action:
        parts = self._offered.parts.items()
        return action_of(
            self._offered.name, {part: self._session.types.operation(each.operation) for part, each in parts}
        )

    @cached_property
    def _client(self) -> GoalClient:
        session, parts, action = self._session, self._offered.parts, self._action
        queries = {"start": action.start, "result": action.result, "cancel": action.cancel}
        bound = {each.name: asking(session, parts[part], each) for part, each in queries.items()}
        client = GoalClient((action,), bound, self._await, partial(secrets.token_bytes, OCTETS))

        def heard(goal: Any, feedback: Any) -> None:
            client.heard(goal, feedback)
            self._heard(bytes(goal), feedback)

        self._hear("status", action.status, client.told)
        if action.told:
            self._hear("feedback", action.told, heard)
        session.opened(lambda: client, lambda made: made.close())  # the last to be opened is the first to be closed
        return client

    def _hear(self, part: str, operation: Operation[None], take: Callable[[Any, Any], object]) -> None:
        channel = self._offered.parts[part]
        decode = self._session.codec(channel).decoder(operation.request)
        qos = qos_of(operation)
        self._session.hear(channel, operation, qos, lambda payload: take(*decode(payload)))

    def _await(self, timeout: float | None, holds: Callable[[], bool], wake: threading.Event) -> bool:
        end = None if timeout is None else time.monotonic() + timeout
        while not holds():
            if self._session.is_closed:
                return False
            left = _LOOK if end is None else min(_LOOK, end - time.monotonic())
            if left <= 0:
                return True
            wake.wait(left)
            wake.clear()
        return True

    @property
    def _title(self) -> str:
        return self._offered.name

    def _taught(self) -> Iterator[str]:
        yield f"{self._title}: action"
        yield from (f"  {line}" for line in told(self._action))
        yield f"use: goal = …{self._action.name}({self._example()}), then goal.feedback, goal.result(), goal.cancel()"
