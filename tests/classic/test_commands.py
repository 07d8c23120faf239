"""What the commands make of RoboComp's own configurations."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.deploy.hosts.bundle import collect

from ..cli.test_lint import EXPLORER, lint
from ..runtime.test_main import started


@pytest.fixture
def hello(tmp_path: Path) -> Path:
    """A generated component."""
    folder = tmp_path / "hello"
    assert rcgen(["--new", "Hello", "-o", str(folder)]) == 0
    return folder


def test_a_configuration_written_for_robocomp_is_read_and_said_to_be_one(hello: Path, tmp_path: Path) -> None:
    told: list[str] = []
    classic = tmp_path / "config"
    classic.write_text("Ice.Warn.Connections = 0\ngreeting = Hi # there\nno key\nPeriod.Compute = 5\n")
    with started("robocomp_py.cli.rc", "run", str(hello), "--config", str(classic), before=told) as process:
        process.send_signal(signal.SIGINT)
    assert any("config:3: no `key = value`" in line for line in told)
    assert any("written for RoboComp; without effect here: Ice.Warn.Connections" in line for line in told)


def test_a_configuration_of_robocomp_is_checked_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "etc").mkdir()
    (tmp_path / "explorer.pdsl").write_text(EXPLORER)
    (tmp_path / "explorer.cdsl").write_text(
        'import "Laser.idsl";\n'
        'Component explorer { Communications { requires Laser; }; language python; params "explorer.pdsl"; };'
    )
    config = tmp_path / "etc" / "configSimulator"
    config.write_text("LaserProxy = laser:tcp -p 1\nmax_speed = 5 # m/s\ndevice = x\nwhat is this\n")
    assert [each[:4] for each in lint(capsys, config)] == [
        ("warning[config-without-effect]", 1, 1, 28),
        ("error[config-out-of-range]", 2, 13, 14),
        ("warning[config-not-understood]", 4, 1, 13),
    ]


def test_keys_that_an_existing_component_is_given_are_not_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, text in {
        "old.cdsl": "Component old { language python; };",
        "src/specificworker.py": "from genericworker import *\nclass SpecificWorker(GenericWorker): pass\n",
        "etc/generic_config": "Period = 50\nspeed = 7\nIce.Warn.Connections = 0\n",
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    found = [each[:2] for each in lint(capsys, tmp_path / "etc" / "generic_config")]
    assert found == [("warning[config-without-effect]", 3)]


def test_what_runs_components_of_robocomp_is_sent_to_hosts() -> None:
    assert "robocomp_py/classic/workers/existing.py" in collect({})
