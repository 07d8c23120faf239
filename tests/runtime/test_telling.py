"""What components tell of their calls and logs, while a tool holds a lease on it."""

from __future__ import annotations

import base64
import logging
import subprocess
import sys
import threading
from collections.abc import Generator, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from robocomp_py.contract.component import Port
from robocomp_py.errors import RemoteFailure, Unreachable
from robocomp_py.runtime import telling
from robocomp_py.runtime.RoboCompIntrospection import Record
from robocomp_py.runtime.tally import Tallies
from robocomp_py.runtime.telling import Telling
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools import asking, leases
from robocomp_py.tools.access import Access
from robocomp_py.tools.census import take_census
from robocomp_py.tools.tap import tapped
from robocomp_py.transports.base import find_transport
from robocomp_py.wire.cdr import Cdr

from ..tools.commands import TELLERS
from .components import Calculator, Pupil, Stuck
from .running import make, running

OVER = "middleware=shm"


class Asking(Pupil):
    """Does one thing in each step, in turn."""

    def compute(self) -> None:
        steps = (self._divides, self._is_refused, self._pokes, self._waits_elsewhere)
        steps[len(self.entries) % len(steps)]()
        super().compute()

    def _divides(self) -> None:
        self.everything_proxy.divide(7, 2)

    def _is_refused(self) -> None:
        try:
            self.everything_proxy.divide(1, 0)
        except e.Failed:
            self.log.warning("no \x1b[2J division", extra={"trace": "abc"})

    def _pokes(self) -> None:
        self.everything_proxy.poke(3)

    def _waits_elsewhere(self) -> None:
        self.everything_proxy._ask_async(e.divide, (9, 3), None).result()


@pytest.fixture
def access() -> Iterator[Access]:
    with Access() as made:
        yield made


def there(over: str, *instances: str) -> None:
    wait_until(lambda: set(instances) <= set(asking.components(take_census([over]))))


def heard(access: Access, over: str, instance: str, operation: str) -> Generator[dict[str, Any]]:
    """What an instance tells, endlessly."""
    there(over, instance)
    with leases.told(access, lambda: take_census([over]), [instance], operation, 5 * SOON) as told:
        assert told.silent == {}
        for message in tapped(told.topics, first=5 * SOON, whole=None):
            ((_, one),) = message.message.items()
            yield one


def values(call: dict[str, Any]) -> tuple[Any, Any]:
    """The values of a call of `divide`."""
    response = base64.b64decode(call["response"])
    return (
        Cdr().decoder(e.divide.request)(base64.b64decode(call["request"])),
        Cdr().decoder(e.divide.response)(response) if response else None,
    )


@pytest.fixture(params=[each for each in TELLERS if each != "ice"])
def pair(request: pytest.FixtureRequest) -> Iterator[str]:
    """The middleware of a server and a client."""
    over = (f"middleware={request.param}", "namespace=desk")
    with (
        running(make(Calculator, find_transport, *over)),
        running(make(Asking, find_transport, *over, "ports.everything.from=calculator", name="pupil")),
    ):
        yield request.param


def test_callers_tell_of_queries_and_commands(pair: str, access: Access) -> None:
    found = heard(access, pair, "desk/pupil", "called")
    seen: dict[tuple[str, str], Any] = {}
    while len(seen) < 4:
        call = next(found)
        request = values(call)[0] if "divide" in call["channel"] else ()
        seen[call["channel"], str(request)] = call
    found.close()
    fine = seen["desk/calculator/Everything/divide", "(7, 2)"]
    assert (fine["caller"], fine["middleware"], fine["status"], fine["error"]) == ("desk/pupil", pair, "ok", "")
    assert values(fine) == ((7, 2), (3, 1))
    assert 0 < fine["took"] < 100
    assert values(seen["desk/calculator/Everything/divide", "(9, 3)"])[1] == (3, 0)
    thrown = seen["desk/calculator/Everything/divide", "(1, 0)"]
    assert (thrown["status"], thrown["response"]) == ("thrown", "")
    assert thrown["error"] == 'Conformance.Failed: {"what": "division by zero", "code": 7}'
    sent = seen["desk/calculator/Everything/poke", "()"]
    assert (sent["status"], sent["response"]) == ("ok", "")


def test_servers_tell_of_what_they_serve(pair: str, access: Access) -> None:
    found = heard(access, pair, "desk/calculator", "called")
    calls = [next(found) for _ in range(8)]
    found.close()
    assert {each["caller"] for each in calls} == {""}
    assert {each["status"] for each in calls if each["channel"] == "desk/calculator/Everything/divide"} == {
        "ok",
        "thrown",
    }
    assert values(next(each for each in calls if each["status"] == "ok" and "divide" in each["channel"]))[1]
    assert "desk/calculator/Everything/poke" in {each["channel"] for each in calls}


def test_log_records_are_told_with_their_trace(pair: str, access: Access) -> None:
    found = heard(access, pair, "desk/pupil", "logged")
    record = next(each for each in found if each["logger"] == "pupil")
    found.close()
    assert (record["level"], record["instance"], record["trace"]) == ("WARNING", "pupil", "abc")
    assert record["file"].endswith("test_telling.py")


