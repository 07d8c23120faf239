# Generated from sorter.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of sorter, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from robocomp_py.runtime.api import Component, Port, Verb, Worker

from . import RoboCompArm, RoboCompInnerModelManager, RoboCompSimulation
from .params import PARAMS, Params


class GenericWorker(Worker[Params]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "sorter",
        ports=(
            Port(Verb.REQUIRES, RoboCompArm.ARM_INTERFACE, proxy=RoboCompArm.ArmProxy),
            Port(
                Verb.REQUIRES,
                RoboCompArm.ARM_INTERFACE,
                number="1",
                proxy=RoboCompArm.ArmProxy,
            ),
            Port(
                Verb.REQUIRES,
                RoboCompSimulation.SIMULATION_INTERFACE,
                proxy=RoboCompSimulation.SimulationProxy,
            ),
            Port(
                Verb.REQUIRES,
                RoboCompInnerModelManager.INNERMODELMANAGER_INTERFACE,
                proxy=RoboCompInnerModelManager.InnerModelManagerProxy,
            ),
        ),
        params=PARAMS,
        period=0.05,
        description="Takes parts from a conveyor by two arms.",
    )
    middleware = "auto"

    arm_proxy: RoboCompArm.ArmProxy
    arm1_proxy: RoboCompArm.ArmProxy
    simulation_proxy: RoboCompSimulation.SimulationProxy
    innermodelmanager_proxy: RoboCompInnerModelManager.InnerModelManagerProxy
