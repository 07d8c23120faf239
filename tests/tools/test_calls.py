"""`rc echo --calls` shows queries and commands, by those that call or by those that serve."""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Iterator
from typing import Any

import pytest

from robocomp_py.contract.interface import Pattern
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools import asking
from robocomp_py.tools.calls import seen
from robocomp_py.tools.census import take_census
from robocomp_py.tools.network import Channel, End
from robocomp_py.transports.base import find_transport
from robocomp_py.transports.census import Told
from robocomp_py.wire.cdr import Cdr

from ..runtime.components import Calculator, Stuck
from ..runtime.running import make, running
from ..runtime.test_telling import Asking, Hasty
from .commands import complained, said
from .talkers import Talker

PATIENCE = ("--timeout", f"{5 * SOON:g}")


def there(over: str, *instances: str) -> None:
    wait_until(lambda: set(instances) <= set(asking.components(take_census([over]))))


@pytest.fixture(params=["shm", "zeromq"])
def pair(request: pytest.FixtureRequest) -> Iterator[str]:
    """The middleware of a client and a server."""
    over = (f"middleware={request.param}", "namespace=desk")
    with (
        running(make(Calculator, find_transport, *over)),
        running(make(Asking, find_transport, *over, "ports.everything.from=calculator", name="pupil")),
    ):
        there(request.param, "desk/calculator", "desk/pupil")
        yield request.param


def calls(capsys: pytest.CaptureFixture[str], over: str, *arguments: str) -> list[dict[str, Any]]:
    told = said(capsys, "echo", "--calls", "--json", "--middleware", over, *PATIENCE, *arguments)
    return [json.loads(line) for line in told.splitlines()]


def test_calls_are_shown_decoded_with_how_they_ended(pair: str, capsys: pytest.CaptureFixture[str]) -> None:
    found = calls(capsys, pair, "divide", "-n", "6")
    assert {(each["caller"], each["channel"], each["middleware"]) for each in found} == {
        ("desk/pupil", "desk/calculator/Everything/divide", pair)
    }
    by_status = {each["status"]: each for each in found}
    assert set(by_status) == {"ok", "thrown"}
    assert by_status["ok"]["response"] in ({"ret": 3, "remainder": 1}, {"ret": 3, "remainder": 0})
    assert by_status["thrown"]["request"] == {"dividend": 1, "divisor": 0}
    assert by_status["thrown"]["response"] is None
    assert by_status["thrown"]["error"] == 'Conformance.Failed: {"what": "division by zero", "code": 7}'
    assert all(each["took"] > 0 for each in found)


def test_commands_are_shown(pair: str, capsys: pytest.CaptureFixture[str]) -> None:
    (sent,) = calls(capsys, pair, "calculator/Everything/poke", "-n", "1")
    assert (sent["request"], sent["response"], sent["status"]) == ({"number": 3}, None, "ok")


def test_servers_tell_if_they_are_asked(pair: str, capsys: pytest.CaptureFixture[str]) -> None:
    found = calls(capsys, pair, "Everything", "--served", "-n", "8")
    assert {each["caller"] for each in found} == {""}
    assert {each["channel"].rpartition("/")[2] for each in found} == {"divide", "poke"}


def test_a_line_for_people(pair: str, capsys: pytest.CaptureFixture[str]) -> None:
    lines = said(capsys, "echo", "--calls", "divide", "-n", "6", "--middleware", pair, *PATIENCE).splitlines()
    fine = next(line for line in lines if '"divisor": 2' in line)
    assert "desk/pupil → desk/calculator/Everything/divide ok " in fine
    assert fine.endswith(' ms {"dividend": 7, "divisor": 2} → {"ret": 3, "remainder": 1}')
    thrown = next(line for line in lines if " thrown " in line)
    assert thrown.endswith('{"dividend": 1, "divisor": 0} Conformance.Failed: {"what": "division by zero", "code": 7}')


@pytest.mark.parametrize("over", ["shm", "zeromq"])
def test_a_call_without_an_answer_is_shown(over: str, capsys: pytest.CaptureFixture[str]) -> None:
    with running(make(Stuck, find_transport, f"middleware={over}", name="stuck")) as stuck:
        try:
            with running(make(Hasty, find_transport, f"middleware={over}", name="hasty")):
                there(over, "hasty", "stuck")
                (call,) = calls(capsys, over, "stuck/Everything/work", "-n", "1")
        finally:
            stuck.released.set()
    assert (call["status"], call["request"], call["response"]) == ("timeout", {"task": "long"}, None)
    assert call["took"] >= 0.05


def test_what_cannot_be_shown_is_said(pair: str, capsys: pytest.CaptureFixture[str]) -> None:
    over = ("--middleware", pair, "--timeout", "0.3")
    assert "`rc echo --calls divide` shows its calls" in complained(capsys, "echo", "divide", *over)
    unheard = complained(capsys, "echo", "--calls", "calculator/CommonBehavior/getState", *over)
    assert unheard.startswith("rc echo: no component that can tell of its calls uses desk/calculator/CommonBehavior/")
    assert complained(capsys, "echo", "--served", "divide", *over, code=2) == "rc echo: --served is for --calls\n"
    unfit = complained(capsys, "echo", "--calls", "divide", "--field", "ret", "--csv", *over, code=2)
    assert unfit == "rc echo: --field, --csv: for topics only; --calls prints whole calls\n"
    assert "nothing was heard" in complained(capsys, "echo", "--calls", "work", *over)


def test_a_topic_has_no_calls(capsys: pytest.CaptureFixture[str]) -> None:
    with running(make(Talker, find_transport, "middleware=shm", name="talker")):
        there("shm", "talker")
        assert complained(capsys, "echo", "--calls", "news", "--middleware", "shm") == (
            "rc echo: `news` is a topic; without --calls, `rc echo news` prints what is published\n"
        )


CHANNEL = Channel(
    "calculator/Everything/divide",
    Pattern.QUERY,
    [
        End(
            "shm",
            Told(
                "calculator", os.getpid(), "serves", "calculator/Everything/divide", e.divide.fingerprint, e.divide.text
            ),
        )
    ],
)


def call(**more: Any) -> dict[str, Any]:
    octets = {
        "request": base64.b64encode(Cdr().encoder(e.divide.request)((7, 2))).decode(),
        "response": base64.b64encode(Cdr().encoder(e.divide.response)((3, 1))).decode(),
    }
    words = {"caller": "pupil", "channel": "*/Everything/divide", "middleware": "shm", "status": "ok", "error": ""}
    return {"call": words | octets | {"begun": 1, "took": 0.5, "dropped": 2} | more}


def test_a_client_of_any_server_matches_the_channel() -> None:
    found, dropped = seen([CHANNEL], call(), served=False)
    assert found is not None
    assert (found.request, found.response) == ({"dividend": 7, "divisor": 2}, {"ret": 3, "remainder": 1})
    assert dropped == 2


@pytest.mark.parametrize(
    "message",
    [
        "not understood",
        {},
        {"call": 3},
        {"call": {}},
        call(begun="soon"),
        call(channel=3),
        call(channel="calculator/Everything/work"),
        call(caller=""),
    ],
)
def test_what_is_no_such_call_is_left_out(message: Any) -> None:
    assert seen([CHANNEL], message, served=False)[0] is None


def test_octets_and_texts_of_others_do_no_harm() -> None:
    found, _ = seen([CHANNEL], call(request="AA==", response="no base64", error="\x1b[2J"), served=False)
    assert found is not None
    assert found.request.startswith("not understood: ")
    assert found.response.startswith("not understood: ")
    assert found.error == "\ufffd[2J"
