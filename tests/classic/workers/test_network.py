"""Components of RoboComp's in a network with ours, as people start them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.testing.patience import SOON

from .components import ASKER, OF_2021, OF_2025, digests, made

OURS = """\
import "../new/Arm.idsl";
Component ours { Communications { requires Arm; }; language python; period 20 ms; };
"""
NET = """\
import "new/arm.cdsl"; import "old/arm.cdsl"; import "ours/ours.cdsl";
Deployment net
{
    Component server : arm { };
    Component client : asker { process both; };
    Component caller : ours { process both; };
};
"""

pytestmark = pytest.mark.tool


def test_a_network_has_components_of_both_kinds(tmp_path: Path) -> None:
    folders = [made(tmp_path / "new", OF_2021), made(tmp_path / "old", ASKER)]
    before = [digests(each) for each in folders]
    (tmp_path / "ours").mkdir()
    (tmp_path / "ours" / "ours.cdsl").write_text(OURS)
    assert rcgen([str(tmp_path / "ours" / "ours.cdsl")]) == 0
    worker = tmp_path / "ours" / "specificworker.py"
    text = worker.read_text()
    compute = "    def compute(self) -> None:\n        names = [each.name for each in self.arm_proxy.joints(2)]\n"
    worker.write_text(text[: text.index("    def compute")] + compute + '        self.log.info("found %s", names)\n')
    (tmp_path / "net.ddsl").write_text(NET)
    said = run("rcdeploy", str(tmp_path / "net.ddsl"), "--for", "1")
    assert "all 3 components of net are ready" in said
    assert "found ['0', '1']" in said
    assert "ERROR" not in said
    assert [digests(each) for each in folders] == before


def test_two_share_a_process_and_one_alone_runs_in_its_folder(tmp_path: Path) -> None:
    folder = made(tmp_path / "arm", OF_2025)
    worker = folder / "src" / "specificworker.py"
    once = "        self.number += 1\n        print('at', __import__('os').getcwd())\n        self.killYourSelf()\n"
    worker.write_text(worker.read_text().replace("        self.number += 1\n", once))
    alone = run("rc", "run", str(folder), "--middleware", "inproc")
    assert f"at {folder}\n" in alone
    both = run("rc", "run", str(folder), "--middleware", "inproc", "+", str(folder), "--name", "two")
    assert both.count(f"at {Path.cwd()}\n") == 2


def run(module: str, *arguments: str) -> str:
    """What a program prints that ends by itself, and well."""
    command = [sys.executable, "-m", f"robocomp_py.cli.{module}", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SOON * 6)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr
