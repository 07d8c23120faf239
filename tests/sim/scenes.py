"""What several tests have in their scenes."""

from __future__ import annotations

WEDGE = "v 0 0 0\nv 100 0 0\nv 0 200 0\nv 0 0 300\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
"""A mesh in the format OBJ; its corners are in mm."""


def room_with(*nodes: str) -> str:
    """A scene with a robot before a red wall, a point cloud, and these nodes."""
    return f"""\
<innerModel>
  <transform id="world">
    <differentialrobot id="base" collide="1">
      <plane id="body" size="300,300,300" collide="1"/>
      <translation id="mount" ty="300"><laser id="front" measures="2" angle="3.1415926535" max="5000"/></translation>
      <joint id="pan" ty="400" axis="y" port="7"/>
    </differentialrobot>
    <transform id="stand" tx="2000"><plane id="wall" size="10,2000,900" texture="#ff0000" collide="1"/></transform>
    <pointcloud id="cloud"/>
    {"".join(nodes)}
  </transform>
</innerModel>
"""
