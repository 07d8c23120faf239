"""A robot is moved one component at a time: ports over Ice to programs of RoboComp's, others over something else."""

from __future__ import annotations

import contextlib
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.deploy.place import Place
from robocomp_py.testing.patience import SOON, wait_until
from tests.freeports import free_ports

from ...leftovers import killed_on_failure

pytestmark = pytest.mark.tool

PEER = Path(__file__).with_name("gauge.py")

GAUGE = """
module RoboCompGauge
{
    struct Reading { float value; sequence<int> raw; };
    exception Broken { string why; };
    interface Gauge { idempotent Reading read(int number) throws Broken; };
    interface Report { string tell(int number) throws Broken; };
};
"""
VOICE_IDSL = "module RoboCompVoice { interface Voice { string say(string words); }; };"
WORKER = """
import "Gauge.idsl"; import "Voice.idsl";
Component worker
{
    Communications { requires Gauge(ice), Voice; implements Report(ice); };
    language python;
};
"""
VOICE = 'import "Voice.idsl"; Component voice { Communications { implements Voice; }; language python; };'
PROGRAM = 'import "Gauge.idsl"; Component gauge { Communications { implements Gauge(ice); }; language python; };'

WORKER_PY = """
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def Report_tell(self, number):
        reading = self.gauge_proxy.read(number)
        words = f"{reading.value} {[int(each) for each in reading.raw]}"
        return self.voice_proxy.say(words)
"""
VOICE_PY = """
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def Voice_say(self, words):
        return f"<{words}>"
"""
SAID = ["told <3.5 [7, 7, 7]>", "broken: there is no -1"]


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two components, and what slice2py made of their interfaces."""
    root = tmp_path_factory.mktemp("robot")
    for name, text in {"Gauge.idsl": GAUGE, "Voice.idsl": VOICE_IDSL, "gauge.cdsl": PROGRAM}.items():
        (root / name).write_text(text)
    for name, text, code in (("worker", WORKER, WORKER_PY), ("voice", VOICE, VOICE_PY)):
        folder = root / name
        folder.mkdir()
        (folder / f"{name}.cdsl").write_text(text)
        assert rcgen([str(folder / f"{name}.cdsl"), "-I", str(root)]) == 0
        (folder / "specificworker.py").write_text(code)
        (folder / "etc" / "config.toml").unlink()
    (root / "slice").mkdir()
    assert rcgen([str(root / "Gauge.idsl"), "--to", "slice", "-o", str(root / "slice")]) == 0
    slices = [str(path) for path in (root / "slice").glob("*.ice")]
    subprocess.run(["slice2py", "--output-dir", str(root / "slice"), *slices], check=True)
    return root


def peer(robot: Path, *arguments: object) -> list[str]:
    """Its command line, in an interpreter in which an import of ours is an error."""
    guarded = "import runpy, sys; sys.modules['robocomp_py'] = None; del sys.argv[0]; runpy.run_path(sys.argv[0])"
    return [sys.executable, "-I", "-c", guarded, str(PEER), str(robot / "slice"), *map(str, arguments)]


def rcdeploy(*arguments: object) -> None:
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SOON * 6, check=False)
    assert done.returncode == 0, done.stderr


def asked(robot: Path, port: int) -> list[str]:
    """What the worker reports to a program of Ice."""
    command = peer(robot, "ask", f"report:tcp -h localhost -p {port}")
    done = subprocess.run(command, capture_output=True, text=True, timeout=SOON * 6, check=False)
    return done.stdout.splitlines() or done.stderr.splitlines()


@contextlib.contextmanager
def started(command: list[str], cwd: Path, says: str) -> Iterator[None]:
    """While a program runs, which has said that it is ready."""
    with killed_on_failure(command, cwd=cwd, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as program:
        try:
            assert program.stdout
            lines = iter(program.stdout.readline, "")
            assert any(says in line for line in lines), f"{command} ended with {program.wait()}"
            yield
        finally:
            program.terminate()
            program.communicate(timeout=SOON * 3)


def test_a_component_finds_and_serves_over_ice_what_its_old_configuration_says(robot: Path) -> None:
    """And reaches what was moved already over ZeroMQ."""
    at_gauge, at_report = free_ports(2)
    (robot / "worker" / "etc" / "config").write_text(
        f"GaugeProxy = gauge:tcp -h localhost -p {at_gauge}\n"
        f"Report.Endpoints = tcp -p {at_report}\n"
        "VoiceProxy = voice:tcp -h localhost -p 1\n"
        "Ice.Warn.Connections = 0\n"
    )
    run = [sys.executable, "-m", "robocomp_py.cli.rc", "run"]
    with contextlib.ExitStack() as running:
        running.enter_context(started(peer(robot, "serve", at_gauge), robot, "serving"))
        running.enter_context(started([*run, "voice"], robot, "ready"))
        running.enter_context(started([*run, "worker"], robot, "ready"))
        assert asked(robot, at_report) == SAID
    (robot / "worker" / "etc" / "config").unlink()


def test_a_network_of_both_kinds_is_started_and_wired_by_rcdeploy(robot: Path) -> None:
    at_gauge, at_report = free_ports(2)
    script = robot / "gauge.sh"
    script.write_text(f"#!/bin/sh\nexec {shlex.join(peer(robot, 'serve', at_gauge))}\n")
    script.chmod(0o755)
    net = robot / "mixed.ddsl"
    net.write_text(f"""
import "gauge.cdsl"; import "worker/worker.cdsl"; import "voice/voice.cdsl";
Deployment mixed
{{
    Component gauge {{ path "gauge.sh"; port {at_gauge}; }};
    Component worker {{ port {at_report}; dependences gauge; }};
    Component voice {{ }};
}};
""")
    try:
        rcdeploy("up", net, "--detach", "-I", robot)
        assert asked(robot, at_report) == SAID
    finally:
        rcdeploy("down", "mixed")
        wait_until(lambda: Place("mixed").runner() is None)
