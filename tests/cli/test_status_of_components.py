"""How components are, as `rcdeploy status` shows it: not only whether their processes run."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli import rcdeploy
from robocomp_py.testing.patience import SOON, wait_until


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=SOON * 6)


def test_an_emergency_and_a_step_longer_than_its_period_are_seen(tmp_path: Path) -> None:
    network = tmp_path / "plant.ddsl"
    network.write_text(
        'import "slow/slow.cdsl"; import "alarmed/alarmed.cdsl";\n'
        "Deployment plant { Component slow { }; Component alarmed { }; };\n"
    )
    for name, step in (("slow", "import time; time.sleep(0.25)"), ("alarmed", "self.goToEmergency()")):
        assert run("robocomp_py.cli.rcgen", "--new", name, "-o", tmp_path / name).returncode == 0
        worker = tmp_path / name / "specificworker.py"
        begin = "    def compute(self) -> None:\n"
        worker.write_text(worker.read_text().replace(begin, f"{begin}        {step}\n", 1))
    started = run("robocomp_py.cli.rcdeploy", "up", "--detach", network, "--set", "slow.component.period=0.05")
    assert started.returncode == 0, started

    def lives() -> dict[str, dict[str, Any]]:
        told = json.loads(run("robocomp_py.cli.rcdeploy", "status", network, "--json").stdout)
        return {name: life for each in told["processes"] for name, life in each["lives"].items()}

    try:
        wait_until(lambda: lives().get("slow", {}).get("overruns", 0) >= 8, SOON * 3)
        wait_until(lambda: lives().get("alarmed", {}).get("state") == "emergency", SOON * 3)
        shown = run("robocomp_py.cli.rcdeploy", "status", network, "--ports").stdout
    finally:
        run("robocomp_py.cli.rcdeploy", "down", network, "--now")
    assert "2 components, 2 ready, 1 in emergency" in shown
    assert "\nalarmed   emergency" in shown
    assert "overruns" in shown.splitlines()[1]
    assert shown.endswith("\nno instance of this network uses another one\n")


def test_a_run_time_folder_that_cannot_be_used_is_said_without_a_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    taken = tmp_path / "taken"
    taken.touch()
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(taken))
    assert rcdeploy.main(["status"]) == 1
    assert capsys.readouterr().err.startswith(f"rcdeploy: run-time folder {taken} needs a folder")
