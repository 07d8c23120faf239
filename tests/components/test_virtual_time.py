"""The example network in virtual time."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocomp_py.testing.simulation import Simulation

from . import story
from .conftest import COMPONENTS


def run(folder: Path, seed: int) -> str:
    """Run the mission to its end; returns the hash of all that was said."""
    picture = ("world", f'params.picture="{folder / "story.svg"}"')
    noise = ("world", f"params.seed={seed}")
    with Simulation(COMPONENTS / "rescue.ddsl", seed, settings=[picture, noise]) as sim:
        assert sim.run(until=sim["rescue"].is_over, at_most=60.0)
        assert 40.0 < sim.time < 55.0
    return sim.hash


def test_the_mission_succeeds_and_repeats(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    first = run(tmp_path, 1)
    story.check(caplog.text)
    assert (tmp_path / "story.svg").read_text().startswith("<svg")
    assert run(tmp_path, 1) == first != run(tmp_path, 2)
