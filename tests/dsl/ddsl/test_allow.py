"""What an agent may do: the paths of `allow`, against the components of the network."""

from __future__ import annotations

import pytest

from robocomp_py.dsl.ddsl.allow import read_allow
from robocomp_py.dsl.diagnostics import Diagnostic, Report

from ..texts import FOLDER, workspace

FILES = {
    "Base_idsl": """module RoboCompBase { interface Base
        { void go(float x); [confirm] void brake(); [action] float drive(float x); float speed(); }; };""",
    "Danger_idsl": "module RoboCompDanger { interface Danger { [confirm] void cut(); }; };",
    "robot.cdsl": """import "Base.idsl"; import "Danger.idsl"; import "Laser.idsl"; import "LaserPub.idsl";
        import "Speed.idsl";
        Component robot { Communications { implements Base, Base, Danger, Laser each; requires Laser;
        publishes LaserPub; subscribesTo Speed; }; language python; };""",
    "Speed_idsl": "module RoboCompSpeed { interface Speed { void wanted(float v); [confirm] void boost(); }; };",
}
NETWORK = """import "robot.cdsl"; Deployment house
{
    allow %s;
    Component robot { offers front : Laser; };
    System left { Component arm : robot { %s }; };
};"""


def read(paths: str, clause: str = "") -> tuple[list[str], list[Diagnostic]]:
    """What is allowed, with its kind unless that is a call, and what is wrong with the paths."""
    found = workspace(**FILES, **{"net.ddsl": NETWORK % (paths, clause)})
    model = found.deployment(FOLDER / "net.ddsl")
    linked = found.component(FOLDER / "robot.cdsl")
    assert model is not None
    assert linked is not None
    assert [each.code for each in found.report.diagnostics] == []
    report = Report()
    allowed = read_allow(model, {each.name.text: linked.component for each in model.instances}, report)
    kinds = [each.pop("kind") for each in allowed]
    paths_ = ["/".join(filter(None, each.values())) for each in allowed]
    told = [path if kind == "call" else f"{kind} {path}" for path, kind in zip(paths_, kinds, strict=True)]
    return told, report.diagnostics


@pytest.mark.parametrize(
    ("paths", "clause", "allowed"),
    [
        ("robot/Base/go", "", ["robot/Base/go"]),
        ("/left/arm/Base1/speed, robot/Base/brake,", "", ["left/arm/Base1/speed", "robot/Base/brake"]),
        ("robot/Base", "", ["robot/Base/go", "robot/Base/speed", "goal robot/Base/drive"]),
        ("robot/Base, robot/Base/go", "", ["robot/Base/go", "robot/Base/speed", "goal robot/Base/drive"]),
        ("robot/Base/drive", "", ["goal robot/Base/drive"]),
        ("robot/Speed", "", ["publication robot/Speed/wanted"]),
        ("robot/Speed/boost", "allow Speed;", ["publication robot/Speed/boost", "publication left/arm/Speed/wanted"]),
        ("front/Laser/getLaserData", "", ["robot/front/Laser/getLaserData"]),
        ("robot/front/Laser/getLaserData", "", ["robot/front/Laser/getLaserData"]),
        ("robot/Danger/cut", "allow Base/go;", ["robot/Danger/cut", "left/arm/Base/go"]),
    ],
)
def test_a_path_allows_an_operation_or_those_of_an_interface_without_confirm(
    paths: str, clause: str, allowed: list[str]
) -> None:
    assert read(paths, clause) == (allowed, [])


@pytest.mark.parametrize(
    ("path", "code", "hint"),
    [
        ("robot/Base/spede", "unknown-operation", "did you mean `speed`?"),
        ("robot/Bsae/go", "unknown-port", "did you mean `Base`?"),
        ("robot/Camera", "unknown-port", "there are Base, Base1, Danger, Speed"),
        ("robot/Sped", "unknown-port", "did you mean `Speed`?"),
        ("robot/Speed/wnted", "unknown-operation", "did you mean `wanted`?"),
        ("front/Lasr", "unknown-port", "did you mean `Laser`?"),
        ("robot/LaserPub", "wrong-allow", "remove it: topics are read without being allowed"),
        ("robot/Danger", "wrong-allow", "name each: Danger/cut"),
        ("robot/Laser", "wrong-allow", "write front/Laser"),
        ("front/Base", "wrong-allow", "write robot/Base"),
    ],
)
def test_what_a_component_neither_serves_nor_hears_cannot_be_allowed(path: str, code: str, hint: str) -> None:
    allowed, diagnostics = read(path)
    assert (allowed, [(each.code, each.hint) for each in diagnostics]) == ([], [(code, hint)])
    assert diagnostics[0].span.text in path.split("/")
