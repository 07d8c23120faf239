"""A program with Ice and the output of slice2py alone asks the devices of a scene, at the ports that its file has."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.dsl.workspace import SHIPPED
from robocomp_py.testing.patience import SOON
from tests import freeports

pytestmark = pytest.mark.tool

SCENE = """\
<innerModel>
  <plane id="east" px="2005" nx="1" size="9000,2000,10"/>
  <joint id="pan" ty="300" axis="y" port="{motors}">
    <laser id="front" port="{laser}" measures="2" angle="3.1415926535" max="5000"/>
  </joint>
</innerModel>
"""
NETWORK = """
import "house/house.cdsl";
Deployment visit {{ Component house {{ {offers} }}; }};
"""
ASK = """\
import sys
sys.modules["robocomp_py"] = None
sys.path.insert(0, ".")
import Ice, RoboCompJointMotor, RoboCompLaser
with Ice.initialize() as ice:
    laser = RoboCompLaser.LaserPrx.checkedCast(ice.stringToProxy("laser:tcp -h 127.0.0.1 -p " + sys.argv[1]))
    text = "jointmotor:tcp -h 127.0.0.1 -p " + sys.argv[2]
    motors = RoboCompJointMotor.JointMotorPrx.checkedCast(ice.stringToProxy(text))
    print([round(each.dist) for each in laser.getLaserData()])
    motors.setPosition(RoboCompJointMotor.MotorGoalPosition("pan", 3.1415926535 / 2, 0.0))
    print(round(motors.getMotorState("pan").pos, 3), [round(each.dist) for each in laser.getLaserData()])
    try:
        motors.setZeroPos("tilt")
    except RoboCompJointMotor.UnknownMotorException as exc:
        print(exc.what)
"""


def run(folder: Path, program: str, *arguments: str) -> str:
    here = Path(sys.executable).parent / program
    command = [str(here) if here.exists() else program, *arguments]
    return subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True, timeout=SOON * 4).stdout


def test_a_client_in_slice_asks_the_devices_at_the_ports_of_the_scene(tmp_path: Path) -> None:
    laser, motors = freeports.free_ports(2)
    (tmp_path / "room.xml").write_text(SCENE.format(laser=laser, motors=motors))
    run(tmp_path, "rc", "sim", "new", "room.xml", "-o", "house", "--middleware", "ice")
    offers = run(tmp_path, "rc", "sim", "offers", "room.xml", "--ports")
    (tmp_path / "visit.ddsl").write_text(NETWORK.format(offers=offers))
    for name in ("Laser", "JointMotor"):
        run(tmp_path, "rcgen", str(SHIPPED / f"{name}.idsl"), "--to", "slice", "-o", ".")
    run(tmp_path, "slice2py", "-I.", *sorted(each.name for each in tmp_path.glob("*.ice")))
    (tmp_path / "ask.py").write_text(ASK)
    with contextlib.ExitStack() as running:
        deploy = [str(Path(sys.executable).with_name("rcdeploy")), "visit.ddsl"]
        pipe = subprocess.PIPE
        network = subprocess.Popen(deploy, cwd=tmp_path, stdout=pipe, stderr=subprocess.STDOUT, text=True)
        running.enter_context(network)
        running.callback(network.terminate)
        assert network.stdout
        assert any("is ready" in line for line in network.stdout)
        told = run(tmp_path, sys.executable, "ask.py", str(laser), str(motors)).splitlines()
    assert told[:2] == ["[2000, 5000]", "1.571 [5000, 2000]"]
    assert told[2] == "unknown motor `tilt`; known: pan"
