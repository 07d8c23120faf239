"""Networks of a few generated components, for what plans them."""

from __future__ import annotations

from pathlib import Path

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.deploy.plan import Overrides, Plan
from robocomp_py.deploy.planner import make_plan
from robocomp_py.dsl.diagnostics import Diagnostic
from robocomp_py.dsl.workspace import Workspace

SENSOR = """
import "Laser.idsl"; import "LaserPub.idsl";
Component sensor { Communications { implements Laser; publishes LaserPub; }; language python; params "sensor.pdsl"; };
"""
PARAMS = 'ComponentParams sensor { range "m" float 10 0:30; };'
DRIVER = """
import "Laser.idsl"; import "LaserPub.idsl";
Component driver { Communications { requires Laser; subscribesTo LaserPub; }; language python; };
"""
FUSION = """
import "Laser.idsl";
Component fusion { Communications { requires Laser, Laser; }; language python; };
"""
FILTER = """
import "LaserPub.idsl";
Component filter { Communications { publishes LaserPub; subscribesTo LaserPub; }; language python; };
"""
RECORDER = """
import "LaserPub.idsl";
Component recorder { Communications { subscribesTo LaserPub qos(reliable); }; language python; };
"""

NAMES = ("sensor", "driver", "fusion", "recorder", "filter")


def generate(root: Path) -> None:
    """Five components."""
    for name, text in zip(NAMES, (SENSOR, DRIVER, FUSION, RECORDER, FILTER), strict=True):
        (root / name).mkdir()
        (root / name / f"{name}.cdsl").write_text(text)
        (root / name / "sensor.pdsl").write_text(PARAMS)
        assert rcgen([str(root / name / f"{name}.cdsl")]) == 0


def plan(folder: Path, body: str, overrides: Overrides | None = None) -> tuple[Plan | None, list[Diagnostic]]:
    path = folder / "net.ddsl"
    imports = "".join(f'import "{name}/{name}.cdsl";\n' for name in NAMES)
    path.write_text(f"{imports}Deployment net {{\n{body}\n}};\n")
    workspace = Workspace()
    found = make_plan(path, workspace, overrides)
    return found, workspace.report.diagnostics


def planned(folder: Path, body: str, overrides: Overrides | None = None) -> Plan:
    found, diagnostics = plan(folder, body, overrides)
    assert found is not None, [each.message for each in diagnostics]
    return found


def errors(folder: Path, body: str, overrides: Overrides | None = None) -> list[str]:
    """The codes of what is wrong, which must make it impossible to start."""
    found, diagnostics = plan(folder, body, overrides)
    wrong = [each.code for each in diagnostics if each.severity == "error"]
    assert (found is None) == bool(wrong)
    return wrong


def command(found: Plan | None, name: str) -> str:
    assert found is not None
    return " ".join(next(each.command for each in found.processes if each.name == name))
