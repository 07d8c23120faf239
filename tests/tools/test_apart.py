"""Tools know of a network only what it announces: they import nothing of it, and no part that reads models."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.testing.patience import SOON

from ..cli.programs import running

COMPONENTS = Path(__file__).parents[2] / "components"

TOOL = f"""
import json, sys
from robocomp_py.cli.rc import main
code = main(sys.argv[1:])
files = [str(getattr(each, "__file__", "")) for each in list(sys.modules.values())]
ours = [each for each in sys.modules if each.startswith(("robocomp_py.dsl", "robocomp_py.codegen", "lark", "jinja2"))]
print(json.dumps([code, [each for each in files if {str(COMPONENTS)!r} in each], ours]), file=sys.stderr)
"""


@pytest.fixture(scope="module")
def rescue(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with nothing of the network, which runs. The mission does not end: nothing is found without a pose."""
    folder = tmp_path_factory.mktemp("apart")
    sets = (
        "--set",
        'world.params.picture=""',
        "--set",
        "world.params.battery=100",
        "--set",
        "wander.params.speed=0.1",
    )
    arguments = (COMPONENTS / "rescue.ddsl", "--log-dir", folder / "logs", *sets)
    with running("rcdeploy", *arguments) as network:
        network.wait_for("all 5 components of rescue are ready")
        (folder / "empty").mkdir()
        yield folder / "empty"
        network.terminate()


def tool(folder: Path, *words: str) -> str:
    """What a command prints, as a process that can import only what is installed."""
    environment = {name: text for name, text in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, "-I", "-c", TOOL, *words]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=SOON * 3)
    code, of_the_network, of_models = json.loads(done.stderr.splitlines()[-1])
    assert (code, of_the_network, of_models) == (0, [], []), done.stderr
    return done.stdout


def test_components_are_listed(rescue: Path) -> None:
    owners = [json.loads(line)["owner"] for line in tool(rescue, "list", "--json").splitlines()]
    assert owners == ["camera", "rescue", "speech", "wander", "world"]


def test_a_topic_is_heard_and_measured(rescue: Path) -> None:
    [line] = tool(rescue, "echo", "world/LaserPub", "-n", "1", "--json").splitlines()
    beams = json.loads(line)["message"]["laserData"]
    assert len(beams) == 91
    assert beams[0].keys() == {"angle", "dist"}
    assert "world/LaserPub/pushLaserData over " in tool(rescue, "hz", "LaserPub", "--for", "2")


def test_operations_are_called(rescue: Path) -> None:
    """With values of all kinds, and with an exception that another module declares."""
    pose = {"x": 5, "z": 6, "alpha": 0.5}
    assert tool(rescue, "call", "world/DifferentialRobot/setOdometerPose", json.dumps(pose)) == ""
    told = json.loads(tool(rescue, "call", "world/DifferentialRobot/getBasePose"))
    assert told.keys() == pose.keys()
    assert tool(rescue, "call", "speech/Speech/say", "text=hello", "overwrite=true") == "true\n"
    refused = [
        sys.executable,
        "-m",
        "robocomp_py.cli.rc",
        "call",
        "world/DifferentialRobot/setSpeedBase",
        "adv=NaN",
        "rot=0",
    ]
    done = subprocess.run(refused, cwd=rescue, capture_output=True, text=True, timeout=SOON * 3)
    assert done.returncode == 1
    assert done.stderr == 'rc call: RoboCompGenericBase.HardwareFailedException: {"what": "speeds must be finite"}\n'


def test_a_contract_is_shown_and_a_message_published(rescue: Path) -> None:
    assert "void pushLaserData(sequence<TData> laserData);" in tool(rescue, "info", "world/LaserPub")
    scan = {"laserData": [{"angle": 0.0, "dist": 1.0}]}
    assert tool(rescue, "pub", "world/LaserPub", json.dumps(scan)) == ""
