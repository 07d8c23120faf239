"""The example network in virtual time."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocomp_py.testing.simulation import Simulation

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
