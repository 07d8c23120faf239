"""An interface is changed, and its components generated again, while the network runs."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.testing.patience import SOON, wait_until

Said = pytest.CaptureFixture[str]

IDSL = "module Weather { interface Readings { void reading(float degrees); }; };"
MANY = "".join(
    f"void readingOfTheThermometerOnTheOtherSideOfTheHouse{number}(float degrees); " for number in range(500)
)
CDSL = 'import "../Readings.idsl"; Component %s { Communications { %s Readings; }; language python; };'
NETWORK = """
import "thermo/thermo.cdsl"; import "reader/reader.cdsl";
Deployment weather {
    Component east : thermo { restart on_failure; };
    Component eyes : reader { };
};
"""


@pytest.fixture
def network(tmp_path: Path, own_runtime_folder: Path, request: pytest.FixtureRequest) -> Iterator[Path]:
    (tmp_path / "Readings.idsl").write_text(IDSL.replace("void", f"{getattr(request, 'param', '')}void"))
    for name, verb in (("thermo", "publishes"), ("reader", "subscribesTo")):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}.cdsl").write_text(CDSL % (name, verb))
    path = tmp_path / "weather.ddsl"
    path.write_text(NETWORK)
    assert rcgen([str(path)]) == 0
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", "up", str(path), "--detach"]
    assert subprocess.run(command, timeout=SOON * 6).returncode == 0
    yield path
    rcdeploy(["down", str(path), "--now"])


def change(network: Path) -> None:
    (network.parent / "Readings.idsl").write_text(IDSL.replace("float", "double"))
    assert rcgen([str(network)]) == 0


def ask(said: Said, *arguments: object) -> tuple[int, str]:
    said.readouterr()
    code = rcdeploy([str(each) for each in arguments])
    captured = said.readouterr()
    return code, captured.out + captured.err


def test_instances_with_an_older_contract_are_listed_with_what_to_restart_together(network: Path, capsys: Said) -> None:
    code, said = ask(capsys, "status", network)
    assert (code, "contract" in said) == (0, False)
    change(network)

    code, said = ask(capsys, "plan", network)
    assert code == 0
    assert "matches the running network" not in said
    for name in ("east", "eyes"):
        assert f"~ {name}: contract, of which it runs an older one\n    - Weather::Readings.reading " in said

    code, said = ask(capsys, "status", network)
    assert code == 0, "all of them still understand each other"
    assert "east runs an older contract of `Readings` than the generated one" in said
    assert "eyes runs an older contract of `Readings` than the generated one" in said
    assert said.endswith(f"rcdeploy restart {network} east eyes\n")

    code, said = ask(capsys, "restart", network, "east")
    assert code == 1
    assert "nothing was restarted" in said
    assert "eyes runs an older contract of Readings" in said
    assert said.endswith(f"rcdeploy restart {network} east eyes\n")

    assert ask(capsys, "restart", network, "east", "eyes")[0] == 0
    code, said = ask(capsys, "status", network)
    assert (code, "contract" in said) == (0, False)
    assert ask(capsys, "plan", network)[1].endswith("weather matches the running network\n")


@pytest.mark.parametrize("network", [MANY], indirect=True)
def test_a_component_with_hundreds_of_operations_runs_the_contract_that_is_generated(
    network: Path, capsys: Said
) -> None:
    code, said = ask(capsys, "status", network)
    assert (code, "contract" in said) == (0, False)
    assert ask(capsys, "plan", network)[1].endswith("weather matches the running network\n")
    operations = json.loads(ask(capsys, "status", network, "--json")[1])["processes"][0]["contracts"]["east"]
    assert len(operations) == 501


def test_an_instance_that_failed_and_was_started_again_with_a_newer_contract_is_reported(
    network: Path, capsys: Said
) -> None:
    change(network)

    def east() -> dict[str, object]:
        found: dict[str, object] = json.loads(ask(capsys, "status", network, "--json")[1])["processes"][0]
        return found

    pid = east()["pid"]
    assert isinstance(pid, int)
    os.kill(pid, signal.SIGKILL)
    wait_until(lambda: east()["starts"] == 2 and east()["state"] == "ready")
    code, said = ask(capsys, "status", network)
    assert code == 1
    assert "eyes uses `Readings` of east, but they have different contracts of it" in said
    assert "eyes runs an older contract" in said
    assert "east runs an older contract" not in said
    assert ask(capsys, "restart", network, "eyes")[0] == 0
    assert ask(capsys, "status", network)[0] == 0
