"""URDF as MuJoCo can read it: with the shapes of links that are only seen, and with the files of packages of ROS."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from ..innermodel.read import InnerModelError

_PACKAGE, _FILE = "package://", "file://"
_READ_BY_MUJOCO = (".obj", ".stl", ".msh")
_XACRO = "xacro}"


def readable(text: bytes, folder: Path) -> tuple[str, list[str]] | None:
    """The text of a URDF file in this folder for MuJoCo, and what is left out of it, for people.

    None if the text is no URDF. Raises InnerModelError for macros that are not expanded.

    MuJoCo reads what is only seen if it is told to, but fails at formats such as Collada, which are usual there. The
    scene has such a shape only if its link has no solid one. MuJoCo knows no packages: they are looked for beside and
    above the file.
    """
    try:
        robot = ElementTree.fromstring(text)
    except ElementTree.ParseError:
        return None  # MuJoCo tells what is wrong
    if robot.tag != "robot":
        return None
    if any(_XACRO in str(each.tag) for each in robot.iter()):
        raise InnerModelError("it has macros: expand them first, by `xacro FILE > FILE.urdf`")
    for mesh in robot.iter("mesh"):
        mesh.set("filename", _found(mesh.get("filename", ""), folder))
    left_out = [each for link in robot.findall("link") for each in _without_pictures(link)]
    _told_to_see(robot)
    return ElementTree.tostring(robot, encoding="unicode"), left_out


def _found(name: str, folder: Path) -> str:
    """The path of a mesh; as it is in the file if it is not there."""
    if name.startswith(_FILE):
        return name.removeprefix(_FILE)
    if not name.startswith(_PACKAGE):
        return name
    package, _, rest = name.removeprefix(_PACKAGE).partition("/")
    for above in (folder, *folder.parents):
        for place in (above, above / package) if above.name == package else (above / package,):
            if (place / rest).is_file():
                return str(place / rest)
    return name


def _without_pictures(link: Element) -> list[str]:
    """Take the meshes that MuJoCo cannot read from what is only seen; returns what a scene loses by that."""
    lost, is_solid = [], link.find("collision") is not None
    for seen in link.findall("visual"):
        for geometry in seen.findall("geometry"):
            file = next((mesh.get("filename", "") for mesh in geometry.iter("mesh")), "")
            if is_solid and file:  # it is left out anyway, but its colour is that of the solid shapes
                geometry[:] = [Element("sphere", radius="1")]
            elif file and not file.lower().endswith(_READ_BY_MUJOCO):
                link.remove(seen)
                lost.append(f"the shape {file} of {link.get('name')}: MuJoCo reads {', '.join(_READ_BY_MUJOCO)}")
    return lost


def _told_to_see(robot: Element) -> None:
    """Let MuJoCo keep the shapes that are only seen."""
    settings = robot.find("mujoco")
    if settings is None:
        settings = ElementTree.SubElement(robot, "mujoco")
    compiler = settings.find("compiler")
    if compiler is None:
        compiler = ElementTree.SubElement(settings, "compiler")
    compiler.set("discardvisual", "false")
