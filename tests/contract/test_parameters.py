"""Configurations against their specification: values out, or complaints, all of them."""

from __future__ import annotations

import math
from dataclasses import FrozenInstanceError, dataclass
from typing import Any, ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.contract.parameters import (
    Complaint,
    Parameter,
    ParameterKind,
    ParameterList,
    Parameters,
    ParameterSet,
    build,
    check,
    dotted,
)
from robocomp_py.errors import ConfigurationError
from robocomp_py.spelling import unknown

INT, FLOAT, DOUBLE = ParameterKind.INT, ParameterKind.FLOAT, ParameterKind.DOUBLE
STRING, BOOL, ENUM = ParameterKind.STRING, ParameterKind.BOOL, ParameterKind.ENUM


@dataclass(frozen=True, slots=True)
class Joint(Parameters):
    name: str = "joint"
    limit: float = 1.0

    __spec__: ClassVar[ParameterSet]


Joint.__spec__ = ParameterSet(
    "joints", (Parameter("name", STRING, "joint", mandatory=True), Parameter("limit", DOUBLE, 1.0, 0.0, 3.2)), (), Joint
)


@dataclass(frozen=True, slots=True)
class Arm(Parameters):
    device: str = ""
    rate: int = 50
    speed: float = 0.5
    home: bool = True
    mode: str = "soft"
    joints: tuple[Joint, ...] = (Joint(),)

    __spec__: ClassVar[ParameterSet]


Arm.__spec__ = ParameterSet(
    "Arm",
    (
        Parameter("device", STRING, "", mandatory=True),
        Parameter("rate", INT, 50, 1, 1000),
        Parameter("speed", FLOAT, 0.5, 0.0, 2.0),
        Parameter("home", BOOL, True),
        Parameter("mode", ENUM, "soft", choices=("soft", "hard")),
    ),
    (ParameterList("joints", Joint.__spec__, 1, 2),),
    Arm,
)
GIVEN: dict[str, Any] = {"device": "/dev/arm", "joints": [{"name": "elbow"}]}


def complaints(**changes: Any) -> list[str]:
    """What is said about the good configuration after these changes; None takes a key away."""
    given = {key: value for key, value in {**GIVEN, **changes}.items() if value is not None}
    return [f"{each.path}: {each.message}" for each in check(Arm.__spec__, given)[1]]


def test_what_is_not_given_has_its_default() -> None:
    values, wrong = check(Arm.__spec__, GIVEN)
    assert wrong == []
    assert values == {
        **{"device": "/dev/arm", "rate": 50, "speed": 0.5, "home": True, "mode": "soft"},
        "joints": [{"name": "elbow", "limit": 1.0}],
    }


def test_checked_values_build_the_generated_classes() -> None:
    arm = build(Arm.__spec__, check(Arm.__spec__, GIVEN)[0])
    assert arm == Arm("/dev/arm", joints=(Joint("elbow"),))
    with pytest.raises(FrozenInstanceError):
        arm.rate = 7


def test_a_specification_without_classes_builds_nothing() -> None:
    with pytest.raises(TypeError, match="parameters 'Bare' have no Python class"):
        build(ParameterSet("Bare"), {})


