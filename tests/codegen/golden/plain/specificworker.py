"""What plain does.

Yours: rcgen wrote this file once and never touches it again.
"""

from __future__ import annotations

from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    """No two methods here ever run at once. While one waits for an answer from another
    component, a handler may run.
    """

    def initialize(self) -> None:
        """Called once, when the components required are there."""

    def compute(self) -> None:
        """Called every 100 ms."""
