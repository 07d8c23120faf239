"""`rc sim`: components that simulate a scene."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import RobocompError
from . import starting
from .common import FINE, complain, counted, describe
from .completing import What, completed
from .viewing import EDIT_HELP, VIEW_HELP, add_edit, add_view, edit, view

if TYPE_CHECKING:
    from ..innermodel.tree import Tree

NAME = "sim"

_EXAMPLES = """\
examples:
  rc sim new house.xml -o house      a component that provides every robot and sensor of the scene
  rc sim offers house.xml            the lines of the network that declare them
  rc sim offers house.xml --ports    the same, with the ports at which programs of RoboComp ask
  rc sim new house.xml --lidar top   the laser `top` has several fans, and also provides points in space

  rc sim import arm.urdf             a scene from URDF or MJCF, in arm.xml
  rc sim export house.xml            its physics as MJCF, in house.mjcf

  rc sim view house.xml              the scene in the browser
  rc sim view                        ... as it runs; --component NAME: which one, if several do
  rc sim edit house.xml              edit the scene in the browser

Simulating needs `pip install 'robocomp-py[sim]'`, and the browser `pip install 'robocomp-py[viewer]'`.

exit status: 0 done, 1 the scene is wrong or the folder is not empty, 2 usage, 130/143 by a signal
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = (
        "Write a component that simulates a scene, print what a network has to declare of it, show and edit it, "
        "make one from URDF or MJCF, and write MJCF."
    )
    to.epilog = _EXAMPLES
    actions = to.add_subparsers(dest="action", metavar="COMMAND", required=True)

    def command(name: str, about: str) -> argparse.ArgumentParser:
        made = actions.add_parser(name, help=about)
        describe(made, about, to)
        return made

    new = command("new", "write a component that simulates a scene")
    new.add_argument("scene", type=Path, metavar="FILE.xml", help="the scene; it stays where it is")
    new.add_argument("-o", "--output", type=Path, metavar="DIR", help="the folder, whose name is that of the component")
    _add_lidar(new)
    carrier = new.add_argument("--middleware", metavar="NAME", help="what carries its messages (default: auto)")
    completed(carrier, What.MIDDLEWARE)
    shown = command("offers", "print the devices of a scene as clauses of DDSL")
    shown.add_argument("scene", type=Path, metavar="FILE.xml", help="the scene")
    _add_lidar(shown)
    shown.add_argument(
        "--ports",
        action="store_true",
        help="with the ports of the file, at which programs of RoboComp ask: one interface at each",
    )
    shown.add_argument("--json", action="store_true", help="print one object: interfaces by device, or with their port")
    taken = command("import", "make a scene from a file of URDF or MJCF")
    taken.add_argument("robot", type=Path, metavar="FILE", help="the file, which is not changed")
    taken.add_argument(
        "-o", "--output", type=Path, metavar="FILE.xml", help="the scene (default: FILE.xml, in this folder)"
    )
    given = command("export", "write the bodies, joints, shapes and motors of a scene as MJCF")
    given.add_argument("scene", type=Path, metavar="FILE.xml", help="the scene, which is not changed")
    given.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="the file (default: FILE.mjcf, in this folder)"
    )
    add_view(actions.add_parser("view", help=VIEW_HELP))
    add_edit(actions.add_parser("edit", help=EDIT_HELP))


def _add_lidar(to: argparse.ArgumentParser) -> None:
    to.add_argument(
        "--lidar",
        action="append",
        default=[],
        metavar="LASER",
        help="a laser that has several fans, which the file cannot say: it also provides Lidar3D; may be repeated",
    )


def run(options: argparse.Namespace) -> int:
    if options.action == "view":
        return view(options)
    if options.action == "edit":
        return edit(options)
    if options.action == "import":
        return _import(options.robot, options.output or Path(options.robot.stem).with_suffix(".xml"))
    if options.action == "export":
        return _export(options.scene, options.output or Path(options.scene.stem).with_suffix(".mjcf"))
    from ..innermodel.read import InnerModelError
    from ..innermodel.tree import Tree
    from ..sim.parameters import FANS, FIELD
    from ..sim.serve.offers import INTERFACES, at_ports, left_out, offers
    from ..spelling import unknown

    if wrong := _cannot_be_read(options.scene):
        return complain(f"rc sim: {wrong}")
    tree = Tree()
    try:
        tree = Tree.read(options.scene)
        found = offers(tree, options.lidar)
        ports = at_ports(tree, options.lidar) if options.action == "offers" and options.ports else {}
    except InnerModelError as exc:
        place = tree.place(exc.node) if exc.node else None
        return complain(f"rc sim: {f'{place}: ' if place else ''}{exc}")
    lasers = [name for name in found if name in tree and tree.node(name).tag == "laser"]
    for name in options.lidar:
        if name not in lasers:
            return complain(f"rc sim: --lidar {name}: {unknown('laser', name, lasers)}")
    missing = "; ".join(f"{kind}: {', '.join(names)}" for kind, names in left_out(tree).items())
    if not found:
        kinds = ", ".join((*INTERFACES, "joint"))
        wrong = f"rc sim: {options.scene} has no device that can be provided: {kinds}"
        return complain(wrong + (f"; it has {missing}" if missing else ""))
    if tree.problems:
        told = f"{counted(len(tree.problems), 'warning')} about {options.scene}"
        print(f"{told}; to read: rc lint {options.scene}", file=sys.stderr)
    if options.action == "offers":
        if missing:
            print(f"not provided yet: {missing}", file=sys.stderr)
        _print_offers(ports or {name: (interfaces, 0) for name, interfaces in found.items()}, options)
        return FINE
    code = _new(options, found, [{"id": name, "fans": FANS, "field": FIELD} for name in dict.fromkeys(options.lidar)])
    if missing and code == FINE:
        print(f"not provided yet: {missing}")
    lost = [tree.node(name) for name, tag in tree.tags.items() if _is_lost(tree, name, tag)]
    if lost and code == FINE:
        files = dict.fromkeys(str(node.values["file"]) or f"(none) of `{node.id}`" for node in lost)
        print(
            f"no such file: {', '.join(files)}; `without_meshes = true` in its etc/config.toml leaves such meshes out"
        )
    return code


