"""The code of plain.

This file is yours: rcgen wrote it once and never changes it again.
"""

from __future__ import annotations

from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    """Only one method runs at a time. While it waits for the reply of another
    component, a handler may run.
    """

    def initialize(self) -> None:
        """Called once, when all required components are visible."""

    def compute(self) -> None:
        """Called every 100 ms."""
