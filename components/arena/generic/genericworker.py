# Generated from arena.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of arena, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from abc import abstractmethod

from robocomp_py.runtime.api import Component, Port, QoS, Verb, Worker
from robocomp_py.runtime.instances import InstanceHandler, NamedHandlers, NamedProxies

from . import (
    RoboCompBatteryStatus,
    RoboCompBatteryStatusPub,
    RoboCompCameraSimple,
    RoboCompCameraSimplePub,
    RoboCompDifferentialRobot,
    RoboCompDifferentialRobotPub,
    RoboCompFullPoseEstimation,
    RoboCompFullPoseEstimationPub,
    RoboCompGenericBase,
    RoboCompInnerModelManager,
    RoboCompLaser,
    RoboCompLaserPub,
    RoboCompSimulation,
    RoboCompSimulationPub,
)
from .params import PARAMS, Params


class DifferentialRobotHandler(InstanceHandler):
    """Answers for one `DifferentialRobot`. Derive a class from it, and add an object of
    it: self.differentialrobot.add(name, handler).
    """

    @abstractmethod
    def getBaseState(self) -> RoboCompGenericBase.TBaseState:
        """Where the base is and how it moves.

        IDSL: void getBaseState(out RoboCompGenericBase::TBaseState state) throws
        RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def getBasePose(self) -> tuple[int, int, float]:
        """Where the base is by its odometer: mm, mm, rad.

        IDSL: void getBasePose(out int x, out int z, out float alpha) throws
        RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def setSpeedBase(self, adv: float, rot: float) -> None:
        """Drive with these speeds from now on: mm/s forwards, rad/s to the right.
        Repeat it while driving: a base may stop when no new speeds arrive for a while.

        IDSL: void setSpeedBase(float adv, float rot) throws
        RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def stopBase(self) -> None:
        """Stand still.

        IDSL: void stopBase() throws RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def resetOdometer(self) -> None:
        """Call the present pose 0, 0, 0.

        IDSL: void resetOdometer() throws RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def setOdometer(self, state: RoboCompGenericBase.TBaseState) -> None:
        """Take pose and best estimate from a state; its speeds do not matter.

        IDSL: void setOdometer(RoboCompGenericBase::TBaseState state) throws
        RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def setOdometerPose(self, x: int, z: int, alpha: float) -> None:
        """Call the present pose this: mm, mm, rad.

        IDSL: void setOdometerPose(int x, int z, float alpha) throws
        RoboCompGenericBase::HardwareFailedException
        """

    @abstractmethod
    def correctOdometer(self, x: int, z: int, alpha: float) -> None:
        """Replace the best estimate, and leave the odometer as it is: mm, mm, rad.

        IDSL: void correctOdometer(int x, int z, float alpha) throws
        RoboCompGenericBase::HardwareFailedException
        """


class FullPoseEstimationHandler(InstanceHandler):
    """Answers for one `FullPoseEstimation`. Derive a class from it, and add an object
    of it: self.fullposeestimation.add(name, handler).
    """

    @abstractmethod
    def setInitialPose(
        self,
        x: float,
        y: float,
        z: float,
        rx: float,
        ry: float,
        rz: float,
    ) -> None:
        """Tell an estimator where it begins: m and rad.

        IDSL: void setInitialPose(float x, float y, float z, float rx, float ry, float
        rz)
        """

    @abstractmethod
    def getFullPoseEuler(self) -> RoboCompFullPoseEstimation.FullPoseEuler:
        """The pose and its speeds.

        IDSL: FullPoseEuler getFullPoseEuler()
        """

    @abstractmethod
    def getFullPoseMatrix(self) -> RoboCompFullPoseEstimation.FullPoseMatrix:
        """The pose as a matrix.

        IDSL: FullPoseMatrix getFullPoseMatrix()
        """


class LaserHandler(InstanceHandler):
    """Answers for one `Laser`. Derive a class from it, and add an object of it:
    self.laser.add(name, handler).
    """

    @abstractmethod
    def getLaserData(self) -> RoboCompLaser.TLaserData:
        """The last scan.

        IDSL: TLaserData getLaserData()
        """

    @abstractmethod
    def getLaserAndBStateData(
        self,
    ) -> tuple[RoboCompLaser.TLaserData, RoboCompGenericBase.TBaseState]:
        """The last scan, and where the base was then.

        IDSL: TLaserData getLaserAndBStateData(out RoboCompGenericBase::TBaseState
        bState)
        """

    @abstractmethod
    def getLaserConfData(self) -> RoboCompLaser.LaserConfData:
        """What the laser is and how it is set.

        IDSL: LaserConfData getLaserConfData()
        """