def _cannot_be_read(path: Path, endings: tuple[str, ...] = (".xml",)) -> str:
    """Why a file cannot be read, with one that may be meant; "" if it is there."""
    if path.is_file():
        return ""
    from ..dsl.nearby import nearby

    hint = nearby(path, str(path), models=endings)
    return f"{path}: {'it is a folder' if path.is_dir() else 'there is no such file'}{f'; {hint}' if hint else ''}"


def _import(robot: Path, scene: Path) -> int:
    """Write what MuJoCo reads of a file as a scene, with a folder of its meshes."""
    from ..dsl.innermodel.check import is_innermodel
    from ..innermodel.read import InnerModelError

    if wrong := _cannot_be_read(robot, (".urdf", ".xml")):
        return complain(f"rc sim import: {wrong}")
    if is_innermodel(robot):
        return complain(f"rc sim import: {robot} is a scene already; to see it: rc sim view {robot}")
    folder = scene.with_name(f"{scene.stem}_meshes")
    if there := [each for each in (scene, folder) if each.exists()]:
        return complain(f"rc sim import: {there[0]} is there already; choose another file by -o")
    try:
        from ..sim.importing import imported
    except ImportError as exc:
        return complain(f"rc sim import: it needs MuJoCo: pip install 'robocomp-py[sim]' ({exc})")
    try:
        found = imported(robot, folder.name)
        (folder if found.meshes else scene.parent).mkdir(parents=True, exist_ok=True)
        for name, text in found.meshes.items():
            (scene.parent / name).write_text(text)
        found.tree.save(scene)
    except InnerModelError as exc:
        return complain(f"rc sim import: {exc}")
    except OSError as exc:
        shutil.rmtree(folder, ignore_errors=True)  # there was none before
        return complain(f"rc sim import: {exc.filename or scene}: {exc.strerror or exc}")
    if found.left_out:
        print(f"left out: {'; '.join(found.left_out)}")
    print(f"{scene} has {counted(len(found.tree) - 1, 'node')}; to see it: rc sim view {scene}")
    return FINE


def _export(path: Path, file: Path) -> int:
    """Write what physics knows of a scene as MJCF."""
    from ..innermodel.read import InnerModelError
    from ..innermodel.tree import Tree

    if wrong := _cannot_be_read(path):
        return complain(f"rc sim export: {wrong}")
    if file.exists():
        return complain(f"rc sim export: {file} is there already; choose another file by -o")
    try:
        from ..sim.build import MissingMeshError
        from ..sim.exporting import exported
    except ImportError as exc:
        return complain(f"rc sim export: it needs MuJoCo: pip install 'robocomp-py[sim]' ({exc})")
    tree = Tree()
    try:
        tree = Tree.read(path)
        file.write_text(exported(tree))
    except InnerModelError as exc:
        place = tree.place(exc.node) if exc.node else None
        text = exc.lack if isinstance(exc, MissingMeshError) else exc
        return complain(f"rc sim export: {f'{place}: ' if place else ''}{text}")
    except OSError as exc:
        return complain(f"rc sim export: {exc.filename or file}: {exc.strerror or exc}")
    return FINE


def _is_lost(tree: Tree, name: str, tag: str) -> bool:
    """Whether a node is a mesh without a file."""
    return tag == "mesh" and tree.file(name) is None


def _print_offers(found: dict[str, tuple[tuple[str, ...], int]], options: argparse.Namespace) -> None:
    if options.json:
        with_ports = {name: {"interfaces": each, "port": port} for name, (each, port) in found.items()}
        print(json.dumps(with_ports if options.ports else {name: each for name, (each, _) in found.items()}))
        return
    for name, (interfaces, port) in found.items():
        print(f"offers {name} : {', '.join(interfaces)}{f' port {port}' if port else ''};")


def _new(options: argparse.Namespace, found: dict[str, tuple[str, ...]], bodies: Sequence[Mapping[str, object]]) -> int:
    from ..codegen.generate import scene_models, scene_specifics
    from ..contract.middleware import AUTO
    from ..sim.serve.offers import CONTROL, used

    root: Path = options.output or Path(options.scene.stem)
    name = root.resolve().name
    scene = os.path.relpath(options.scene.resolve(), root.resolve())
    try:
        wrong = starting.unfit(name, root) or starting.begin(
            root,
            f"{name.lower()}.cdsl",
            scene_models(name.lower(), scene, used(found), CONTROL),
            partial(scene_specifics, scene=scene, bodies=bodies),
            options.middleware or AUTO,
        )
    except RobocompError as exc:
        return complain(f"rc sim: {exc}")
    if wrong:
        return complain(f"rc sim: {wrong}")
    lidars = "".join(f" --lidar {name}" for name in dict.fromkeys(options.lidar))
    print(
        f"{root}/ simulates {options.scene}:\n\n"
        f"    rc run {root}\n\n"
        "For a network with its clients, copy the lines that declare its devices into a .ddsl file:\n\n"
        f"    rc sim offers {options.scene}{lidars}\n"
    )
    return FINE
