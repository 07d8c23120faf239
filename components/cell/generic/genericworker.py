# Generated from cell.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of cell, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from abc import abstractmethod

from robocomp_py.runtime.api import Component, Port, QoS, Verb, Worker
from robocomp_py.runtime.instances import InstanceHandler, NamedHandlers, NamedProxies

from . import (
    RoboCompInnerModelManager,
    RoboCompJointMotor,
    RoboCompJointMotorPub,
    RoboCompSimulation,
    RoboCompSimulationPub,
)
from .params import PARAMS, Params


class JointMotorHandler(InstanceHandler):
    """Answers for one `JointMotor`. Derive a class from it, and add an object of it:
    self.jointmotor.add(name, handler).
    """

    @abstractmethod
    def setPosition(self, goal: RoboCompJointMotor.MotorGoalPosition) -> None:
        """Move a motor to a position, and hold it there.

        IDSL: void setPosition(MotorGoalPosition goal) throws UnknownMotorException,
        HardwareFailedException, CollisionException
        """

    @abstractmethod
    def setVelocity(self, goal: RoboCompJointMotor.MotorGoalVelocity) -> None:
        """Move a motor at a speed until it is told otherwise, or reaches an end.

        IDSL: void setVelocity(MotorGoalVelocity goal) throws UnknownMotorException,
        HardwareFailedException
        """

    @abstractmethod
    def setZeroPos(self, name: str) -> None:
        """Move a motor to its zero position.

        IDSL: void setZeroPos(string name) throws UnknownMotorException,
        HardwareFailedException
        """

    @abstractmethod
    def setSyncPosition(
        self,
        listGoals: RoboCompJointMotor.MotorGoalPositionList,
    ) -> None:
        """Move several motors to positions. They start together, or none of them does.

        IDSL: void setSyncPosition(MotorGoalPositionList listGoals) throws
        UnknownMotorException, HardwareFailedException
        """

    @abstractmethod
    def setSyncVelocity(
        self,
        listGoals: RoboCompJointMotor.MotorGoalVelocityList,
    ) -> None:
        """Move several motors at speeds. They start together, or none of them does.

        IDSL: void setSyncVelocity(MotorGoalVelocityList listGoals) throws
        UnknownMotorException, HardwareFailedException
        """

    @abstractmethod
    def setSyncZeroPos(self) -> None:
        """Move all motors to their zero positions.

        IDSL: void setSyncZeroPos() throws UnknownMotorException,
        HardwareFailedException
        """

    @abstractmethod
    def getMotorParams(self, motor: str) -> RoboCompJointMotor.MotorParams:
        """How a motor is built and set.

        IDSL: MotorParams getMotorParams(string motor) throws UnknownMotorException
        """

    @abstractmethod
    def getMotorState(self, motor: str) -> RoboCompJointMotor.MotorState:
        """What a motor does now.

        IDSL: MotorState getMotorState(string motor) throws UnknownMotorException
        """

    @abstractmethod
    def getMotorStateMap(
        self,
        mList: RoboCompJointMotor.MotorList,
    ) -> RoboCompJointMotor.MotorStateMap:
        """What the motors of a list do now.

        IDSL: MotorStateMap getMotorStateMap(MotorList mList) throws
        UnknownMotorException
        """

    @abstractmethod
    def getAllMotorState(self) -> RoboCompJointMotor.MotorStateMap:
        """What all motors do now.

        IDSL: void getAllMotorState(out MotorStateMap mstateMap) throws
        UnknownMotorException
        """

    @abstractmethod
    def getAllMotorParams(self) -> RoboCompJointMotor.MotorParamsList:
        """How all motors are built and set.

        IDSL: MotorParamsList getAllMotorParams()
        """

    @abstractmethod
    def getBusParams(self) -> RoboCompJointMotor.BusParams:
        """How the bus is set.

        IDSL: BusParams getBusParams()
        """


