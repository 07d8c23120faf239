"""Names of channels: made, resolved, matched."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.wire.names import ANY, channel, is_namespace, is_segment, matches, resolve

SEGMENTS = st.from_regex(r"[A-Za-z_][A-Za-z0-9_-]{0,8}", fullmatch=True)
NAMESPACES = st.lists(SEGMENTS, max_size=3).map("/".join)


@pytest.mark.parametrize(
    ("namespace", "expected"),
    [
        ("", "world/Laser/getLaserData"),
        ("/", "world/Laser/getLaserData"),
        ("robot1", "robot1/world/Laser/getLaserData"),
        ("/lab/robot1/", "lab/robot1/world/Laser/getLaserData"),
    ],
)
def test_a_channel_is_namespace_instance_interface_operation(namespace: str, expected: str) -> None:
    assert channel(namespace, "world", "Laser", "getLaserData") == expected


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        ("", ("home", ANY, "Laser")),
        ("world", ("home", "world", "Laser")),
        ("world/Laser1", ("home", "world", "Laser1")),
        ("world/", ("home", "world", "Laser")),
        ("/world/Laser1", ("", "world", "Laser1")),
        ("/robot2/world/Laser1", ("robot2", "world", "Laser1")),
        ("/lab/robot2/world/Laser1", ("lab/robot2", "world", "Laser1")),
    ],
)
def test_a_target_names_what_differs_from_the_own_namespace_and_interface(
    target: str, expected: tuple[str, str, str]
) -> None:
    assert resolve(target, "home", "Laser") == expected


@pytest.mark.parametrize(
    ("target", "complaint"),
    [
        ("/", "names no instance"),
        ("//", "names no instance"),
        ("a//b", "names no instance"),
        ("*", "names no instance"),
        ("wörld", "names no instance"),
        ("1st", "names no instance"),
        ("wor ld", "names no instance"),
        ("world\n", "names no instance"),
        ("/world", "lacks a part"),
        ("robot2/world/Laser", "begins with `/`"),
    ],
)
def test_a_target_that_names_nothing_is_refused_with_what_to_write(target: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        resolve(target, "home", "Laser")


@given(NAMESPACES, SEGMENTS, SEGMENTS)
def test_every_port_has_an_absolute_target(namespace: str, instance: str, interface: str) -> None:
    target = f"/{namespace}/{instance}/{interface}" if namespace else f"/{instance}/{interface}"
    assert resolve(target, "home", "Other") == (namespace, instance, interface)


@given(NAMESPACES, SEGMENTS, SEGMENTS, SEGMENTS)
def test_a_channel_matches_itself_and_any_instance(namespace: str, instance: str, interface: str, op: str) -> None:
    name = channel(namespace, instance, interface, op)
    assert matches(name, name)
    assert matches(channel(namespace, ANY, interface, op), name)


@pytest.mark.parametrize(
    ("pattern", "name"),
    [
        ("a/Laser/get", "b/Laser/get"),
        ("a/Laser/get", "a/Laser/getAll"),
        ("*/Laser/get", "a/Laser/set"),
        ("*/Laser/get", "a/Laser1/get"),
        ("*/Laser/get", "robot1/a/Laser/get"),
        ("robot1/*/Laser/get", "a/Laser/get"),
        ("robot1/*/Laser/get", "robot2/a/Laser/get"),
        ("*/Laser/get", ""),
    ],
)
def test_other_channels_do_not_match(pattern: str, name: str) -> None:
    assert not matches(pattern, name)


@pytest.mark.parametrize("text", ["world", "World_2", "_x", "front-left", "a1"])
def test_segments_are_identifiers_that_may_have_dashes(text: str) -> None:
    assert is_segment(text)
    assert is_namespace(text)


@pytest.mark.parametrize("text", ["", "1a", "-a", "a/b", "a b", "*", "ä", "a\n", "a.b"])
def test_nothing_else_is_a_segment(text: str) -> None:
    assert not is_segment(text)


@pytest.mark.parametrize("text", ["", "robot1", "/robot1", "lab/robot1/"])
def test_a_namespace_has_any_number_of_segments(text: str) -> None:
    assert is_namespace(text)


@pytest.mark.parametrize("text", ["/", "a//b", "*", "a/1", "a b"])
def test_all_of_which_are_segments(text: str) -> None:
    assert not is_namespace(text)
