"""The battery of the robot in the arena."""

from __future__ import annotations

import importlib

import pytest

from robocomp_py.testing.components import ComponentTest, load_component

from .conftest import COMPONENTS

SpecificWorker = load_component(COMPONENTS / "arena")

InnerModelManager = importlib.import_module("arena.generic.RoboCompInnerModelManager")


def arena(**parameters: float) -> ComponentTest:
    settings = {f"params.{name}": value for name, value in parameters.items()}
    return ComponentTest(SpecificWorker, settings, virtual=True)


def test_driving_drains_the_battery_and_a_reset_fills_it() -> None:
    with arena(battery=50.0) as component:
        worker = component.worker
        for _ in range(10):
            worker.world.drive("base", ahead=1000.0)
            component.wait_for_computes(2)
        state = component.call("BatteryStatus.getBatteryState")
        used = worker.world.time * 80.7 / 3600 * 100
        assert state.percentage == pytest.approx(50.0 - used, abs=0.2)
        assert state.power == pytest.approx(-80.7, rel=0.15)  # the wheels have noise
        component.call("Simulation.reset", 7)
        state = component.call("BatteryStatus.getBatteryState")
        assert state.percentage == pytest.approx(50.0)
    assert component.fine


def test_the_station_charges_the_battery_until_it_is_full() -> None:
    with arena(battery=95.0) as component:
        near = InnerModelManager.Pose3D(x=800, z=2500)
        component.call("InnerModelManager.setPoseFromParent", "base", near)
        component.wait_for_computes(20)
        state = component.call("BatteryStatus.getBatteryState")
        assert (state.percentage, state.state.name) == (100.0, "Charged")
    assert component.fine


def test_with_an_empty_battery_it_does_not_drive() -> None:
    with arena(battery=0.0) as component:
        world = component.worker.world
        before = world.matrix("base")
        for _ in range(3):
            world.drive("base", ahead=1000.0)
            component.wait_for_computes(3)
        assert (world.matrix("base") == before).all()
    assert component.fine
