"""Ports: what they are called in the worker, in the settings and on the wire."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.contract.component import TAKEN, Component, Port, numbers
from robocomp_py.contract.interface import Interface, Verb
from robocomp_py.runtime.worker import Worker

LASER = Interface("RoboCompLaser::Laser", ())


@pytest.mark.parametrize(
    ("verb", "number", "name", "label"),
    [
        (Verb.REQUIRES, "", "laser", "Laser"),
        (Verb.REQUIRES, "1", "laser1", "Laser1"),
        (Verb.PUBLISHES, "2", "laser2", "Laser2"),
        (Verb.IMPLEMENTS, "", "Laser", "Laser"),
        (Verb.SUBSCRIBES, "1", "Laser1", "Laser1"),
    ],
)
def test_a_port_is_named_after_its_interface_and_number(verb: Verb, number: str, name: str, label: str) -> None:
    port = Port(verb, LASER, number)
    assert (port.name, port.label) == (name, label)


def test_user_code_finds_proxies_and_handlers_under_these_names() -> None:
    assert Port(Verb.REQUIRES, LASER, "1").attribute == "laser1_proxy"
    assert Port(Verb.IMPLEMENTS, LASER, "1").handler("getLaserData") == "Laser1_getLaserData"


REQUIRES, IMPLEMENTS, PUBLISHES, SUBSCRIBES = Verb.REQUIRES, Verb.IMPLEMENTS, Verb.PUBLISHES, Verb.SUBSCRIBES


@pytest.mark.parametrize(
    ("uses", "expected"),
    [
        ([], []),
        ([(REQUIRES, "Laser")], [""]),
        ([(REQUIRES, "Laser"), (REQUIRES, "Laser"), (REQUIRES, "Laser")], ["", "1", "2"]),
        ([(REQUIRES, "Laser"), (REQUIRES, "Bumper"), (REQUIRES, "Laser")], ["", "", "1"]),
        ([(REQUIRES, "Laser"), (PUBLISHES, "Laser")], ["", "1"]),
        ([(IMPLEMENTS, "Laser"), (SUBSCRIBES, "Laser")], ["", "1"]),
        ([(REQUIRES, "Laser"), (IMPLEMENTS, "Laser"), (PUBLISHES, "Laser"), (SUBSCRIBES, "Laser")], ["", "", "1", "1"]),
        ([(REQUIRES, "Laser"), (REQUIRES, "LASER")], ["", "1"]),
        ([(IMPLEMENTS, "Laser"), (IMPLEMENTS, "LASER")], ["", ""]),
    ],
)
def test_proxies_are_numbered_together_and_so_are_handlers(uses: list[tuple[Verb, str]], expected: list[str]) -> None:
    assert numbers(uses) == expected


@given(st.lists(st.tuples(st.sampled_from(Verb), st.sampled_from(["Laser", "laser", "Bumper", "LaserPub"]))))
def test_no_two_ports_have_the_same_attribute_or_the_same_handlers(uses: list[tuple[Verb, str]]) -> None:
    ports = list(_ports(uses))
    attributes = [port.attribute for port in ports if port.verb.has_proxy]
    handlers = [port.handler("stop") for port in ports if not port.verb.has_proxy]
    assert len(set(attributes)) == len(attributes)
    assert len(set(handlers)) == len(handlers)


@pytest.mark.parametrize("uses", [[(REQUIRES, "Note"), (PUBLISHES, "Note")], [(PUBLISHES, "Note"), (REQUIRES, "Note")]])
def test_what_is_published_is_found_whatever_else_is_said_of_it(uses: list[tuple[Verb, str]]) -> None:
    component = Component("a", tuple(_ports(uses)))
    (published,) = (port for port in component.ports if port.verb is PUBLISHES)
    assert component.segment(published) == "Note"


def test_two_ports_of_one_interface_have_different_channels() -> None:
    uses = [(SUBSCRIBES, "Note"), (IMPLEMENTS, "Note"), (IMPLEMENTS, "Pad"), (IMPLEMENTS, "Note"), (IMPLEMENTS, "Note")]
    component = Component("a", tuple(_ports(uses)))
    offered = [component.segment(port) for port in component.ports if port.verb is IMPLEMENTS]
    assert offered == ["Note", "Pad", "Note1", "Note2"]


def _ports(uses: list[tuple[Verb, str]]) -> Iterator[Port]:
    for (verb, interface), number in zip(uses, numbers(uses), strict=True):
        yield Port(verb, Interface(f"Test::{interface}", ()), number)


def test_no_handler_is_called_like_something_that_every_worker_has() -> None:
    """Names of the form `Interface_operation`; those with two underscores in front are no names of models."""
    names = {*dir(Worker), *Worker.__annotations__, *vars(Worker)}
    assert {name for name in names if re.fullmatch(r"(?!__)\w+_\w+", name)} <= TAKEN
