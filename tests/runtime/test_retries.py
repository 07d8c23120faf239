"""Idempotent calls are asked again, others never."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future

import pytest

from robocomp_py.errors import Closed, RemoteFailure, Timeout, Unreachable
from robocomp_py.runtime.retries import ATTEMPTS, SAVED, SHARE, Budget, Retrying
from robocomp_py.testing.conformance import answering, blob, query, unblob
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Reply, Statistics, Status, TransportConfig
from robocomp_py.transports.inproc import InprocTransport

OK = Reply(Status.OK, b"fine")
A_LITTLE = 0.05

Outcome = Reply | Exception


class Scripted:
    """A caller whose questions end one after the other as it is said; its server is there, or not."""

    def __init__(self, *outcomes: Outcome, there: bool = True) -> None:
        self.outcomes, self.there = list(outcomes), there
        self.asked: list[object] = []
        self.stats, self.closed = Statistics(), threading.Event()

    def wait_peer(self, timeout: float) -> bool:
        if not self.there:
            self.closed.wait(timeout)
        if self.closed.is_set():
            raise Closed("closed")
        return self.there

    def ask(self, payload: object, deadline: float) -> Reply:
        self.asked.append(payload)
        outcome = self.outcomes.pop(0)
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    def call(self, payload: object, deadline: float) -> Future[Reply]:
        future: Future[Reply] = Future()
        try:
            future.set_result(self.ask(payload, deadline))
        except Exception as exc:
            future.set_exception(exc)
        return future

    def close(self) -> None:
        self.closed.set()


def asking(how: str, retrying: Retrying) -> Callable[[float], Reply]:
    if how == "ask":
        return lambda deadline: retrying.ask(b"?", deadline)
    return lambda deadline: retrying.call(b"?", deadline).result(SOON)


GONE = Unreachable("its server left")
LEAVING = Reply(Status.REFUSED)


@pytest.fixture(params=["ask", "call"])
def how(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.mark.parametrize("first", [GONE, LEAVING])
def test_a_server_that_went_away_or_is_about_to_is_asked_again_when_it_is_back(how: str, first: Reply) -> None:
    caller = Scripted(first, GONE, OK)
    retrying = Retrying(caller)
    assert asking(how, retrying)(SOON) == OK
    assert len(caller.asked) == ATTEMPTS
    retrying.close()


def test_what_is_refused_again_and_again_is_refused(how: str) -> None:
    caller = Scripted(LEAVING, LEAVING, LEAVING, OK)
    retrying = Retrying(caller)
    assert asking(how, retrying)(SOON) == LEAVING
    assert len(caller.asked) == ATTEMPTS
    retrying.close()


def test_after_three_attempts_the_last_reason_is_reported(how: str) -> None:
    caller = Scripted(GONE, GONE, Unreachable("and again"), OK)
    retrying = Retrying(caller)
    with pytest.raises(Unreachable, match="and again"):
        asking(how, retrying)(SOON)
    assert len(caller.asked) == ATTEMPTS
    retrying.close()


@pytest.mark.parametrize("outcome", [Timeout("no answer"), RemoteFailure("op", "Error", "text"), Closed("closed")])
def test_whatever_else_happens_is_not_tried_again(how: str, outcome: Exception) -> None:
    caller = Scripted(outcome, OK)
    retrying = Retrying(caller)
    with pytest.raises(type(outcome)):
        asking(how, retrying)(SOON)
    assert len(caller.asked) == 1
    retrying.close()


def test_no_wait_exceeds_the_deadline(how: str) -> None:
    caller = Scripted(GONE, OK, there=False)
    retrying = Retrying(caller)
    with pytest.raises(Unreachable):
        asking(how, retrying)(A_LITTLE)
    assert len(caller.asked) == 1
    retrying.close()


def test_an_ending_client_waits_for_no_server_but_calls_one_that_is_there(how: str) -> None:
    caller = Scripted(GONE, GONE, OK, there=False)
    retrying = Retrying(caller, ending=lambda: True)
    with pytest.raises(Unreachable):
        asking(how, retrying)(10 * SOON)
    caller.there = True
    assert asking(how, retrying)(SOON) == OK
    retrying.close()


def test_one_call_in_ten_may_be_a_further_attempt() -> None:
    budget = Budget()
    assert [budget.spend() for _ in range(int(SAVED) + 1)] == [True] * int(SAVED) + [False]
    for _ in range(round(1 / SHARE) - 1):
        budget.earn()
    assert not budget.spend()
    for _ in range(2):  # binary fractions of ten
        budget.earn()
    assert budget.spend()


def test_when_all_calls_fail_most_are_not_repeated(how: str) -> None:
    caller = Scripted(*[GONE] * 1000)
    retrying = Retrying(caller)
    for _ in range(100):
        with pytest.raises(Unreachable):
            asking(how, retrying)(SOON)
    assert 100 < len(caller.asked) <= 100 + SAVED + 100 * SHARE
    retrying.close()


def test_closing_releases_waits_for_a_server() -> None:
    caller = Scripted(GONE, there=False)
    retrying = Retrying(caller)
    waiting = retrying.call(b"?", SOON)
    wait_until(lambda: caller.asked)
    retrying.close()
    with pytest.raises((Closed, Unreachable)):
        waiting.result(SOON)
    assert not [thread.name for thread in threading.enumerate() if thread.name.startswith("retrying")]


def test_a_call_that_is_cancelled_is_not_asked_again() -> None:
    first: Future[Reply] = Future()
    caller = Scripted(OK)
    caller.call = lambda payload, deadline: first  # type: ignore[method-assign]
    retrying = Retrying(caller)
    answer = retrying.call(b"?", SOON)
    assert answer.cancel()
    assert first.cancelled()
    assert caller.asked == []
    retrying.close()


def test_a_question_asked_before_its_server_comes_is_answered_when_it_does() -> None:
    here, there = (InprocTransport(TransportConfig({"bus": "test_retries"})) for _ in range(2))
    retrying = Retrying(there.caller(query("a/b/c")))
    asked = retrying.call(blob(there, b"early"), SOON)
    here.server(query("a/b/c"), answering(here, bytes.upper))
    assert unblob(there, asked.result(SOON).payload) == b"EARLY"
    retrying.close()
    there.close()
    here.close()
