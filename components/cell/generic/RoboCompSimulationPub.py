# Generated from SimulationPub.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompSimulationPub: types, interfaces and proxies."""

from __future__ import annotations

from robocomp_py.runtime.api import Field, Interface, Operation, Proxy, Sequence

from . import RoboCompSimulation

_SimulationPub_advanced: Operation[None] = Operation(
    "RoboCompSimulationPub::SimulationPub",
    "advanced",
    inputs=(
        Field("at", RoboCompSimulation.Moment.__contract__),
        Field("moved", Sequence(RoboCompSimulation.NodePose.__contract__)),
    ),
    doc="How far it is, and the poses of nodes that have moved since the message before.",  # noqa: E501, RUF100
)
SIMULATIONPUB_INTERFACE = Interface(
    "RoboCompSimulationPub::SimulationPub",
    (_SimulationPub_advanced,),
)


class SimulationPubPublisher(Proxy):
    """Publishes SimulationPub. A call waits only if its QoS is reliable."""

    interface = SIMULATIONPUB_INTERFACE

    def advanced(
        self,
        at: RoboCompSimulation.Moment,
        moved: RoboCompSimulation.PoseList,
        *,
        deadline: float | None = None,
    ) -> None:
        """How far it is, and the poses of nodes that have moved since the message
        before.

        IDSL: void advanced(RoboCompSimulation::Moment at, RoboCompSimulation::PoseList
        moved)
        """
        self._send(_SimulationPub_advanced, (at, moved), deadline)
