"""Operations as messages, their patterns, and the fingerprint of what both sides must agree on."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.contract.interface import Interface, Operation, Pattern, Verb, differences
from robocomp_py.contract.types import (
    FLOAT32,
    FLOAT64,
    INT32,
    INT64,
    STRING,
    Dictionary,
    Enumeration,
    ExceptionType,
    Field,
    Response,
    Sequence,
    Struct,
)

MODE = Enumeration("Test::Mode", (("slow", 0), ("fast", 1)))
POINT = Struct("Test::Point", (Field("x", FLOAT64), Field("y", FLOAT64)))
FAILED = ExceptionType("Test::Failed", (Field("what", STRING),))
STUCK = ExceptionType("Test::Stuck", (Field("where", POINT),), FAILED)
MOVE: Operation[Any] = Operation(
    "Test::Base",
    "moveTo",
    (Field("path", Sequence(POINT)), Field("mode", MODE)),
    (Field("ret", FLOAT32), Field("left", Dictionary(STRING, INT32))),
    (STUCK,),
    Pattern.QUERY,
)

TEXT = """\
operation Test::Base.moveTo
pattern query
struct Test::BaseMoveToRequest
  path sequence<Test::Point>
  mode Test::Mode
struct Test::BaseMoveToResponse
  ret float32
  left dictionary<string,int32>
exception Test::Stuck
  what string
  where Test::Point
struct Test::Point
  x float64
  y float64
