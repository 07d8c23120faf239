"""The shipped interfaces agree with those of the same name in RoboComp's repository."""

from __future__ import annotations

from pathlib import Path

from robocomp_py.contract.interface import Interface
from robocomp_py.dsl.workspace import SHIPPED, Workspace

PUBLIC = {
    "BatteryStatus.getBatteryState": 0x77493784F6F4EC31,
    "CameraRGBDSimple.getAll": 0xEA34524F5EDB6084,
    "CameraRGBDSimple.getDepth": 0xB766FCC80F52D83F,
    "CameraRGBDSimple.getImage": 0x6A7C9BB57A74C51F,
    "CameraRGBDSimple.getPoints": 0x3FF97C574F33809F,
    "CameraRGBDSimplePub.pushRGBD": 0xF2F3B4B38F54AD28,
    "CameraSimple.getImage": 0xB27E0702EF366133,
    "CommonBehavior.getPeriod": 0x09B3BE71B1CC59FE,
    "CommonBehavior.setPeriod": 0x39D395EB92A2E91B,
    "CommonBehavior.timeAwake": 0xDD4ECDE246671A6C,
    "CommonBehavior.killYourSelf": 0xE6AC7947FCD9F46A,
    "CommonBehavior.getParameterList": 0xE6F9F756D91CDD81,
    "CommonBehavior.setParameterList": 0x7F324672F7BD4568,
    "CommonBehavior.reloadConfig": 0x46DD166F3B9E7DA6,
    "CommonBehavior.getState": 0x1F8E28DBDAF6914B,
    "DifferentialRobot.getBaseState": 0xEF99C79470D25E8A,
    "DifferentialRobot.getBasePose": 0x42669CE70AEF2042,
    "DifferentialRobot.setSpeedBase": 0x5E50EBEFC4602B6A,
    "DifferentialRobot.stopBase": 0xF082723352420652,
    "DifferentialRobot.resetOdometer": 0x28EC49D5F2C96AC2,
    "DifferentialRobot.setOdometer": 0xD4ED97947813733F,
    "DifferentialRobot.setOdometerPose": 0xB81CCF91EBE24B0C,
    "DifferentialRobot.correctOdometer": 0x596475717C263486,
    "Display.setImage": 0xBDF9715AE6DABE7B,
    "Display.setImageFromFile": 0x069163B3FED5AB2A,
    "IMU.getDataImu": 0x7673CE6203BC2278,
    "IMU.getAcceleration": 0x71EC09BE3C89E704,
    "IMU.getAngularVel": 0xD7BEEC9D4E424EDE,
    "IMU.getMagneticFields": 0xEC670B3882210543,
    "IMU.getOrientation": 0xB0C5126E15BEF39F,
    "IMU.resetImu": 0xC883BBEFED0322D3,
    "IMUPub.publish": 0xFF0C157BE9AF80F0,
    "TouchSensor.getValues": 0x1A63761CAA19D7F0,
    "FullPoseEstimation.setInitialPose": 0xB0A9DDF9EEF1D511,
    "FullPoseEstimation.getFullPoseEuler": 0xF2BB4633C728EE25,
    "FullPoseEstimation.getFullPoseMatrix": 0x45FA3A19F472DC1F,
    "FullPoseEstimationPub.newFullPose": 0x0531542B715F0B0A,
    "GenericBase.getBaseState": 0x8F47B2B767ECC0B8,
    "GenericBase.getBasePose": 0xFDC2B0852F4FCF20,
    "GotoPoint.go": 0x2A94887338DAFDA1,
    "GotoPoint.turn": 0xFAAB28ECA0463AC1,
    "GotoPoint.stop": 0xFFDB08D357C99465,
    "GotoPoint.atTarget": 0x0B2300A77D0ABC62,
    "InnerModelManager.addTransform": 0x2C6AD6DB8F26B306,
    "InnerModelManager.addJoint": 0x2556EBE033CF5191,
    "InnerModelManager.addMesh": 0x35DDD6F3720BB01C,
    "InnerModelManager.addPlane": 0x88CDCE0C30AD93E7,
    "InnerModelManager.getAllNodeInformation": 0xBF4C34B068E972BE,
    "InnerModelManager.setPose": 0xCBB0B55323ECE9D0,
    "InnerModelManager.setPoseFromParent": 0x20F60146407AD03B,
    "InnerModelManager.getPose": 0x52D958E569502DFC,
    "InnerModelManager.getPoseFromParent": 0x3BB422D011AF4B54,
    "InnerModelManager.setPlane": 0xEEF29228709ACDA2,
    "InnerModelManager.transform": 0x51960804EA637487,
    "InnerModelManager.getTransformationMatrix": 0x5AB6DBA535B234B4,
    "InnerModelManager.setScale": 0x0754989A75F7C0F6,
    "InnerModelManager.addAttribute": 0xDF06100D1DFA4D53,
    "InnerModelManager.removeAttribute": 0x3A3E402087901E98,
    "InnerModelManager.setAttribute": 0x557BBBDF0F272983,
    "InnerModelManager.getAttribute": 0xEE9BADAC6E77C41A,
    "InnerModelManager.removeNode": 0x26A5D7D0ADDE2A09,
    "InnerModelManager.moveNode": 0xBB9B248719D7786A,
    "InnerModelManager.collide": 0x72678E097E8C3D6F,
    "InnerModelManager.setPointCloudData": 0x7E6C4826F057A81F,
    "JointMotor.setPosition": 0x1AB81FDE6E9881F7,
    "JointMotor.setVelocity": 0xE29C58F690ABD46C,
    "JointMotor.setZeroPos": 0x0B89D9FE46255A89,
    "JointMotor.setSyncPosition": 0xAD79B65E37A5F2DB,
    "JointMotor.setSyncVelocity": 0x103A6F935FF6A69C,
    "JointMotor.setSyncZeroPos": 0xB1E16CBB1B28335B,
    "JointMotor.getMotorParams": 0x2D43AE272EC196EB,
    "JointMotor.getMotorState": 0x3F93512F39AB8DAE,
    "JointMotor.getMotorStateMap": 0x396CE5C856FE5715,
    "JointMotor.getAllMotorState": 0x632E0998236A4E01,
    "JointMotor.getAllMotorParams": 0x038A9861C91F4C2F,
    "JointMotor.getBusParams": 0xDE6B23B93296D5C9,
    "JointMotorPub.motorStates": 0x23C88B0EEF571687,
    "Laser.getLaserData": 0xC7572A8E42895B5A,
    "Laser.getLaserAndBStateData": 0x843409F3D46F8F74,
    "Laser.getLaserConfData": 0x38F88D1E3F4E88CC,
    "LaserPub.pushLaserData": 0xB1371EF65AE42C9C,
    "Lidar3D.getLidarData": 0xC401FBA0439DD34E,
    "Lidar3D.getLidarDataWithThreshold2d": 0xAEEC0917EF93217A,
    "OmniRobot.getBaseState": 0x5646C78CAB4E32FD,
    "OmniRobot.getBasePose": 0x41D8FB2DED735C5D,
    "OmniRobot.setSpeedBase": 0x114EDF359AEBC31C,
    "OmniRobot.stopBase": 0x207CBE12E06AC38C,
    "OmniRobot.resetOdometer": 0x0325B972CB201DA6,
    "OmniRobot.setOdometer": 0xB4045EB03CB24E4D,
    "OmniRobot.setOdometerPose": 0x4D59CBD27295053C,
    "OmniRobot.correctOdometer": 0xFF290CFDDE6E00AD,
    "RGBD.getData": 0xCB6D505A10E96976,
    "RGBD.getDepth": 0xEBDAFA074234C94E,
    "RGBD.getDepthInIR": 0x5F0EE534797C3BA0,
    "RGBD.getImage": 0x113130382A6F0B80,
    "RGBD.getRGB": 0x6DA6C84B52040FD2,
    "RGBD.getRGBDParams": 0x48240DFDE2A3F271,
    "RGBD.getRegistration": 0xF8AAE387292BE80A,
    "RGBD.getXYZ": 0x549178C8F1A71584,
    "RGBD.getXYZByteStream": 0xEED4DA447E06DEAF,
    "RGBD.setRegistration": 0x7C4AF87B62389958,
    "Speech.say": 0x2BBB78A9CBC16722,
    "Speech.isBusy": 0xFFD303AF5E61679D,
}
"""Fingerprint of each operation, types and exceptions included, as computed from RoboComp's `interfaces/IDSLs`."""

OURS = {
    "BatteryStatusPub",
    "CameraSimplePub",
    "Clock",
    "DifferentialRobotPub",
    "Introspection",
    "IntrospectionPub",
    "Lidar3DPub",
    "Simulation",
    "SimulationPub",
}
"""Interfaces that RoboComp's repository does not have."""

ADDED = {"CommonBehavior.getActiveStates", "CommonBehavior.getStatus"}
"""Operations that RoboComp's interface does not have."""


def test_each_shipped_interface_has_the_operations_of_the_public_one() -> None:
    """Sequences that are records here count as the sequences that they are there."""
    found = {}
    for path in sorted(SHIPPED.glob("*.idsl")):
        module = Workspace(read=_without_records).interfaces(path)
        assert module is not None
        for each in module.definitions:
            if isinstance(each, Interface) and each.short not in OURS and each.short == path.stem:
                found |= {f"{each.short}.{operation.name}": operation.fingerprint for operation in each.operations}
    assert {name: value for name, value in found.items() if name not in ADDED} == PUBLIC
    assert found.keys() >= ADDED


def _without_records(path: Path) -> bytes:
    return path.read_bytes().replace(b"[records] ", b"")
