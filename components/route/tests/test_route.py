"""Runs route in this process, with fakes for what it is connected to."""

from __future__ import annotations

from pathlib import Path

from robocomp_py.testing.components import ComponentTest, load_component

SpecificWorker = load_component(Path(__file__).parents[1])


def test_route_starts_computes_and_stops() -> None:
    with ComponentTest(SpecificWorker, virtual=True) as component:
        component.wait_for_computes(3)
    assert component.fine
