# Generated from handover.cdsl by rcgen 0.1.0: edits are lost.
"""Types of the fakes for tests of handover with ComponentTest: by port, then by
operation.
"""

from __future__ import annotations

from typing import TypedDict

from robocomp_py.testing.fakes import Fake

from . import RoboCompInnerModelManager, RoboCompSimulation


class ArmFakes(TypedDict, total=False):
    """Fakes for the peer of `arm`."""

    move: Fake[None]
    rest: Fake[None]
    isThere: Fake[bool]


class Arm1Fakes(TypedDict, total=False):
    """Fakes for the peer of `arm1`."""

    move: Fake[None]
    rest: Fake[None]
    isThere: Fake[bool]


class SimulationFakes(TypedDict, total=False):
    """Fakes for the peer of `simulation`."""

    now: Fake[RoboCompSimulation.Moment]
    step: Fake[RoboCompSimulation.Moment]
    pause: Fake[None]
    resume: Fake[None]
    setSpeed: Fake[None]
    reset: Fake[None]
    setPhysics: Fake[None]
    setNoise: Fake[None]
    scene: Fake[str]
    cloud: Fake[RoboCompSimulation.Cloud]
    poses: Fake[RoboCompSimulation.PoseList]
    contacts: Fake[RoboCompSimulation.ContactList]
    attach: Fake[str]
    detach: Fake[None]
    save: Fake[int]
    restore: Fake[None]
    evaluate: Fake[RoboCompSimulation.OutcomeList]


class InnerModelManagerFakes(TypedDict, total=False):
    """Fakes for the peer of `innermodelmanager`."""

    addTransform: Fake[bool]
    addJoint: Fake[bool]
    addMesh: Fake[bool]
    addPlane: Fake[bool]
    getAllNodeInformation: Fake[RoboCompInnerModelManager.NodeInformationSequence]
    setPose: Fake[bool]
    setPoseFromParent: Fake[bool]
    getPose: Fake[tuple[bool, RoboCompInnerModelManager.Pose3D]]
    getPoseFromParent: Fake[tuple[bool, RoboCompInnerModelManager.Pose3D]]
    setPlane: Fake[bool]
    transform: Fake[tuple[bool, RoboCompInnerModelManager.coord3D]]
    getTransformationMatrix: Fake[RoboCompInnerModelManager.Matrix]
    setScale: Fake[bool]
    addAttribute: Fake[bool]
    removeAttribute: Fake[bool]
    setAttribute: Fake[bool]
    getAttribute: Fake[tuple[bool, str, str]]
    removeNode: Fake[bool]
    moveNode: Fake[bool]
    collide: Fake[bool]
    setPointCloudData: Fake[None]


class Fakes(TypedDict, total=False):
    """Fakes for the peers of all ports."""

    arm: ArmFakes
    arm1: Arm1Fakes
    simulation: SimulationFakes
    innermodelmanager: InnerModelManagerFakes
