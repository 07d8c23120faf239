"""Operations are made from what other processes announce."""

from __future__ import annotations

import pytest
from hypothesis import given

from robocomp_py.contract import told
from robocomp_py.contract.interface import Operation
from robocomp_py.contract.types import INT32, STRING, ExceptionType, Field, Struct
from robocomp_py.testing import everything as e
from robocomp_py.testing.actions import GO_TO

from ..wire.messages import message_types, patiently


@pytest.mark.parametrize("operation", e.EVERYTHING.operations, ids=lambda each: each.name)
def test_an_operation_comes_back_from_its_text(operation: Operation[object]) -> None:
    found = told.operation(operation.text)
    assert found.fingerprint == operation.fingerprint
    assert (found.interface, found.name, found.pattern) == (operation.interface, operation.name, operation.pattern)
    assert [each.name for each in found.raises] == [each.name for each in operation.raises]


def test_with_what_its_text_does_not_say_an_operation_is_whole_again() -> None:
    base = ExceptionType("M::Base", (Field("what", STRING),))
    middle = ExceptionType("M::Middle", (Field("place", STRING),), base)
    kinds = (ExceptionType("M::Last", (Field("number", INT32),), middle), middle, base)
    operation: Operation[object] = Operation("M::I", "do", raises=kinds, idempotent=True, confirm=True)
    found = told.completed(told.operation(operation.text), told.supplement(operation))
    assert (found.raises, found.idempotent, found.confirm) == (kinds, True, True)
    assert found.fingerprint == operation.fingerprint


@patiently
@given(message_types())
def test_any_types_come_back(message: Struct) -> None:
    operation: Operation[object] = Operation("Any::Thing", "do", message.fields, message.fields)
    assert told.operation(operation.text).fingerprint == operation.fingerprint


GOOD = "\n".join(
    (
        "operation M::I.do",
        "pattern query",
        "struct M::IDoRequest",
        "  x M::P",
        "struct M::IDoResponse",
        "struct M::P",
        "  x float64",
    )
)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "is missing|IndexError|not enough"),
        ("operation", "operation is missing|not enough"),
        ("nonsense " * 9000, "81000 characters; at most 65536 are read"),
        (GOOD.replace("M::I.do", "M::I.\x1b[31m"), "is no name"),
        (GOOD.replace("pattern query", "pattern shout"), "shout"),
        (GOOD.replace("struct M::IDoResponse\n", ""), "KeyError|its own parts"),
        (GOOD.replace("  x float64", "  x float80"), "struct float80"),
        (GOOD.replace("  x float64", "  x M::P"), "nested more than 32 deep"),
        (GOOD.replace("  x float64", "  x " + "sequence<" * 40 + "bool" + ">" * 40), "nested more than 32 deep"),
        (GOOD.replace("  x float64", "  x dictionary<float64,bool>"), "is no key"),
        (GOOD.replace("  x float64", "  x records<string>"), "not a flat struct"),
        (GOOD + "\nstruct M::Unused", "its own parts"),
        (GOOD + "\n", "its own parts|no name"),
    ],
)
def test_what_is_no_contract_is_refused(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        told.operation(text)


def test_the_parts_of_an_action_come_back() -> None:
    """Their names have a hyphen."""
    for part in GO_TO.parts:
        assert told.operation(part.text).fingerprint == part.fingerprint


def test_the_good_one_is_good() -> None:
    assert told.operation(GOOD).name == "do"


@pytest.mark.parametrize("part", GO_TO.parts, ids=lambda part: part.name)
def test_the_parts_of_actions_come_back(part: Operation[object]) -> None:
    assert told.operation(part.text).name == part.name
