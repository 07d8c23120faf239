"""What travels beside the payloads over Ice, also from those who mean no good, and how it is queued."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.contract.interface import Pattern
from robocomp_py.errors import DecodeError
from robocomp_py.transports.base import Channel, Reply, Status, TypeRef
from robocomp_py.transports.leader_followers import Job
from robocomp_py.wire.header import Flag, pack_request, read_request
from tests.docs.pages import ROOT, blocks

pytestmark = pytest.mark.tool


@pytest.fixture(scope="module")
def messages() -> ModuleType:
    from robocomp_py.transports.ice import messages

    return messages


@pytest.mark.parametrize("size", [0, 1, 254, 255, 256, 70_000])
@pytest.mark.parametrize("status", [Status.FAILED, Status.MISMATCH, 255])
def test_a_refusal_is_read_as_it_was_written(messages: Any, status: int, size: int) -> None:
    assert messages.read_refusal(messages.refusal(status, bytes(size))) == (status, bytes(size))


def test_a_program_of_ices_own_reads_a_refusal_by_the_slice_of_the_page(messages: Any, tmp_path: Path) -> None:
    [slice_] = blocks(ROOT / "docs" / "reference" / "protocol-ice.md", "slice")
    (tmp_path / "Refusal.ice").write_text(slice_ + "module robocomp { interface Any { void op() throws Refusal; }; };")
    subprocess.run(["slice2py", "Refusal.ice"], cwd=tmp_path, check=True)
    octets = messages.refusal(Status.BUSY, b"x" * 300)
    (tmp_path / "read.py").write_text(READ.format(octets.hex()))
    done = subprocess.run([sys.executable, "read.py"], cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout == f"{int(Status.BUSY)} 300\n", done.stderr


READ = """
import sys; sys.path.insert(0, ".")
import Ice, robocomp

class Refusing(Ice.Blobject):
    def ice_invoke(self, octets, current):
        return False, bytes.fromhex("{}")

with Ice.initialize() as communicator:
    adapter = communicator.createObjectAdapterWithEndpoints("A", "tcp -h 127.0.0.1")
    proxy = adapter.addWithUUID(Refusing())
    adapter.activate()
    try:
        robocomp.AnyPrx.uncheckedCast(proxy).op()
    except robocomp.Refusal as exc:
        print(exc.status, len(exc.detail))
"""


@given(st.binary(max_size=60))
def test_whatever_else_is_called_an_exception_is_one_or_is_refused(messages: Any, octets: bytes) -> None:
    good = messages.refusal(Status.BUSY, b"detail")
    for odd in (octets, good[:26] + octets, good[: len(octets)], good + octets):
        try:
            reply = messages.reply_of(False, odd)
        except DecodeError:
            continue
        assert reply is None or reply.status in list(Status)


@given(st.text(max_size=80))
def test_a_context_that_is_not_ours_is_no_header(messages: Any, text: str) -> None:
    assert messages.header({}) is None
    assert messages.header({"rc": text}) is None
    assert 0 <= messages.room({"rc-max": text}, 1000) <= 1000


def test_a_context_of_ours_is_one(messages: Any) -> None:
    packed = pack_request(Flag.IDEMPOTENT, 1, 2, 3, 4.0)
    request = messages.header({"rc": packed.hex(), "other": "1"})
    assert (request.flags, request.fingerprint, request.client, request.sequence) == (Flag.IDEMPOTENT, 1, 2, 3)
    assert messages.room({"rc-max": "100"}, 1000) == 100


@pytest.mark.parametrize(
    ("unknown", "kind", "reason"),
    [
        ('Traceback (most recent call last):\n  File "a.py", line 1, in f\nValueError: odd\n', "ValueError", "odd"),
        ("Traceback (most recent call last):\n  …\nmy.own.Error\n", "Error", ""),
        (
            'Traceback (most recent call last):\n  File "a.py", line 1, in f\nValueError: one\n  File two:\n\nthree: 3',
            "ValueError",
            "one\n  File two:\n\nthree: 3",
        ),
        (
            'Traceback (most recent call last):\n  File "a.py", line 1\nKeyError: 1\n\nDuring handling of the '
            "above exception, another exception occurred:\n\n"
            'Traceback (most recent call last):\n  File "a.py", line 2\nOdd: 2',
            "Odd",
            "2",
        ),
        ("c++ exception: std::exception", "UnknownException", "c++ exception: std::exception"),
        ("two\nlines: of it", "UnknownException", "two\nlines: of it"),
        ("", "UnknownException", "no reason given"),
    ],
)
def test_a_remote_exception_is_reported_with_its_class_if_known(
    messages: Any, unknown: str, kind: str, reason: str
) -> None:
    reply = messages.failure_told(unknown)
    assert reply.status is Status.FAILED
    assert messages.failure_text(reply.payload).startswith(f"{kind}: {reason}".strip())


def test_requests_beyond_the_queue_are_refused() -> None:
    from robocomp_py.transports.ice import objects

    taken: list[int] = []
    intake = objects.Intake()

    def take(number: int) -> list[Any]:
        taken.append(number)
        return []

    offered = range(objects.REQUESTS_WAITING + 5)
    assert [intake.put(lambda number=number: take(number), 1) for number in offered].count(False) == 5
    assert intake.put(lambda: take(-1)), "what Ice has to say always finds room"
    while len(taken) <= objects.REQUESTS_WAITING:
        intake.receive(0.0)
    assert taken == [*range(objects.REQUESTS_WAITING), -1]
    assert intake.put(list, objects.OCTETS_WAITING), "one message may be as large as it likes"
    assert not intake.put(list, 1)


@pytest.mark.parametrize("bound", ["REQUESTS_WAITING", "OCTETS_WAITING"])
def test_requests_that_were_read_and_wait_are_bounded_for_all_servers_of_a_transport_together(
    bound: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from robocomp_py.transports.ice import served as requests
    from robocomp_py.transports.ice import server

    monkeypatch.setattr(requests, bound, 3)
    served: list[Any] = []
    answers: list[Status] = []
    later: list[Job] = []

    def service(payload: Any, _: float) -> Reply:
        served.append(payload)
        return Reply(Status.OK, b"")

    transport = SimpleNamespace(requests=requests.RequestQueue(later.append))
    servers = [
        server.Server(transport, Channel(f"a/A/{name}", Pattern.QUERY, TypeRef(f"A.{name}", 1, f"A.{name}")), service)
        for name in "ab"
    ]

    def request(number: int) -> Job | None:
        asked = read_request(pack_request(Flag.NONE, 1, number % 2, number, None))
        return servers[number % 2].take(asked, b"x", float("inf"), lambda reply: answers.append(reply.status))

    begin, *_ = (request(number) for number in range(1, 6))
    assert answers == [Status.BUSY] * 2
    assert begin
    begin()
    request(6)
    while later:
        later.pop()()
    assert answers.count(Status.OK) == len(served) == 4


def test_a_request_that_cannot_be_taken_does_not_hinder_the_others(caplog: pytest.LogCaptureFixture) -> None:
    from robocomp_py.transports.ice import objects

    intake = objects.Intake()
    intake.put(lambda: [print, 1 // 0])  # type: ignore[list-item]  # it raises
    intake.put(lambda: [print])
    assert intake.receive(0.0) == [print]
    assert "ZeroDivisionError" in caplog.text
