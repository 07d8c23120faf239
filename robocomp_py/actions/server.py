"""Executes the goals of one action, one at a time, a step at each `compute`.

    accepted    -> executing      when it is the first one at a `compute`
    executing   -> canceling      asked to: the next `yield` of its handler raises Cancelled
    any of them -> over           succeeded, canceled or aborted; its result is kept for a while

States change only inside the monitor of the component. `poll` may be called from any thread.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Generator
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any

from ..contract.goal import OCTETS, GoalState, NoResult, Policy
from ..contract.interface import Action, Operation
from ..errors import Cancelled, DeclaredError, TransportError
from ..runtime.calls import Handler, Outcome
from ..runtime.tally import NoteFailure
from ..transports.base import Reply, Status
from ..wire.codec import Codec
from .goal import MOST_POLLS, MOST_QUEUED, MOST_RESULTS, ServerGoal, Times

log = logging.getLogger("robocomp.worker")

Steps = Generator[Any, None, Any]
Tell = Callable[[Operation[None], tuple[Any, ...]], object]
"""Publishes on a topic of the action."""


@dataclass(eq=False)
class _Poll:
    """A request for a result that waits."""

    future: Future[Reply]
    until: float
    codec: int


@dataclass(eq=False)
class _Entry:
    id: bytes
    arguments: tuple[Any, ...]
    detached: bool
    heard: float
    """When its client was heard last."""
    state: GoalState = GoalState.ACCEPTED
    steps: Steps | None = None
    """None until it is executed, and when it is over."""
    is_told: bool = False
    """Whether its handler has got the Cancelled."""
    replies: list[Reply] | None = None
    """Its result, by the number of the codec."""
    ended: float = 0.0
    polls: list[_Poll] = field(default_factory=list)


class GoalServer:
    """The goals of one action of one port."""

    def __init__(
        self,
        action: Action,
        policy: Policy,
        method: Callable[..., Steps],
        tell: Tell,
        seconds: Callable[[], float],
        times: Times = Times(),  # noqa: B008 - frozen
        kind: type[ServerGoal] = ServerGoal,
        note: NoteFailure | None = None,
    ) -> None:
        """`seconds` is the clock of silence and of kept results. `kind` is what the handler gets of a goal.

        `note` gets each exception that is logged as an error.
        """
        self._action, self._policy, self._method, self._tell = action, policy, method, tell
        self._seconds, self._times, self._kind = seconds, times, kind
        self._declared = tuple(each.python for each in action.raises if each.python)
        self._note = note
        self._handlers: list[Handler] = []
        self._goals: dict[bytes, _Entry] = {}
        self._lock = threading.Lock()
        """Held while polls are added, and while a goal ends."""
        self._is_ending = False

    @property
    def active(self) -> int:
        """Number of goals that are not over."""
        return len(self._active())

    def codec(self, codec: Codec) -> int:
        """Encode results by this codec, too; returns its number for `poll`."""
        self._handlers.append(Handler(self._action.result, codec, _Result(self._method), self._note))
        return len(self._handlers) - 1

    # What clients ask. The first two are handlers.

    def start(self, goal: Any, detached: bool, *arguments: Any) -> None:
        identity = bytes(goal)
        if len(identity) != OCTETS:
            raise ValueError(f"the id of a goal has {OCTETS} octets, not {len(identity)}")
        if identity in self._goals:
            raise ValueError("there is a goal of this id")
        self._make_room()
        entry = _Entry(identity, arguments, detached, self._seconds())
        with self._lock:
            self._goals[identity] = entry
        self._tell_states()

    def cancel(self, goal: Any) -> int:
        entry = self._goals.get(bytes(goal))
        if entry is None:
            return GoalState.UNKNOWN
        if self._cancel(entry):
            self._tell_states()
        return entry.state

    def poll(self, goal: Any, wait: float, codec: int) -> Reply | Future[Reply]:
        """The result of a goal, now or when it is over; no result after `wait` seconds."""
        now = self._seconds()
        with self._lock:
            entry = self._goals.get(bytes(goal))
            if entry is None:
                return self._none(GoalState.UNKNOWN, codec)
            entry.heard = now
            if entry.replies is not None:
                return entry.replies[codec]
            if self._is_ending:
                return Reply(Status.REFUSED)
            poll = _Poll(Future(), now + min(max(0.0, wait), self._times.silence), codec)
            entry.polls.append(poll)
            late = entry.polls[:-MOST_POLLS]
            del entry.polls[:-MOST_POLLS]
        self._answer_none(entry, late)
        return poll.future

    # What the component does.

    def step(self) -> None:
        """Let the first goal go on until its next `yield`; if it ends, the next one begins. Called by `compute`."""
        self._look_at_clients()
        for entry in self._active():
            if entry.replies is None and not self._advance(entry):
                return

    def end(self) -> None:
        """End all goals, because the component stops: their clients find it unreachable. Idempotent."""
        with self._lock:
            self._is_ending = True
        for entry in self._active():
            steps, entry.steps = entry.steps, None
            try:
                if steps:
                    steps.close()
            except (Exception, SystemExit) as exc:
                self._handlers[0].log_failure(exc)
            self._answer(entry, [Reply(Status.REFUSED)] * len(self._handlers))

    def _active(self) -> list[_Entry]:
        return [each for each in list(self._goals.values()) if each.replies is None]

    def _make_room(self) -> None:
        """Apply the policy to a new goal."""
        active = self._active()
        match self._policy:
            case Policy.REFUSE if active:
                raise Outcome(Reply(Status.BUSY))
            case Policy.QUEUE if len(active) > MOST_QUEUED:
                raise Outcome(Reply(Status.BUSY))
            case Policy.PREEMPT:
                for each in active:
                    self._cancel(each)
            case _:
                pass

    def _cancel(self, entry: _Entry) -> bool:
        """Returns whether that changes its state."""
        if entry.replies is not None or entry.state is GoalState.CANCELING:
            return False
        if entry.steps is None:
            self._end(entry, GoalState.CANCELED, NoResult(GoalState.CANCELED))
        else:
            entry.state = GoalState.CANCELING
        return True

    def _advance(self, entry: _Entry) -> bool:
        """Let a goal go on; returns whether it is over."""
        try:
            if entry.steps is None:
                goal = self._kind(entry.id, lambda feedback: self._feed(entry, feedback))
                entry.state = GoalState.EXECUTING
                entry.steps = self._method(goal, *entry.arguments)
                self._tell_states()
            if entry.state is GoalState.CANCELING and not entry.is_told:
                entry.is_told = True
                entry.steps.throw(Cancelled(f"{self._action.name} is cancelled"))
            else:
                next(entry.steps)
            return False
        except StopIteration as stop:
            self._end(entry, GoalState.SUCCEEDED, stop.value)
        except Cancelled:
            self._end(entry, GoalState.CANCELED, NoResult(GoalState.CANCELED))
        except (Exception, SystemExit) as exc:
            if not isinstance(exc, (*self._declared, Outcome)):
                self._handlers[0].log_failure(exc)
            self._end(entry, GoalState.ABORTED, exc)
        self._tell_states()
        return True

    def _end(self, entry: _Entry, state: GoalState, value: Any) -> None:
        """`value` is the result, or the exception that replaces it."""
        replies = [self._reply(each, value) for each in self._handlers]
        failed = state is GoalState.SUCCEEDED and any(each.status is not Status.OK for each in replies)
        entry.state = GoalState.ABORTED if failed else state
        entry.steps, entry.ended = None, self._seconds()
        self._answer(entry, replies)

    def _reply(self, handler: Handler, value: Any) -> Reply:
        is_known = isinstance(value, (*self._declared, NoResult))
        if isinstance(value, Outcome):
            return value.reply
        return handler.failed(value) if isinstance(value, BaseException) and not is_known else handler.answer((value,))

    def _answer(self, entry: _Entry, replies: list[Reply]) -> None:
        with self._lock:
            entry.replies = replies
            polls, entry.polls = entry.polls, []
        for each in polls:
            each.future.set_result(replies[each.codec])

    def _feed(self, entry: _Entry, feedback: Any) -> None:
        if entry.replies is None and self._action.told:
            self._tell(self._action.told, (entry.id, feedback))

    def _tell_states(self) -> None:
        known = list(self._goals.values())
        goals, states = b"".join(each.id for each in known), bytes(each.state for each in known)
        try:
            self._tell(self._action.status, (goals, states))
        except TransportError as exc:  # a client learns the end of its goal by its result
            log.debug("the states of %s were not told: %s", self._action.name, exc)

    def _look_at_clients(self) -> None:
        """Cancel the goals of silent clients, answer late polls, and forget old results."""
        now, lost = self._seconds(), False
        over = []
        for entry in list(self._goals.values()):
            if entry.replies is not None:
                over.append(entry)
                continue
            with self._lock:
                late = [each for each in entry.polls if each.until <= now]
                entry.polls = [each for each in entry.polls if each.until > now]
            self._answer_none(entry, late)
            if not entry.detached and now - entry.heard > self._times.silence and self._cancel(entry):
                log.warning("%s is cancelled: its client is gone", self._action.name)
                lost = True
        old = [each for each in over if now - each.ended > self._times.kept]
        old += over[: max(0, len(over) - MOST_RESULTS)]
        with self._lock:
            for each in old:
                self._goals.pop(each.id, None)
        if lost:
            self._tell_states()

    def _answer_none(self, entry: _Entry, polls: list[_Poll]) -> None:
        for each in polls:
            each.future.set_result(self._none(entry.state, each.codec))

    def _none(self, state: GoalState, codec: int) -> Reply:
        return self._handlers[codec].answer((NoResult(state),))


class _Result:
    """Stands for the handler when its result is encoded: messages about it name the handler itself."""

    def __init__(self, method: Callable[..., Steps]) -> None:
        self.__qualname__ = getattr(method, "__qualname__", repr(method))

    def __call__(self, value: Any) -> Any:
        if isinstance(value, DeclaredError):
            raise value
        return value