def test_an_integer_is_taken_for_a_float_and_becomes_one() -> None:
    values, wrong = check(Arm.__spec__, {**GIVEN, "speed": 1})
    assert (values["speed"], type(values["speed"]), wrong) == (1.0, float, [])


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("rate", 0, "`rate` is 0; allowed: int, 1 to 1000"),
        ("rate", 1001, "`rate` is 1001; allowed: int, 1 to 1000"),
        ("rate", 5.0, "`rate` is 5.0; allowed: int, 1 to 1000"),
        ("rate", True, "`rate` is True; allowed: int, 1 to 1000"),
        ("rate", "5", "`rate` is '5'; allowed: int, 1 to 1000"),
        ("speed", 2.1, "`speed` is 2.1; allowed: float, 0.0 to 2.0"),
        ("speed", math.nan, "`speed` is nan; allowed: float, 0.0 to 2.0"),
        ("speed", math.inf, "`speed` is inf; allowed: float, 0.0 to 2.0"),
        ("speed", False, "`speed` is False; allowed: float, 0.0 to 2.0"),
        ("speed", [1.0], "`speed` is [1.0]; allowed: float, 0.0 to 2.0"),
        ("home", 1, "`home` is 1; allowed: bool"),
        ("home", "yes", "`home` is 'yes'; allowed: bool"),
        ("device", 3, "`device` is 3; allowed: string"),
        ("mode", "sofd", "`mode` is 'sofd'; allowed: one of soft, hard; did you mean `soft`?"),
        ("mode", "x", "`mode` is 'x'; allowed: one of soft, hard"),
        ("mode", 1, "`mode` is 1; allowed: one of soft, hard"),
        ("device", None, "`device` is mandatory: give it (string)"),
        ("sped", 1, "unknown parameter `sped`; did you mean `speed`?"),
        ("xyz", 1, "unknown parameter `xyz`; known: device, rate, speed, home, mode, joints"),
        ("joints", [], "0 items of `joints`; allowed: 1 to 2"),
        ("joints", None, "0 items of `joints`; allowed: 1 to 2"),
        ("joints", [{"name": "a"}] * 3, "3 items of `joints`; allowed: 1 to 2"),
        ("joints", {"name": "a"}, "`joints` is a list: write its items as tables, each under [[params.joints]]"),
        ("joints", ["a"], "`joints` is a list: write its items as tables, each under [[params.joints]]"),
    ],
)
def test_what_is_wrong_is_said_with_what_is_allowed(key: str, value: Any, message: str) -> None:
    assert complaints(**{key: value}) == [f"{key}: {message}"]


def test_items_of_lists_are_checked_and_named() -> None:
    assert complaints(joints=[{"name": "a", "limit": 4}, {"nam": "b"}]) == [
        "joints[0].limit: `limit` is 4; allowed: float, 0.0 to 3.2",
        "joints[1].nam: unknown parameter `nam`; did you mean `name`?",
        "joints[1].name: `name` is mandatory: give it (string)",
    ]


def test_all_complaints_come_at_once_and_what_is_wrong_has_its_default() -> None:
    values, wrong = check(Arm.__spec__, {"rate": -1, "speed": "fast", "mode": "x", "foo": 1})
    assert [each.path for each in wrong] == ["foo", "device", "rate", "speed", "mode", "joints"]
    assert (values["rate"], values["speed"], values["mode"]) == (50, 0.5, "soft")


def test_a_list_may_be_without_an_upper_bound() -> None:
    motors = ParameterList("motors", Joint.__spec__, 2)
    assert motors.count(10**6, ()) == []
    [complaint] = motors.count(1, ("motors",))
    assert complaint == Complaint(("motors",), "1 items of `motors`; allowed: 2 to any number", "config-item-count")


def test_an_integer_too_large_for_a_float_is_a_complaint() -> None:
    _, wrong = check(ParameterSet("P", (Parameter("x", DOUBLE, 0.0),)), {"x": 10**400})
    assert [each.path for each in wrong] == ["x"]


Anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["name", "limit", "x"]), inner),
)


@given(st.dictionaries(st.sampled_from([*GIVEN, "rate", "speed", "home", "mode", "foo"]), Anything))
def test_whatever_is_given_there_are_complaints_or_parameters(given: dict[str, Any]) -> None:
    values, wrong = check(Arm.__spec__, given)
    if not wrong:
        assert isinstance(build(Arm.__spec__, values), Arm)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"rate": 0}, "rate: `rate` is 0; allowed: int, 1 to 1000"),
        ({"mode": "x"}, "mode: `mode` is 'x'; allowed: one of soft, hard"),
        ({"joints": ()}, "joints: 0 items of `joints`; allowed: 1 to 2"),
        ({"rate": 0, "home": 1}, "rate: .*\nhome: `home` is 1; allowed: bool"),
    ],
)
def test_parameters_that_are_not_allowed_cannot_be_made(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        Arm(**wrong)
    with pytest.raises(ConfigurationError):
        Joint(limit=-1.0)


def test_keys_are_written_as_in_python() -> None:
    assert dotted(("motors", 0, "limits", 2, "max")) == "motors[0].limits[2].max"
    assert dotted(()) == ""


def test_nothing_known_is_said_to_be_so() -> None:
    assert unknown("preset", "x", ()) == "unknown preset `x`; known: none"
