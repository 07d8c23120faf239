"""Runs arm in this process, with fakes for its peers."""

from __future__ import annotations

from pathlib import Path

from robocomp_py.testing.components import ComponentTest, load_component, stand_ins

SpecificWorker = load_component(Path(__file__).parents[1])


def test_arm_starts_computes_and_stops() -> None:
    with ComponentTest(SpecificWorker, stand_ins(SpecificWorker)) as component:
        component.wait_for_computes(3)
    assert component.fine
