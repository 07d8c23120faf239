"""Deploy a small network: both components started, watched and stopped by one command."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

from ... import process
from ..project import Project

TITLE = "deploy a small network"
PATIENCE = 60.0
"""Seconds in which one is heard by the other."""


def with_dsl(project: Project) -> None:
    project.write(
        "house.ddsl",
        """\
import "talker/talker.cdsl";
import "greeter/greeter.cdsl";

Deployment house
{
    Component talker { };
    Component greeter { };
};
""",
    )
    project.command = sys.executable, "-m", "robocomp_py.cli.rcdeploy", "house.ddsl"


def by_hand(project: Project) -> None:
    project.write(
        "house.sh",
        """\
# Starts both. They end with this script, and it ends with either of them.
trap 'kill $(jobs -p) 2> /dev/null; wait' EXIT
trap 'exit 130' INT
trap 'exit 143' TERM
python -m talker &
python -m greeter &
wait -n
exit 1
""",
    )
    project.command = "bash", "house.sh"


def behaves(project: Project) -> None:
    """One is heard by the other, and nothing is left of them when the command was asked to end."""
    assert project.command is not None, "nothing says how to start it"
    with process.folder() as runtime:
        mine = {"ROBOCOMP_RUNTIME_DIR": runtime, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
        network = subprocess.Popen(
            project.command,
            cwd=project.root,
            env=os.environ | mine,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert network.stdout is not None
        impatience = threading.Timer(PATIENCE, network.terminate)
        impatience.start()
        try:
            heard = any("talker" in line and "Good morning" in line for line in network.stdout)
        finally:
            network.terminate()
            rest = network.stdout.read()
            network.stdout.close()
            code = network.wait()
            impatience.cancel()
        assert heard, f"nobody was heard: {rest}"
        assert code == 143, f"it ended with {code}: {rest}"
        assert not _alive(runtime), "something runs on"


def _alive(runtime: str) -> list[int]:
    """The processes that were started for this run-time folder."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if f"ROBOCOMP_RUNTIME_DIR={runtime}".encode() in (folder / "environ").read_bytes().split(b"\0"):
                found.append(int(folder.name))
        except OSError:
            continue  # it has ended, or belongs to another user
    return found