class Hasty(Pupil):
    """Does not wait until its call is done."""

    def compute(self) -> None:
        super().compute()
        try:
            self.everything_proxy.work("long", deadline=0.05)
        except TimeoutError:
            self.entries.append("late")


def test_a_call_that_is_too_late_is_told_as_one(access: Access) -> None:
    with running(make(Stuck, find_transport, OVER, name="stuck")) as stuck:
        with running(make(Hasty, find_transport, OVER, name="hasty")):
            found = heard(access, "shm", "hasty", "called")
            call = next(found)
            found.close()
        stuck.released.set()
    assert (call["status"], call["response"]) == ("timeout", "")
    late = "the deadline passed before the server could execute the call"  # on a machine that is busy with other things
    assert call["error"].endswith(("no answer in 0.05 s", late))


def test_topics_exist_only_while_there_is_a_lease(access: Access) -> None:
    made = make(Calculator, find_transport, OVER)
    with running(made):
        there("shm", "calculator")
        assert "IntrospectionPub" not in _interfaces()
        network = take_census(["shm"])
        asking.watch(access, network, "calculator", calls=True, logs=False, lease=0.2)
        wait_until(lambda: "IntrospectionPub" not in _interfaces())
        wait_until(lambda: not _threads())
        assert {each.begin for each in made.monitor.tallies.every} == {None}
        with leases.told(access, lambda: take_census(["shm"]), ["calculator"], "logged"):
            assert "IntrospectionPub" in _interfaces()
            assert any(isinstance(each, telling._Logs) for each in logging.getLogger().handlers)
    assert not _threads()
    assert not any(isinstance(each, telling._Logs) for each in logging.getLogger().handlers)


def _interfaces() -> set[str]:
    return {each.interface for each in take_census(["shm"], own=True).channels.values()}


def _threads() -> list[str]:
    return [each.name for each in threading.enumerate() if each.name.startswith("telling-")]


@pytest.mark.parametrize("lease", [0.0, -1.0, 61.0, float("nan"), float("inf")])
def test_a_lease_is_bounded(lease: float, access: Access) -> None:
    with running(make(Calculator, find_transport, OVER)):
        there("shm", "calculator")
        with pytest.raises(RemoteFailure, match="a lease lasts at most 60 s"):
            asking.watch(access, take_census(["shm"]), "calculator", calls=True, logs=True, lease=lease)
        assert "IntrospectionPub" not in _interfaces()


def test_a_component_that_does_not_run_cannot_be_watched(access: Access) -> None:
    with pytest.raises(Unreachable, match=r"nobody is not there, or has no Introspection.watch"):
        asking.watch(access, take_census(["shm"]), "nobody", calls=True, logs=True, lease=1.0)


def test_without_a_lease_nothing_is_imported() -> None:
    code = "import sys, robocomp_py.runtime.run; print('robocomp_py.runtime.telling' in sys.modules)"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "False"


class Slow:
    """A topic that publishes once it is released."""

    def __init__(self) -> None:
        self.begun, self.released = threading.Event(), threading.Event()
        self.sent: list[Any] = []

    def _send(self, operation: Any, arguments: tuple[Any, ...], deadline: float) -> None:
        self.begun.set()
        self.released.wait(SOON)
        self.sent += arguments


def test_what_comes_too_fast_is_counted() -> None:
    slow = Slow()
    told = Telling(lambda port: (slow, lambda: None), Tallies(), "wander", "")
    logger = logging.getLogger("wander")
    with ExitStack() as end:
        end.callback(told.close)
        end.callback(slow.released.set)
        told.watch(False, True, 60.0)
        logger.warning("first")
        assert slow.begun.wait(SOON)
        for number in range(telling.WAITING + 5):
            logger.warning("%d", number)
        slow.released.set()
        wait_until(lambda: len(slow.sent) == telling.WAITING + 1)
        logger.warning("last")
        wait_until(lambda: len(slow.sent) == telling.WAITING + 2)
    assert isinstance(slow.sent[-1], Record)
    assert (slow.sent[-1].text, slow.sent[-1].dropped) == ("last", 5)


def test_a_text_that_no_middleware_carries_is_told_nevertheless() -> None:
    slow = Slow()
    slow.released.set()
    told = Telling(lambda port: (slow, lambda: None), Tallies(), "wander", "")
    told.watch(False, True, 60.0)
    (handler,) = (each for each in logging.getLogger().handlers if isinstance(each, telling._Logs))
    odd = {"name": "wander", "levelno": logging.INFO, "lineno": 1, "msg": "a \ud800 b \0 c"}
    handler.handle(logging.makeLogRecord(odd))  # none but ours may get it
    wait_until(lambda: slow.sent)
    told.close()
    assert slow.sent[0].text == "a \\ud800 b \ufffd c"


def test_a_topic_that_cannot_be_opened_leaves_nothing() -> None:
    def publish(port: Port) -> Any:
        raise Unreachable("there is no broker")

    told = Telling(publish, Tallies(), "wander", "")
    with pytest.raises(Unreachable):
        told.watch(True, True, 1.0)
    told.close()
    assert not _threads()