enum Test::Mode
  slow 0
  fast 1"""


def operation(**changes: Any) -> Operation[Any]:
    return replace(MOVE, **changes)


# Messages.


def test_the_request_holds_the_inputs_and_the_response_the_outputs() -> None:
    assert MOVE.request == Struct("Test::BaseMoveToRequest", MOVE.inputs)
    assert MOVE.response == Response("Test::BaseMoveToResponse", MOVE.outputs)


@pytest.mark.parametrize(
    ("interface", "name", "message"),
    [
        ("RoboCompLaser::Laser", "getLaserData", "RoboCompLaser::LaserGetLaserDataRequest"),
        ("Laser", "getLaserData", "LaserGetLaserDataRequest"),
        ("Test::arm_left", "move_to__home_", "Test::ArmLeftMoveToHomeRequest"),
        ("A::B::C", "d", "A::B::CDRequest"),
    ],
)
def test_messages_are_named_in_upper_camel_case(interface: str, name: str, message: str) -> None:
    assert Operation(interface, name).request.name == message


# Patterns.


@pytest.mark.parametrize("verb", [Verb.REQUIRES, Verb.IMPLEMENTS])
def test_without_a_pattern_a_service_operation_is_a_query(verb: Verb) -> None:
    assert Operation("I", "o").carried(verb) is Pattern.QUERY
    assert operation(pattern=None).carried(verb) is Pattern.QUERY


@pytest.mark.parametrize("verb", [Verb.PUBLISHES, Verb.SUBSCRIBES])
def test_without_a_pattern_a_topic_operation_is_a_publication_unless_it_gives_something_back(verb: Verb) -> None:
    assert Operation("I", "o", (Field("x", INT32),)).carried(verb) is Pattern.PUBLISH
    assert Operation("I", "o", (), (Field("ret", INT32),)).carried(verb) is None
    assert Operation("I", "o", (), (), (FAILED,)).carried(verb) is None


@pytest.mark.parametrize("verb", Verb)
@pytest.mark.parametrize("pattern", Pattern)
def test_a_written_pattern_is_carried_on_its_side_only(verb: Verb, pattern: Pattern) -> None:
    fits = (pattern is Pattern.PUBLISH) == (verb in (Verb.PUBLISHES, Verb.SUBSCRIBES))
    assert Operation("I", "o", pattern=pattern).carried(verb) is (pattern if fits else None)


def test_an_interface_tells_what_takes_part_under_a_verb() -> None:
    news: Operation[None] = Operation("Test::I", "news", pattern=Pattern.PUBLISH)
    ask: Operation[None] = Operation("Test::I", "ask")
    interface = Interface("Test::I", (news, ask))
    assert list(interface.under(Verb.IMPLEMENTS)) == [(ask, Pattern.QUERY)]
    assert list(interface.under(Verb.SUBSCRIBES)) == [(news, Pattern.PUBLISH), (ask, Pattern.PUBLISH)]
    assert (interface.module, interface.short) == ("Test", "I")
    assert (Interface("I", ()).module, Interface("I", ()).short) == ("", "I")


@pytest.mark.parametrize(
    ("verb", "provides", "topic", "proxy"),
    [
        (Verb.REQUIRES, False, False, True),
        (Verb.IMPLEMENTS, True, False, False),
        (Verb.PUBLISHES, True, True, True),
        (Verb.SUBSCRIBES, False, True, False),
    ],
)
def test_a_verb_tells_whether_its_port_provides_listens_or_calls(
    verb: Verb, provides: bool, topic: bool, proxy: bool
) -> None:
    assert (verb.provides, verb.is_topic, verb.has_proxy) == (provides, topic, proxy)


# Fingerprints. Changing these values makes every running component a stranger to every new one.


def test_the_canonical_text_is_what_it_always_was() -> None:
    assert MOVE.text == TEXT


def test_the_fingerprint_is_what_it_always_was() -> None:
    assert MOVE.fingerprint == 0xC4AD9BC7D9C76F45
    assert MOVE.fingerprint == int.from_bytes(hashlib.sha256(TEXT.encode()).digest()[:8], "little")


CHANGES: dict[str, Operation[Any]] = {
    "module": operation(interface="Test2::Base"),
    "interface": operation(interface="Test::Arm"),
    "name": operation(name="moveto"),
    "pattern": operation(pattern=None),
    "another pattern": operation(pattern=Pattern.COMMAND),
    "name of an input": operation(inputs=(Field("route", MOVE.inputs[0].type), MOVE.inputs[1])),
    "order of inputs": operation(inputs=MOVE.inputs[::-1]),
    "fewer inputs": operation(inputs=MOVE.inputs[:1]),
    "an input becomes an output": operation(inputs=MOVE.inputs[:1], outputs=(*MOVE.outputs, MOVE.inputs[1])),
    "width of an output": operation(outputs=(Field("ret", FLOAT64), MOVE.outputs[1])),
    "type of a key": operation(outputs=(MOVE.outputs[0], Field("left", Dictionary(INT32, INT32)))),
    "type of a value": operation(outputs=(MOVE.outputs[0], Field("left", Dictionary(STRING, INT64)))),
    "name of a struct": operation(inputs=(Field("path", Sequence(replace(POINT, name="Test::Spot"))), MOVE.inputs[1])),
    "fields of a struct": operation(
        inputs=(Field("path", Sequence(replace(POINT, fields=POINT.fields[::-1]))), MOVE.inputs[1])
    ),
    "a nested sequence": operation(inputs=(Field("path", Sequence(Sequence(POINT))), MOVE.inputs[1])),
    "value of an enumerator": operation(
        inputs=(MOVE.inputs[0], Field("mode", replace(MODE, members=(("slow", 0), ("fast", 2)))))
    ),
    "name of an enumerator": operation(
        inputs=(MOVE.inputs[0], Field("mode", replace(MODE, members=(("slow", 0), ("quick", 1)))))
    ),
    "no exception": operation(raises=()),
    "another exception": operation(raises=(FAILED,)),
    "one more exception": operation(raises=(STUCK, FAILED)),
    "fields of a base exception": operation(
        raises=(replace(STUCK, base=replace(FAILED, fields=(Field("why", STRING),))),)
    ),
}


@pytest.mark.parametrize("change", CHANGES)
def test_whatever_both_sides_must_agree_on_changes_the_fingerprint(change: str) -> None:
    assert CHANGES[change].fingerprint != MOVE.fingerprint


def test_no_two_of_these_changes_have_the_same_fingerprint() -> None:
    assert len({each.fingerprint for each in CHANGES.values()}) == len(CHANGES)


SAME: dict[str, Operation[Any]] = {
    "idempotent": operation(idempotent=True),
    "documentation": operation(doc="moves", source="void moveTo();"),
    "documentation of a field": operation(inputs=(replace(MOVE.inputs[0], doc="in m"), MOVE.inputs[1])),
    "a default": operation(outputs=(replace(MOVE.outputs[0], default=1.0), MOVE.outputs[1])),
    "the name of an alias": operation(
        inputs=(Field("path", Sequence(POINT, "Test::Path")), MOVE.inputs[1]),
        outputs=(MOVE.outputs[0], Field("left", Dictionary(STRING, INT32, "Test::Left"))),
    ),
    "a python class": operation(inputs=(Field("path", Sequence(replace(POINT, python=object))), MOVE.inputs[1])),
    "the class of an exception": operation(raises=(replace(STUCK, python=ValueError),)),
}


@pytest.mark.parametrize("change", SAME)
def test_what_concerns_one_side_only_does_not(change: str) -> None:
    assert SAME[change].text == MOVE.text
    assert SAME[change].fingerprint == MOVE.fingerprint


# Differences.


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ("module", ["operation: Test::Base.moveTo here, Test2::Base.moveTo there"]),
        ("pattern", ["pattern: query here, unspecified there"]),
        (
            "name of an input",
            [
                "Test::BaseMoveToRequest.path: sequence<Test::Point> here, absent there",
                "Test::BaseMoveToRequest.route: absent here, sequence<Test::Point> there",
            ],
        ),
        ("order of inputs", ["Test::BaseMoveToRequest: path, mode here, mode, path there"]),
        ("width of an output", ["Test::BaseMoveToResponse.ret: float32 here, float64 there"]),
        ("fields of a struct", ["Test::Point: x, y here, y, x there"]),
        ("value of an enumerator", ["Test::Mode.fast: 1 here, 2 there"]),
        ("no exception", ["Test::Stuck: exception here, absent there"]),
        (
            "another exception",
            ["Test::Stuck: exception here, absent there", "Test::Failed: absent here, exception there"],
        ),
        ("one more exception", ["Test::Failed: absent here, exception there"]),
    ],
)
def test_differences_are_named_ours_first(change: str, found: list[str]) -> None:
    assert differences(MOVE.text, CHANGES[change].text) == found


def test_an_exception_without_fields_is_a_difference() -> None:
    quiet, loud = Operation("I", "o"), Operation("I", "o", raises=(ExceptionType("Quiet", ()),))
    assert differences(quiet.text, loud.text) == ["Quiet: absent here, exception there"]


def test_the_order_of_exceptions_is_a_difference() -> None:
    both = operation(raises=(STUCK, FAILED)), operation(raises=(FAILED, STUCK))
    assert both[0].fingerprint != both[1].fingerprint
    assert differences(both[0].text, both[1].text) == ["the order in which they are described"]


@pytest.mark.parametrize("change", CHANGES)
def test_whatever_changes_the_fingerprint_is_a_difference(change: str) -> None:
    found = differences(MOVE.text, CHANGES[change].text)
    assert found
    assert found != differences(CHANGES[change].text, MOVE.text)


@given(st.text(max_size=200), st.text(max_size=200))
def test_whatever_the_other_side_sends_can_be_compared(ours: str, theirs: str) -> None:
    assert differences(ours, theirs)


MAKERS: list[Callable[[], object]] = [lambda: MOVE.request, lambda: MOVE.text, lambda: MOVE.fingerprint]


@pytest.mark.parametrize("make", MAKERS)
def test_what_is_derived_is_derived_once(make: Callable[[], object]) -> None:
    assert make() is make()
