"""Networks that are made for the tests of environments."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocomp_py.cli.rc import main as rc

COMPONENTS = Path(__file__).parents[2] / "components"

SCENE = """\
<innerModel>
  <transform id="world">
    <plane id="north" pz="3005" nz="1" size="9000,2000,10"/>
    <plane id="east" px="2005" nx="1" size="9000,2000,10"/>
    <differentialrobot id="base" noise="0.1">
      <joint id="pan" ty="300" axis="y" min="-1" max="1"/>
      <translation id="mount" ty="300"><laser id="laser" measures="9" angle="3.927" max="5000"/></translation>
    </differentialrobot>
  </transform>
</innerModel>
"""

HOUSE = """\
    Component house
    {
        offers base : DifferentialRobot, DifferentialRobotPub, FullPoseEstimation, FullPoseEstimationPub;
        offers laser : Laser, LaserPub;
        offers joints : JointMotor, JointMotorPub;
    };
"""


@pytest.fixture(scope="session")
def networks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `scene.ddsl`, which is a scene alone, `flat.ddsl`, which is world2d alone, and `both.ddsl`."""
    folder = tmp_path_factory.mktemp("networks")
    (folder / "room.xml").write_text(SCENE)
    assert rc(["sim", "new", str(folder / "room.xml"), "-o", str(folder / "house")]) == 0
    house, flat = 'import "house/house.cdsl";', f'import "{COMPONENTS}/world2d/world2d.cdsl";'
    (folder / "scene.ddsl").write_text(f"{house}\nDeployment scene\n{{\n{HOUSE}}};\n")
    (folder / "flat.ddsl").write_text(f"{flat}\nDeployment flat {{ Component world : world2d {{ }}; }};\n")
    both = f"{HOUSE}    Component world : world2d {{ }};\n"
    (folder / "both.ddsl").write_text(f"{house}\n{flat}\nDeployment both\n{{\n{both}}};\n")
    return folder
