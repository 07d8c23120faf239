"""Goals in a network with keys, whose client awaits them in asyncio code."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.testing.patience import SOON
from tests.actions import flight

NET = """
import "ship/ship.cdsl";
import "crew/crew.cdsl";

Deployment Flight
{
    security lan;
    middleware %s;
    Component ship { };
    Component crew { };
};
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    flight.write(folder)
    return folder


@pytest.mark.parametrize("middleware", ["shm", "zeromq", "zenoh"])
def test_goals_are_awaited_with_keys(
    folder: Path, middleware: str, own_runtime_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    net = folder / f"{middleware}.ddsl"
    net.write_text(NET % middleware)
    rcdeploy("keys", str(net))
    said = rcdeploy(str(net), "--until", "crew")
    for line in flight.TOLD:
        assert line in said, said


def rcdeploy(*arguments: str) -> str:
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=6 * SOON)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr
