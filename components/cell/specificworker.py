"""Simulates two arms at a conveyor, or at a table.

This file is yours: add handlers of other interfaces here.
"""

from __future__ import annotations

from robocomp_py.sim.serve.simulator import Simulator

from .generic.genericworker import GenericWorker


class SpecificWorker(Simulator, GenericWorker):
    """`self.world` is the scene."""
