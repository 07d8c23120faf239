from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from rescue.generic.RoboCompBatteryStatus import TBattery
from rescue.generic.RoboCompCameraSimple import TImage
from rescue.generic.RoboCompGenericBase import HardwareFailedException, TBaseState
from rescue.specificworker import SpecificWorker

from robocomp_py.testing.components import ComponentTest

FAST = {"component.period": 0.002}
GO = "gotopoint.go"


class World:
    """What the mission meets."""

    def __init__(self) -> None:
        self.arrived = False
        self.speaking = False
        self.can_speak = True
        self.fails = False
        self.component = ComponentTest(
            SpecificWorker,
            FAST,
            gotopoint={"atTarget": lambda: self.arrived},
            speech={"say": lambda *_: self.can_speak, "isBusy": lambda: self.speaking},
            differentialrobot={"stopBase": self.stop},
            virtual=True,
        )

    def stop(self) -> None:
        if self.fails:
            raise HardwareFailedException("the motor is too hot")

    def show(self, red_px: int = 0) -> None:
        pixels = np.full((120, 160, 3), 180, np.uint8)
        pixels[:red_px, 70:90] = (200, 30, 40)
        self.component.send("CameraSimplePub.pushImage", TImage(False, 160, 120, 3, pixels.ravel()))

    def charge(self, percent: float) -> None:
        self.component.send("BatteryStatusPub.pushBatteryState", TBattery(percentage=percent))

    def place(self, x: float, z: float) -> None:
        self.component.send("DifferentialRobotPub.pushBaseState", TBaseState(correctedX=x, correctedZ=z))

    def begin(self) -> None:
        self.show()
        self.charge(60.0)
        self.place(1500.0, 2500.0)
        self.wait_for_calls(GO, 1)

    def calls(self, operation: str) -> list[tuple[Any, ...]]:
        return self.component.received(operation)

    def wait_for_calls(self, operation: str, number: int) -> None:
        self.component.wait_for(lambda: len(self.calls(operation)) >= number)


@contextmanager
def mission() -> Iterator[World]:
    world = World()
    with world.component:
        yield world


def test_it_does_not_start_before_every_sensor_has_sent_something() -> None:
    with mission() as world:
        world.show()
        world.charge(60.0)
        world.component.wait_for_computes(5)
        assert not world.calls(GO)
        world.place(0.0, 0.0)
        world.wait_for_calls(GO, 1)
    assert world.component.fine
    assert world.calls(GO)[0][0] == "anywhere"


def test_with_a_low_battery_it_goes_to_the_charger_and_then_explores_on() -> None:
    with mission() as world:
        world.begin()
        world.charge(29.0)
        world.wait_for_calls(GO, 2)
        world.arrived = True
        world.charge(50.0)
        world.component.wait_for_computes(5)
        assert len(world.calls(GO)) == 2
        world.charge(96.0)
        world.wait_for_calls(GO, 3)
    assert [call[0] for call in world.calls(GO)] == ["anywhere", "charger", "anywhere"]
    assert world.calls(GO)[1][1:] == pytest.approx((800.0, 2600.0, 3.14))


def test_a_battery_that_is_not_low_does_not_disturb_it() -> None:
    with mission() as world:
        world.begin()
        world.charge(31.0)
        world.component.wait_for_computes(5)
    assert len(world.calls(GO)) == 1


def test_a_person_nearby_ends_the_search() -> None:
    with mission() as world:
        world.begin()
        world.show(red_px=80)
        world.component.wait_for(lambda: world.component.worker.state == "ended")
    assert world.component.fine
    assert world.calls("gotopoint.stop")
    assert world.calls("differentialrobot.stopBase")
    ((text, overwrite),) = world.calls("speech.say")
    assert "1.5, 2.5" in text
    assert overwrite


def test_a_person_far_away_does_not() -> None:
    with mission() as world:
        world.begin()
        world.show(red_px=20)
        world.component.wait_for_computes(5)
    assert not world.calls("speech.say")


def test_a_person_nearby_counts_on_the_way_to_the_charger_too() -> None:
    with mission() as world:
        world.begin()
        world.charge(20.0)
        world.wait_for_calls(GO, 2)
        world.show(red_px=80)
        world.component.wait_for(lambda: world.calls("speech.say"))


def test_it_does_not_end_before_everything_was_said() -> None:
    with mission() as world:
        world.begin()
        world.speaking = True
        world.show(red_px=80)
        world.wait_for_calls("speech.isBusy", 3)
        assert world.component.worker.state == "compute"
        world.speaking = False
        world.component.wait_for(lambda: world.component.worker.state == "ended")


def test_an_empty_battery_fails_the_mission(caplog: pytest.LogCaptureFixture) -> None:
    with mission() as world:
        world.begin()
        world.charge(0.0)
        world.component.wait_for(lambda: world.component.worker.state == "ended")
    assert not world.component.fine
    assert "the battery is empty" in caplog.text


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_numbers_that_were_not_measured_are_ignored(wrong: float) -> None:
    with mission() as world:
        world.show(red_px=80)
        world.charge(wrong)
        world.place(wrong, 0.0)
        world.component.wait_for_computes(3)
        assert not world.calls(GO)
        world.charge(60.0)
        world.place(1500.0, 2500.0)
        world.charge(wrong)
        world.place(0.0, wrong)
        world.component.wait_for(lambda: world.calls("speech.say"))
    assert "1.5, 2.5" in world.calls("speech.say")[0][0]
    assert world.component.fine


def test_it_tells_its_story(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO), mission() as world:
        world.begin()
        world.charge(24.0)
        world.wait_for_calls(GO, 2)
    assert "battery low (24 %): going to the charging station" in caplog.messages


def test_a_base_that_fails_does_not_end_the_mission(caplog: pytest.LogCaptureFixture) -> None:
    with mission() as world:
        world.begin()
        world.fails, world.can_speak = True, False
        world.show(red_px=80)
        world.wait_for_calls("differentialrobot.stopBase", 3)
        world.can_speak = True
        world.component.wait_for(lambda: world.component.worker.state == "ended")
    assert world.component.fine
    assert caplog.text.count("the base fails: ") == 1
