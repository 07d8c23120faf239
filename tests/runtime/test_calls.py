"""What becomes of a call: results, declared exceptions, failures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from robocomp_py.contract.types import Struct
from robocomp_py.errors import ArgumentError, RemoteFailure
from robocomp_py.runtime.calls import Call, Handler
from robocomp_py.testing import everything as e
from robocomp_py.transports.base import Status
from robocomp_py.wire.codec import Decoder, Encoder
from robocomp_py.wire.messagepack import MessagePack


class CountingCodec(MessagePack):
    """Counts how often a message is compiled."""

    def __init__(self) -> None:
        self.compiled = 0

    def encoder(self, message: Struct, *, snapshot: bool = True) -> Encoder:
        self.compiled += 1
        return super().encoder(message, snapshot=snapshot)

    def decoder(self, message: Struct, *, prefix: bool = False) -> Decoder:
        self.compiled += 1
        return super().decoder(message, prefix=prefix)


def declared(dividend: int, divisor: int) -> Any:
    raise e.FailedBadly("worse", 8, e.Point(1.0, 2.0))


def undeclared(dividend: int, divisor: int) -> Any:
    raise KeyError("on purpose")


def test_what_answers_is_compiled_when_it_is_first_needed_or_before() -> None:
    codec = CountingCodec()
    answering = Handler(e.divide, codec, lambda dividend, divisor: (dividend, divisor))
    assert codec.compiled == 0
    answering.compile()
    assert codec.compiled == 2
    assert answering.answer((1, 2)).status is Status.OK
    assert codec.compiled == 2


@pytest.mark.parametrize(("method", "error"), [(declared, e.FailedBadly), (undeclared, RemoteFailure)])
def test_exceptions_are_compiled_once(method: Any, error: type[Exception]) -> None:
    codec = CountingCodec()
    answering, call = Handler(e.divide, codec, method), Call(e.divide, codec)
    answering.compile()
    counts = []
    for _ in range(3):
        with pytest.raises(error):
            call.result(answering.answer((1, 0)))
        counts.append(codec.compiled)
    assert counts[0] > 4
    assert counts == [counts[0]] * 3


def test_a_handler_that_fails_at_every_call_is_logged_rarely(caplog: pytest.LogCaptureFixture) -> None:
    def method(dividend: int, divisor: int) -> Any:
        if divisor:
            raise KeyError(dividend)
        return dividend // divisor, 0

    answering = Handler(e.divide, MessagePack(), method)
    replies = [answering.answer((number, number % 2)) for number in range(10)]
    assert {each.status for each in replies} == {Status.FAILED}
    assert [record.message.splitlines()[-1] for record in caplog.records] == [
        "ZeroDivisionError: integer division or modulo by zero",
        "KeyError: 1",
    ]


def test_arguments_that_a_handler_cannot_use_take_one_line_of_the_log(caplog: pytest.LogCaptureFixture) -> None:
    def method(dividend: int, divisor: int) -> Any:
        raise ArgumentError(f"{dividend} is no dividend")

    noted: list[str] = []
    answering = Handler(e.divide, MessagePack(), method, lambda name, _: noted.append(name))
    with pytest.raises(RemoteFailure, match="ArgumentError: 7 is no dividend") as told:
        Call(e.divide, MessagePack()).result(answering.answer((7, 1)))
    assert told.value.kind == "ArgumentError"
    (line,) = (record.getMessage() for record in caplog.records)
    assert line.endswith("method refused: 7 is no dividend")
    assert noted == []


def test_an_undeclared_exception_is_reported_with_its_interface_and_operation() -> None:
    codec = MessagePack()
    reply = Handler(e.divide, codec, declared).answer((1, 0))
    other = replace(e.divide, raises=())
    with pytest.raises(RemoteFailure, match=r"^Conformance\.Everything\.divide.*does not declare"):
        Call(other, codec).result(reply)
