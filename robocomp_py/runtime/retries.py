"""Calls of idempotent operations, which are asked again if their server went away, or was not there.

    at most three times, within their deadline, and only while few do: of all calls, one in ten may be a further attempt

Who asks again waits for a server first, so a component that is restarted is hardly missed; a component that ends itself
waits for none. Who refuses a call is about to leave, as a rule, and counts as gone. What is asked again is the same
question: a server that got it before, and whose answer was lost, answers it again, and does not execute it again.
Operations that are not idempotent are never asked twice.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from functools import partial

from ..errors import Unreachable
from ..threads import Pool
from ..transports.base import Caller, Question, Reply, Statistics, Status, SupportsQuestion, about_to_block
from ..wire.codec import Payload

ATTEMPTS = 3

SHARE = 0.1
"""Further attempts, of all calls."""

SAVED = 10.0
"""Further attempts that may be saved up; so many a caller has at first."""

PAUSE = 0.02
"""Seconds before the second attempt, and three times as many before each further one: about, so that not all come at
once."""

_LOOK = 0.2
"""Seconds between two looks whether who waits for a server is to end."""

_THREADS = "retrying"

_ASIDE = 4
"""So many asynchronous calls are asked again at a time; others wait for their turn."""


class Budget:
    """How many further attempts there may be. Safe to use from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._left = SAVED

    def earn(self) -> None:
        with self._lock:
            self._left = min(SAVED, self._left + SHARE)

    def spend(self) -> bool:
        with self._lock:
            if self._left < 1.0:
                return False
            self._left -= 1.0
            return True


class Retrying:
    """A `Caller` of an idempotent operation, in front of the one that does the work."""

    def __init__(
        self, caller: Caller, budget: Budget | None = None, ending: Callable[[], bool] = lambda: False
    ) -> None:
        """`ending` says whether no server is waited for any more."""
        self._caller, self._budget, self._ending = caller, budget or Budget(), ending
        self._numbering = caller if isinstance(caller, SupportsQuestion) else None
        self.wait_peer = caller.wait_peer
        self._aside: Pool | None = None
        self._lock = threading.Lock()
        self._closed = threading.Event()

    @property
    def stats(self) -> Statistics:
        return self._caller.stats

    def ask(self, payload: Payload, deadline: float) -> Reply:
        end = time.monotonic() + deadline
        self._budget.earn()
        question = self._question(payload)
        try:
            first: _Failure
            try:
                first = question.ask(deadline)
                if first.status is not Status.REFUSED:
                    return first
            except Unreachable as exc:
                first = exc
            return self._again(question.ask, first, end)
        finally:
            question.close()

    def call(self, payload: Payload, deadline: float) -> Future[Reply]:
        end = time.monotonic() + deadline
        self._budget.earn()
        question, answer = self._question(payload), _Answer()

        def ask_again(why: _Failure) -> None:
            def ask() -> None:
                try:
                    answer.settle(partial(self._again, partial(_called, question, answer), why, end))
                finally:
                    question.close()

            with self._lock:
                if not self._closed.is_set():
                    self._aside = self._aside or Pool(_THREADS, _ASIDE)
                    if self._aside.offer(ask, may_wait=True):
                        return
            question.close()
            answer.settle(partial(_end, why))  # without the lock: callbacks may close us

        def over(first: Future[Reply]) -> None:
            failure = None if first.cancelled() else _failure_of(first)
            if failure and not answer.cancelled():
                ask_again(failure)
                return
            question.close()
            if not first.cancelled():
                answer.settle(first.result)

        try:
            first = question.call(deadline)
        except Unreachable as exc:
            ask_again(exc)
        except BaseException:
            question.close()
            raise
        else:
            answer.follow(first)
            first.add_done_callback(over)
        return answer

    def close(self) -> None:
        self._closed.set()
        self._caller.close()  # who waits for a server, or for an answer, is released by this
        with self._lock:
            aside, self._aside = self._aside, None
        if aside:
            mine = threading.current_thread().name.startswith(_THREADS)  # a callback closes us
            aside.close(wait=not mine)

    def _question(self, payload: Payload) -> Question:
        return self._numbering.question(payload) if self._numbering else _Anew(self._caller, payload)

    def _again(self, ask: Callable[[float], Reply], why: _Failure, end: float) -> Reply:
        """Tells how it failed at last; who finds no server in time, how it failed at first."""
        pause = PAUSE
        for _ in range(ATTEMPTS - 1):
            if not self._budget.spend():
                break
            about_to_block()
            self._closed.wait(min(pause * random.uniform(0.5, 1.5), max(0.0, end - time.monotonic())))
            pause *= 3
            if not self._is_served(end):
                break
            left = end - time.monotonic()
            if left <= 0:
                break
            try:
                why = ask(left)
                if why.status is not Status.REFUSED:
                    return why
            except Unreachable as exc:
                why = exc
        return _end(why)

    def _is_served(self, end: float) -> bool:
        """Wait for a server."""
        while True:
            left = max(0.0, end - time.monotonic())
            if self._caller.wait_peer(min(left, _LOOK)):
                return True
            if left <= _LOOK or self._ending():
                return False


_Failure = Reply | Unreachable
"""How a call ended that may be asked again."""


def _failure_of(ended: Future[Reply]) -> _Failure | None:
    error = ended.exception()
    if error:
        return error if isinstance(error, Unreachable) else None
    reply = ended.result()
    return reply if reply.status is Status.REFUSED else None


def _end(failure: _Failure) -> Reply:
    if isinstance(failure, Reply):
        return failure
    raise failure


class _Answer(Future[Reply]):
    """What comes of a call in the end. Cancelling it gives up the attempt that is under way."""

    _attempt: Future[Reply] | None = None

    def follow(self, attempt: Future[Reply]) -> None:
        self._attempt = attempt
        if self.cancelled():
            attempt.cancel()

    def cancel(self) -> bool:
        cancelled = super().cancel()
        if cancelled and self._attempt:
            self._attempt.cancel()
        return cancelled

    def settle(self, how: Callable[[], Reply]) -> None:
        try:
            reply = how()
        except BaseException as exc:  # it is told to who waits
            if self.set_running_or_notify_cancel():
                self.set_exception(exc)
        else:
            if self.set_running_or_notify_cancel():
                self.set_result(reply)


class _Anew:
    """A question of a transport that does not know one again: it may be executed twice, which does no harm."""

    def __init__(self, caller: Caller, payload: Payload) -> None:
        self._caller, self._payload = caller, payload

    def ask(self, deadline: float) -> Reply:
        return self._caller.ask(self._payload, deadline)

    def call(self, deadline: float) -> Future[Reply]:
        return self._caller.call(self._payload, deadline)

    def close(self) -> None: ...


def _called(question: Question, answer: _Answer, deadline: float) -> Reply:
    if answer.cancelled():
        raise CancelledError
    attempt = question.call(deadline)
    answer.follow(attempt)
    return attempt.result()
