"""A network starts and stops in the order that `requires` makes, without `dependences`."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.testing.patience import SOON

IDSL = "module Ask { interface Asking { int ask(); }; };"
CDSL = 'import "../Ask.idsl"; Component %s { Communications { %s Asking; }; language python; period 5 ms; };'
CLIENT = """
    def compute(self) -> None:
        self.asking_proxy.ask()

    def finish(self) -> None:
        self.asking_proxy.ask()
"""
SERVER = """
    def initialize(self) -> None:
        self.log.info("gets ready")

    def Asking_ask(self) -> int:
        return 42
"""
BOTH = (
    'import "../Ask.idsl"; Component %s { Communications { implements Asking; requires Asking; }; language python; };'
)


def component(folder: Path, name: str, cdsl: str, code: str) -> None:
    (folder / name).mkdir()
    (folder / name / f"{name}.cdsl").write_text(cdsl)
    assert rcgen([str(folder / name / f"{name}.cdsl")]) == 0
    worker = folder / name / "specificworker.py"
    head, marker, _ = worker.read_text().partition("    def ")
    assert marker
    worker.write_text(head + code.lstrip("\n"))


def lines(path: Path, *options: str) -> list[str]:
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", str(path), "--for", "0.3", *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SOON * 6)
    assert done.returncode == 0, done.stdout + done.stderr
    return [re.sub(r"^[\d:.]+ ", "", line).strip() for line in (done.stderr + done.stdout).splitlines()]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "Ask.idsl").write_text(IDSL)
    component(tmp_path, "client", CDSL % ("client", "requires"), CLIENT)
    component(tmp_path, "server", CDSL % ("server", "implements"), SERVER)
    return tmp_path


@pytest.mark.parametrize("shared", ["", "process one;"])
def test_clients_are_ready_after_their_server_and_stop_before_it_without_a_warning(folder: Path, shared: str) -> None:
    path = folder / "net.ddsl"
    path.write_text(
        'import "client/client.cdsl"; import "server/server.cdsl"; Deployment net {'
        f"Component a : client {{ {shared} }}; Component b : client {{ {shared} }};"
        f"Component server {{ {shared} }}; }};"
    )
    said = lines(path)
    told = [index for index, line in enumerate(said) if "gets ready" in line or line.endswith("ready")]
    assert "server" in said[told[0]]
    assert "server" in said[told[1]], "it was ready before any client"
    end = next(index for index, line in enumerate(said) if "stopping: time limit reached" in line)
    late = "longer than the period"  # on a busy machine, a step takes longer than 5 ms
    assert [line for line in said[end + 1 :] if late not in line] == []


def test_a_circle_of_requirements_is_reported_and_starts_nevertheless(folder: Path) -> None:
    for name in ("left", "right"):
        component(folder, name, BOTH % name, "    def Asking_ask(self) -> int:\n        return 1\n")
    path = folder / "circle.ddsl"
    path.write_text(
        'import "left/left.cdsl"; import "right/right.cdsl"; Deployment circle {'
        "Component left { requires Asking from right; }; Component right { requires Asking from left; }; };"
    )
    (note,) = [line for line in lines(path) if line.startswith("note: these require each other")]
    assert note.startswith("note: these require each other and start at the same time: left, right; ")
