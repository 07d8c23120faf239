"""Networks with systems, run: two halves of a robot that are made of the same components."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.testing.patience import SOON

ASKER = """
import "../hello/Hello.idsl";
Component asker { Communications { requires Hello; }; language python; };
"""
WORKER = """
    def initialize(self) -> None:
        self.log.info("was told: %s", self.hello_proxy.greet("Ada"))

    def compute(self) -> None:
        self.stop()
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("systems")
    assert rcgen(["--new", "Hello", "-o", str(root / "hello")]) == 0
    (root / "asker").mkdir()
    (root / "asker" / "asker.cdsl").write_text(ASKER)
    assert rcgen([str(root / "asker" / "asker.cdsl")]) == 0
    worker = root / "asker" / "specificworker.py"
    head, _, _ = worker.read_text().partition("    def ")
    worker.write_text(head.rstrip() + "\n" + WORKER)
    for side in ("left", "right"):
        (root / f"{side}.toml").write_text(f'[params]\ngreeting = "{side} says hello to"\n')
    return root


def run(folder: Path, body: str, *options: str) -> str:
    path = folder / "net.ddsl"
    path.write_text(f'import "hello/hello.cdsl"; import "asker/asker.cdsl"; Deployment net {{ {body} }};')
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", str(path), *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SOON * 6)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_each_half_uses_its_own_instances_by_default(folder: Path) -> None:
    body = """
    namespace robot1; middleware zeromq;
    System left { Component hello { config "left.toml"; }; Component asker { }; };
    System right { Component hello { config "right.toml"; }; Component asker { requires Hello from left/hello; }; };
    System third { System inner { Component asker { requires Hello from right/hello; }; }; };
    """
    said = run(folder, body, "--for", "0")
    for who, whom in (("left/asker", "left"), ("right/asker", "left"), ("third/inner/asker", "right")):
        assert f"was told: {whom} says hello to, Ada!" in next(
            line for line in said.splitlines() if who in line and "was told" in line
        )


def test_several_of_a_system_may_share_a_process_and_the_network_knows_them(folder: Path) -> None:
    body = """
    System left
    {
        Component hello { process both; config "left.toml"; };
        Component asker { process both; dependences hello; };
    };
    """
    said = run(folder, body, "--until", "left/asker")
    assert "left/both" in said
    assert "was told: left says hello to, Ada!" in said
