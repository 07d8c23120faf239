"""Actions over each transport; Ice has its own file, because it needs IceStorm."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocomp_py.testing.actions import ActionsConformance
from tests.transports.over import OverDDS, OverInproc, OverShm, OverZenoh, OverZeroMQ


@pytest.fixture(autouse=True)
def alone(own_runtime_folder: Path) -> None:
    """No test meets the components of another one."""


class TestInproc(OverInproc, ActionsConformance):
    pass


class TestShm(OverShm, ActionsConformance):
    pass


class TestZeroMQ(OverZeroMQ, ActionsConformance):
    pass


class TestDDS(OverDDS, ActionsConformance):
    pass


class TestZenoh(OverZenoh, ActionsConformance):
    pass