class GenericWorker(Worker[Params]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "cell",
        ports=(
            Port(Verb.IMPLEMENTS, RoboCompJointMotor.JOINTMOTOR_INTERFACE, each=True),
            Port(Verb.IMPLEMENTS, RoboCompSimulation.SIMULATION_INTERFACE),
            Port(
                Verb.IMPLEMENTS,
                RoboCompInnerModelManager.INNERMODELMANAGER_INTERFACE,
            ),
            Port(
                Verb.PUBLISHES,
                RoboCompJointMotorPub.JOINTMOTORPUB_INTERFACE,
                each=True,
                proxy=RoboCompJointMotorPub.JointMotorPubPublisher,
            ),
            Port(
                Verb.PUBLISHES,
                RoboCompSimulationPub.SIMULATIONPUB_INTERFACE,
                qos=QoS(depth=5),
                proxy=RoboCompSimulationPub.SimulationPubPublisher,
            ),
        ),
        params=PARAMS,
        period=0.05,
        description=(
            "Simulates two arms at a conveyor (belt.xml), or at a table "
            "(table.xml): all joints of an arm are a named instance."
        ),
    )
    middleware = "auto"

    simulationpub_proxy: RoboCompSimulationPub.SimulationPubPublisher

    jointmotor: NamedHandlers[JointMotorHandler]
    jointmotorpub: NamedProxies[RoboCompJointMotorPub.JointMotorPubPublisher]

    @abstractmethod
    def Simulation_now(self) -> RoboCompSimulation.Moment:
        """How far it is.

        IDSL: idempotent Moment now()
        """

    @abstractmethod
    def Simulation_step(self, count: int) -> RoboCompSimulation.Moment:
        """Go on by a number of ticks at once, whether it is paused or not: at most
        20000 in one call.

        IDSL: Moment step(int count) throws SimulationException
        """

    @abstractmethod
    def Simulation_pause(self) -> None:
        """Stand still. Sensors and motors answer meanwhile, and goals wait.

        IDSL: idempotent void pause()
        """

    @abstractmethod
    def Simulation_resume(self) -> None:
        """Go on after a pause.

        IDSL: idempotent void resume()
        """

    @abstractmethod
    def Simulation_setSpeed(self, factor: float) -> None:
        """Go on at this factor of the component's clock: 2 is twice as fast; 0 is as
        fast as the machine can, which needs a component that follows the machine's
        clock.

        IDSL: idempotent void setSpeed(double factor) throws SimulationException
        """

    @abstractmethod
    def Simulation_reset(self, seed: int) -> None:
        """Begin again at tick 0, with everything as the file has it, and noise of this
        seed.

        IDSL: void reset(int seed) throws SimulationException
        """

    @abstractmethod
    def Simulation_setPhysics(self, on: bool) -> None:
        """Switch physics on or off: with it, bodies have weight, shapes are solid, and
        motors have to move them.

        IDSL: idempotent void setPhysics(bool on)
        """

    @abstractmethod
    def Simulation_setNoise(self, id: str, sigma: float) -> None:
        """Set the standard deviation of the noise of a node: of a laser in mm; of an
        imu in m/s² and rad/s; of a base as a part of its speed; of an rgbd as a part of
        its depths.

        IDSL: idempotent void setNoise(string id, double sigma) throws
        SimulationException
        """

    @abstractmethod
    def Simulation_scene(self) -> str:
        """The scene with all edits so far: a file of InnerModel with absolute paths, in
        which what moves is where it began.

        IDSL: idempotent string scene()
        """

    @abstractmethod
    def Simulation_cloud(self, id: str, known: int) -> RoboCompSimulation.Cloud:
        """The points of a `pointcloud`; none if their version is still the one that the
        caller knows.

        IDSL: idempotent Cloud cloud(string id, long known) throws SimulationException
        """

    @abstractmethod
    def Simulation_poses(
        self,
        ids: RoboCompSimulation.IdList,
    ) -> RoboCompSimulation.PoseList:
        """Where nodes truly are. Without ids: all nodes that can move.

        IDSL: idempotent PoseList poses(IdList ids) throws SimulationException
        """

    @abstractmethod
    def Simulation_contacts(self) -> RoboCompSimulation.ContactList:
        """What touches while physics is on.

        IDSL: idempotent ContactList contacts()
        """

    @abstractmethod
    def Simulation_attach(self, gripper: str) -> str:
        """Switch a suction cup or magnet on; returns the body that it holds then, or
        nothing if it reaches none.

        IDSL: string attach(string gripper) throws SimulationException
        """

    @abstractmethod
    def Simulation_detach(self, gripper: str) -> None:
        """Switch it off.

        IDSL: idempotent void detach(string gripper) throws SimulationException
        """

    @abstractmethod
    def Simulation_save(self) -> int:
        """Keep the state of now, and return a token for it. The oldest of more than 16
        is dropped.

        IDSL: long save()
        """

    @abstractmethod
    def Simulation_restore(self, token: int) -> None:
        """Go on from a kept state, as often as needed.

        IDSL: void restore(long token) throws SimulationException
        """

    @abstractmethod
    def Simulation_evaluate(
        self,
        plans: RoboCompSimulation.PlanList,
        horizon: float,
        watched: RoboCompSimulation.PairList,
    ) -> RoboCompSimulation.OutcomeList:
        """Try plans for a time in s, each in a copy of the scene, which itself does not
        change: at most 64 plans, and 600 s of all together. Distances of pairs are
        noted each 50 ms.

        IDSL: idempotent OutcomeList evaluate(PlanList plans, double horizon, PairList
        watched) throws SimulationException
        """

    @abstractmethod
    def InnerModelManager_addTransform(
        self,
        item: str,
        engine: str,
        base: str,
        pose: RoboCompInnerModelManager.Pose3D,
    ) -> bool:
        """Add a frame below `base`: `static`, or a `bullet` that moves freely.

        IDSL: bool addTransform(string item, string engine, string base, Pose3D pose)
        throws InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_addJoint(
        self,
        item: str,
        base: str,
        j: RoboCompInnerModelManager.jointType,
    ) -> bool:
        """Add a joint below `base`.

        IDSL: bool addJoint(string item, string base, jointType j) throws
        InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_addMesh(
        self,
        item: str,
        base: str,
        m: RoboCompInnerModelManager.meshType,
    ) -> bool:
        """Add a shape from a file below `base`.

        IDSL: bool addMesh(string item, string base, meshType m) throws
        InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_addPlane(
        self,
        item: str,
        base: str,
        plane: RoboCompInnerModelManager.Plane3D,
    ) -> bool:
        """Add a box below `base`.

        IDSL: bool addPlane(string item, string base, Plane3D plane) throws
        InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_getAllNodeInformation(
        self,
    ) -> RoboCompInnerModelManager.NodeInformationSequence:
        """All nodes.

        IDSL: void getAllNodeInformation(out NodeInformationSequence nodesInfo) throws
        InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_setPose(
        self,
        base: str,
        item: str,
        pose: RoboCompInnerModelManager.Pose3D,
    ) -> bool:
        """Put a node where a pose says that is seen from `base`.

        IDSL: bool setPose(string base, string item, Pose3D pose) throws
        InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_setPoseFromParent(
        self,
        item: str,
        pose: RoboCompInnerModelManager.Pose3D,
    ) -> bool:
        """Put a node where a pose within its parent says.

        IDSL: bool setPoseFromParent(string item, Pose3D pose) throws
        InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_getPose(
        self,
        base: str,
        item: str,
    ) -> tuple[bool, RoboCompInnerModelManager.Pose3D]:
        """The pose of a node, seen from `base`.

        IDSL: bool getPose(string base, string item, out Pose3D pose) throws
        InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_getPoseFromParent(
        self,
        item: str,
    ) -> tuple[bool, RoboCompInnerModelManager.Pose3D]:
        """The pose of a node within its parent.

        IDSL: bool getPoseFromParent(string item, out Pose3D pose) throws
        InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_setPlane(
        self,
        item: str,
        plane: RoboCompInnerModelManager.Plane3D,
    ) -> bool:
        """Set the place, the size and the texture of a box.

        IDSL: bool setPlane(string item, Plane3D plane) throws InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_transform(
        self,
        base: str,
        item: str,
        coordInItem: RoboCompInnerModelManager.coord3D,
    ) -> tuple[bool, RoboCompInnerModelManager.coord3D]:
        """A point of the frame `item`, seen from `base`.

        IDSL: bool transform(string base, string item, coord3D coordInItem, out coord3D
        coordInBase) throws InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_getTransformationMatrix(
        self,
        base: str,
        item: str,
    ) -> RoboCompInnerModelManager.Matrix:
        """The matrix that leads from `item` to `base`, 4 by 4.

        IDSL: Matrix getTransformationMatrix(string base, string item) throws
        InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_setScale(
        self,
        item: str,
        scaleX: float,
        scaleY: float,
        scaleZ: float,
    ) -> bool:
        """Set the scale of a shape from a file.

        IDSL: bool setScale(string item, float scaleX, float scaleY, float scaleZ)
        throws InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_addAttribute(
        self,
        idNode: str,
        name: str,
        type: str,
        value: str,
    ) -> bool:
        """Add a note to a node.

        IDSL: bool addAttribute(string idNode, string name, string type, string value)
        throws InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_removeAttribute(self, idNode: str, name: str) -> bool:
        """Remove a note.

        IDSL: bool removeAttribute(string idNode, string name) throws
        InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_setAttribute(
        self,
        idNode: str,
        name: str,
        type: str,
        value: str,
    ) -> bool:
        """Change a note.

        IDSL: bool setAttribute(string idNode, string name, string type, string value)
        throws InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_getAttribute(
        self,
        idNode: str,
        name: str,
    ) -> tuple[bool, str, str]:
        """A note on a node.

        IDSL: bool getAttribute(string idNode, string name, out string type, out string
        value) throws InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_removeNode(self, item: str) -> bool:
        """Remove a node with all below it.

        IDSL: bool removeNode(string item) throws InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_moveNode(self, src: str, dst: str) -> bool:
        """Put a node below another parent; it keeps its pose within its parent.

        IDSL: bool moveNode(string src, string dst) throws InnerModelManagerError
        """

    @abstractmethod
    def InnerModelManager_collide(self, a: str, b: str) -> bool:
        """Whether shapes at or below two nodes overlap.

        IDSL: bool collide(string a, string b)
        """

    @abstractmethod
    def InnerModelManager_setPointCloudData(
        self,
        id: str,
        cloud: RoboCompInnerModelManager.PointCloudVector,
    ) -> None:
        """Set the points of a cloud.

        IDSL: void setPointCloudData(string id, PointCloudVector cloud)
        """
