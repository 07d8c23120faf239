"""The example network in virtual time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from robocomp_py.testing.patience import SOON
from robocomp_py.testing.simulation import Simulation

from ..seeds import SEEDS
from . import story
from .conftest import COMPONENTS

EARLY = 15.0
"""Seconds of a mission of 40 and more."""


def mission(folder: Path, seed: int) -> Simulation:
    picture = ("world", f'params.picture="{folder / "story.svg"}"')
    noise = ("world", f"params.seed={seed}")
    return Simulation(COMPONENTS / "rescue.ddsl", seed, settings=[picture, noise])


def early(folder: Path, seed: int) -> str:
    """The hash of all that was said early in a mission."""
    with mission(folder, seed) as sim:
        assert sim.run(EARLY)
        return sim.hash


def test_the_mission_succeeds_and_repeats(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    with mission(tmp_path, 1) as sim:
        assert sim.run(EARLY)
        first = sim.hash
        assert sim.run(until=sim["rescue"].is_over, at_most=60.0)
        assert 40.0 < sim.time < 55.0
    story.check(caplog.text)
    assert (tmp_path / "story.svg").read_text().startswith("<svg")
    assert early(tmp_path, 1) == first != early(tmp_path, 2)


def hash_in_process(seed: int, hash_seed: int) -> str:
    """The hash of the first seconds, in a process of its own with other hashes of texts."""
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", "simulate", str(COMPONENTS / "rescue.ddsl"), "--json"]
    command += ["--for", "3", "--seed", str(seed), "--set", f"world.params.seed={seed}"]
    environment = os.environ | {"PYTHONHASHSEED": str(hash_seed)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=12 * SOON)
    found: str = json.loads(done.stdout.splitlines()[-1])["hash"]
    return found


@pytest.mark.tool  # needs nothing but time
def test_every_seed_gives_a_hash_of_its_own_which_is_the_same_in_two_processes() -> None:
    with ThreadPoolExecutor(2) as processes:
        first, second = (list(processes.map(hash_in_process, SEEDS, [told] * len(SEEDS))) for told in (1, 2))
    assert first == second
    assert len(set(first)) == len(SEEDS)
