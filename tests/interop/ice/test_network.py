"""Networks whose topics go over Ice: `rcdeploy` runs IceStorm for them, and nothing is left of it."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.testing.patience import SOON, wait_until
from tests.transports.ice.icestorm import free_storm, place_of, process_of

pytestmark = pytest.mark.tool

HERE = Path(__file__).parent
HEARS = """
import "Readings.idsl";

Component hearing { Communications { subscribesTo Readings; }; language python; };
"""
SAYS = """
    def compute(self) -> None:
        self.readings_proxy.silence()
"""
NETWORK = """
import "station/station.cdsl";
import "hearing/hearing.cdsl";

Deployment %s
{
    Component station : station { };
    Component hearing : hearing { };
};
"""


@pytest.fixture
def storm() -> str:
    return free_storm()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A component that publishes, and one that tells what it hears."""
    folder = tmp_path_factory.mktemp("network")
    shutil.copy(HERE / "Readings.idsl", folder)
    says = (HERE / "station.cdsl").read_text().replace("python;", "python; period 20 ms;")
    for name, text in {"station": says, "hearing": HEARS}.items():
        (folder / name).mkdir()
        (folder / name / f"{name}.cdsl").write_text(text.replace('"Readings', '"../Readings'))
        assert rcgen([str(folder / name / f"{name}.cdsl"), "--middleware", "ice"]) == 0
    worker = folder / "station" / "specificworker.py"
    text = worker.read_text()
    worker.write_text(text[: text.index("    def compute")] + SAYS.lstrip("\n"))
    worker = folder / "hearing" / "specificworker.py"
    said = 'def Readings_silence(self) -> None:\n        self.log.info("heard")\n        return\n'
    worker.write_text(worker.read_text().replace("def Readings_silence(self) -> None:\n", said))
    return folder


@contextlib.contextmanager
def deployed(made: Path, name: str, storm: str) -> Iterator[tuple[subprocess.Popen[str], list[str]]]:
    """A network of that name, with a run-time folder of its own, and what is said by it."""
    folder = made / f"run-{name}"
    folder.mkdir(mode=0o700)
    network = made / f"{name}.ddsl"
    network.write_text(NETWORK % name)
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", str(network)]
    for each in ("station", "hearing"):
        command += ["--set", f"{each}.transports.ice.storm={storm}"]
    lines: list[str] = []

    def read() -> None:
        lines.extend(process.stdout or ())

    with subprocess.Popen(
        command,
        env=os.environ | {"ROBOCOMP_RUNTIME_DIR": str(folder)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        reader = threading.Thread(target=read)
        reader.start()
        try:
            yield process, lines
        finally:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(SOON * 3)
            finally:
                process.kill()
                reader.join(SOON)


def answers(storm: str) -> bool:
    return place_of(storm).answers()


def until_said(what: str, lines: list[str], times: int = 1) -> None:
    wait_until(lambda: sum(what in line for line in list(lines)) >= times, SOON * 9, f"{what!r} {times} times: {lines}")


def test_rcdeploy_runs_icestorm_as_long_as_the_network_runs(made: Path, storm: str) -> None:
    with deployed(made, "alone", storm) as (_, lines):
        until_said("heard", lines)
        pid = process_of(storm)
    assert not Path(f"/proc/{pid}").exists()


def test_an_icestorm_that_dies_is_reported_and_replaced_and_components_continue(made: Path, storm: str) -> None:
    with deployed(made, "robust", storm) as (_, lines):
        until_said("heard", lines)
        os.kill(process_of(storm), signal.SIGKILL)
        until_said("was killed by SIGKILL; starting it again", lines)
        until_said("IceStorm answers again", lines)
        until_said("heard", lines, sum("heard" in line for line in lines) + 5)


def test_of_a_deployer_that_is_killed_no_icestorm_is_left(made: Path, storm: str) -> None:
    with deployed(made, "killed", storm) as (process, lines):
        until_said("heard", lines)
        process.kill()
        wait_until(lambda: not answers(storm))


def test_of_two_networks_that_share_one_the_second_goes_on_without_the_first(made: Path, storm: str) -> None:
    with contextlib.ExitStack() as first, deployed_after(first, made, storm) as lines:
        until_said("heard", lines)
        first.close()
        until_said("heard", lines, sum("heard" in line for line in lines) + 5)


@contextlib.contextmanager
def deployed_after(first: contextlib.ExitStack, made: Path, storm: str) -> Iterator[list[str]]:
    _, lines = first.enter_context(deployed(made, "one", storm))
    until_said("heard", lines)
    with deployed(made, "two", storm) as (_, others):
        yield others