class CameraSimpleHandler(InstanceHandler):
    """Answers for one `CameraSimple`. Derive a class from it, and add an object of it:
    self.camerasimple.add(name, handler).
    """

    @abstractmethod
    def getImage(self) -> RoboCompCameraSimple.TImage:
        """The newest picture.

        IDSL: TImage getImage() throws HardwareFailedException
        """


class GenericWorker(Worker[Params]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "arena",
        ports=(
            Port(
                Verb.IMPLEMENTS,
                RoboCompDifferentialRobot.DIFFERENTIALROBOT_INTERFACE,
                each=True,
            ),
            Port(
                Verb.IMPLEMENTS,
                RoboCompFullPoseEstimation.FULLPOSEESTIMATION_INTERFACE,
                each=True,
            ),
            Port(Verb.IMPLEMENTS, RoboCompLaser.LASER_INTERFACE, each=True),
            Port(
                Verb.IMPLEMENTS,
                RoboCompCameraSimple.CAMERASIMPLE_INTERFACE,
                each=True,
            ),
            Port(Verb.IMPLEMENTS, RoboCompBatteryStatus.BATTERYSTATUS_INTERFACE),
            Port(Verb.IMPLEMENTS, RoboCompSimulation.SIMULATION_INTERFACE),
            Port(
                Verb.IMPLEMENTS,
                RoboCompInnerModelManager.INNERMODELMANAGER_INTERFACE,
            ),
            Port(
                Verb.PUBLISHES,
                RoboCompDifferentialRobotPub.DIFFERENTIALROBOTPUB_INTERFACE,
                each=True,
                proxy=RoboCompDifferentialRobotPub.DifferentialRobotPubPublisher,
            ),
            Port(
                Verb.PUBLISHES,
                RoboCompFullPoseEstimationPub.FULLPOSEESTIMATIONPUB_INTERFACE,
                each=True,
                proxy=RoboCompFullPoseEstimationPub.FullPoseEstimationPubPublisher,
            ),
            Port(
                Verb.PUBLISHES,
                RoboCompLaserPub.LASERPUB_INTERFACE,
                qos=QoS(depth=5),
                each=True,
                proxy=RoboCompLaserPub.LaserPubPublisher,
            ),
            Port(
                Verb.PUBLISHES,
                RoboCompCameraSimplePub.CAMERASIMPLEPUB_INTERFACE,
                qos=QoS(depth=5),
                each=True,
                proxy=RoboCompCameraSimplePub.CameraSimplePubPublisher,
            ),
            Port(
                Verb.PUBLISHES,
                RoboCompBatteryStatusPub.BATTERYSTATUSPUB_INTERFACE,
                proxy=RoboCompBatteryStatusPub.BatteryStatusPubPublisher,
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
            "Simulates arena.xml: each of its devices is a named instance, with "
            "the id of its node. The battery of the robot is simulated beside it."
        ),
    )
    middleware = "auto"

    batterystatuspub_proxy: RoboCompBatteryStatusPub.BatteryStatusPubPublisher
    simulationpub_proxy: RoboCompSimulationPub.SimulationPubPublisher

    differentialrobot: NamedHandlers[DifferentialRobotHandler]
    fullposeestimation: NamedHandlers[FullPoseEstimationHandler]
    laser: NamedHandlers[LaserHandler]
    camerasimple: NamedHandlers[CameraSimpleHandler]
    differentialrobotpub: NamedProxies[
        RoboCompDifferentialRobotPub.DifferentialRobotPubPublisher
    ]
    fullposeestimationpub: NamedProxies[
        RoboCompFullPoseEstimationPub.FullPoseEstimationPubPublisher
    ]
    laserpub: NamedProxies[RoboCompLaserPub.LaserPubPublisher]
    camerasimplepub: NamedProxies[RoboCompCameraSimplePub.CameraSimplePubPublisher]

    @abstractmethod
    def BatteryStatus_getBatteryState(self) -> RoboCompBatteryStatus.TBattery:
        """What is left now.

        IDSL: TBattery getBatteryState() throws HardwareFailedException
        """

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
