"""Imports the shipped components under their names, as `rc run` does, so that tests can import their files."""

from __future__ import annotations

from pathlib import Path

from robocomp_py.testing.components import load_component

COMPONENTS = Path(__file__).parents[2] / "components"

for name in ("camera", "rescue", "speech", "wander", "world2d"):
    load_component(COMPONENTS / name)
