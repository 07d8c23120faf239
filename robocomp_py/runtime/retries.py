"""Calls of idempotent operations, which are retried if their server is gone or was never there.

A call has at most three attempts, all within its deadline. A budget limits retries to one in ten of all calls. A server
that refuses a call is stopping, and counts as gone.

A retry first waits for a server, so callers hardly notice a restart. A component that is stopping does not wait. A
retry sends the same request again: a server that received it before, and whose reply was lost, sends that reply again
and does not execute the request twice. Operations that are not idempotent are never retried.
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
"""Retries that each call adds to the budget."""

SAVED = 10.0
"""The largest budget, with which every caller begins."""

PAUSE = 0.02
"""Seconds before the second attempt, and three times as long before the third. Varied at random by up to a half, so
that not all callers retry at once."""

_POLL_S = 0.2
"""Seconds between checks whether the component is stopping, while it waits for a server."""

_THREADS = "retrying"

MAX_THREADS = 4
"""Maximum number of asynchronous calls that are retried at the same time; further ones wait."""

_chance = random.Random()  # its own, so that random numbers of the component's code do not depend on retries


class Budget:
    """The number of retries that are allowed now. Safe to use from any thread."""

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
    """A `Caller` that wraps another one and retries its calls."""

    def __init__(self, caller: Caller, ending: Callable[[], bool] = lambda: False) -> None:
        """`ending` says whether the component is stopping, so that waiting for a server makes no sense."""
        self._caller, self._budget, self._ending = caller, Budget(), ending
        self._numbering = caller if isinstance(caller, SupportsQuestion) else None
        self.wait_peer = caller.wait_peer
        self._pool: Pool | None = None
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
            return self._retry(question.ask, first, end)
        finally:
            question.close()

    def call(self, payload: Payload, deadline: float) -> Future[Reply]:
        end = time.monotonic() + deadline
        self._budget.earn()
        question, answer = self._question(payload), _FinalReply()

        def ask_again(why: _Failure) -> None:
            def ask() -> None:
                try:
                    answer.settle(partial(self._retry, partial(_attempted, question, answer), why, end))
                finally:
                    question.close()

            with self._lock:
                if not self._closed.is_set():
                    self._pool = self._pool or Pool(_THREADS, MAX_THREADS)
                    if self._pool.offer(ask, may_wait=True):
                        return
            question.close()
            answer.settle(partial(_reply_or_raise, why))  # without the lock: callbacks may close this caller

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
        self._caller.close()  # this also ends all waits for a server or a reply
        with self._lock:
            pool, self._pool = self._pool, None
        if pool:
            in_callback = threading.current_thread().name.startswith(_THREADS)  # a thread cannot wait for itself
            pool.close(wait=not in_callback)

    def _question(self, payload: Payload) -> Question:
        return self._numbering.question(payload) if self._numbering else _Unnumbered(self._caller, payload)

    def _retry(self, ask: Callable[[float], Reply], why: _Failure, end: float) -> Reply:
        """Make the further attempts. The outcome is that of the last one; without a server in time, that of `why`."""
        pause = PAUSE
        for _ in range(ATTEMPTS - 1):
            if not self._budget.spend():
                break
            about_to_block()
            self._closed.wait(min(pause * _chance.uniform(0.5, 1.5), max(0.0, end - time.monotonic())))
            pause *= 3
            if not self._wait_server(end):
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
        return _reply_or_raise(why)

    def _wait_server(self, end: float) -> bool:
        """Wait for a server. False if there is none in time, or if the component is stopping."""
        while True:
            left = max(0.0, end - time.monotonic())
            if self._caller.wait_peer(min(left, _POLL_S)):
                return True
            if left <= _POLL_S or self._ending():
                return False


_Failure = Reply | Unreachable
"""The outcome of an attempt after which the call may be retried."""


def _failure_of(ended: Future[Reply]) -> _Failure | None:
    error = ended.exception()
    if error:
        return error if isinstance(error, Unreachable) else None
    reply = ended.result()
    return reply if reply.status is Status.REFUSED else None


def _reply_or_raise(failure: _Failure) -> Reply:
    if isinstance(failure, Reply):
        return failure
    raise failure


class _FinalReply(Future[Reply]):
    """The Future of a call with all its attempts. Cancelling it cancels the current attempt."""

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
        except BaseException as exc:  # passed to the caller
            if self.set_running_or_notify_cancel():
                self.set_exception(exc)
        else:
            if self.set_running_or_notify_cancel():
                self.set_result(reply)


class _Unnumbered:
    """A request of a transport that does not recognize retries: a server may execute it twice, as it is idempotent."""

    def __init__(self, caller: Caller, payload: Payload) -> None:
        self._caller, self._payload = caller, payload

    def ask(self, deadline: float) -> Reply:
        return self._caller.ask(self._payload, deadline)

    def call(self, deadline: float) -> Future[Reply]:
        return self._caller.call(self._payload, deadline)

    def close(self) -> None: ...


def _attempted(question: Question, answer: _FinalReply, deadline: float) -> Reply:
    if answer.cancelled():
        raise CancelledError
    attempt = question.call(deadline)
    answer.follow(attempt)
    return attempt.result()
