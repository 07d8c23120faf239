from __future__ import annotations

import math

import pytest
from camera.generic.RoboCompCameraSimple import HardwareFailedException
from camera.generic.RoboCompGenericBase import TBaseState
from camera.specificworker import SpecificWorker

from robocomp_py.testing.components import ComponentTest

SMALL = {"component.period": 0.002, "params.width": 32, "params.height": 24}
POSE = TBaseState(correctedX=600.0, correctedZ=4200.0)
IMAGE = "camerasimplepub.pushImage"


def test_without_a_pose_there_is_no_picture() -> None:
    with ComponentTest(SpecificWorker, SMALL, virtual=True) as component:
        component.wait_for_computes(3)
        with pytest.raises(HardwareFailedException, match="no picture yet"):
            component.call("CameraSimple.getImage")
    assert component.fine
    assert not component.received(IMAGE)


def test_every_compute_shows_a_picture() -> None:
    with ComponentTest(SpecificWorker, SMALL, virtual=True) as component:
        component.send("DifferentialRobotPub.pushBaseState", POSE)
        component.wait_for(lambda: len(component.received(IMAGE)) >= 3)
    (image,) = component.received(IMAGE)[-1]
    assert (image.compressed, image.width, image.height, image.depth) == (False, 32, 24, 3)
    assert len(image.image) == 32 * 24 * 3


def test_callers_get_the_newest_picture() -> None:
    with ComponentTest(SpecificWorker, SMALL, virtual=True) as component:
        component.send("DifferentialRobotPub.pushBaseState", POSE)
        component.wait_for(lambda: component.received(IMAGE))
        image = component.call("CameraSimple.getImage")
    assert bytes(image.image) == bytes(component.received(IMAGE)[-1][0].image)


def test_another_pose_gives_another_picture() -> None:
    with ComponentTest(SpecificWorker, SMALL, virtual=True) as component:
        component.send("DifferentialRobotPub.pushBaseState", POSE)
        component.wait_for(lambda: component.received(IMAGE))
        first = bytes(component.received(IMAGE)[0][0].image)
        component.send("DifferentialRobotPub.pushBaseState", TBaseState(correctedX=6000.0, correctedZ=1500.0))
        component.wait_for(lambda: bytes(component.received(IMAGE)[-1][0].image) != first)


@pytest.mark.parametrize("field", ["correctedX", "correctedZ", "correctedAlpha"])
@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_an_impossible_pose_is_ignored(field: str, wrong: float) -> None:
    with ComponentTest(SpecificWorker, SMALL, virtual=True) as component:
        component.send("DifferentialRobotPub.pushBaseState", TBaseState(**{field: wrong}))
        component.wait_for_computes(3)
        assert not component.received(IMAGE)
        component.send("DifferentialRobotPub.pushBaseState", POSE)
        component.wait_for(lambda: component.received(IMAGE))
        component.send("DifferentialRobotPub.pushBaseState", TBaseState(**{field: wrong}))
        component.wait_for_computes(3)
        (first,), (last,) = component.received(IMAGE)[0], component.received(IMAGE)[-1]
    assert component.fine
    assert bytes(last.image) == bytes(first.image)
