"""Declared exceptions, as tools get them: without generated classes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..contract.types import ExceptionType
from ..errors import RobocompError


class ThrownError(RobocompError):
    """The server raised an exception that the operation declares."""

    def __init__(self, kind: ExceptionType, values: Sequence[Any]) -> None:
        super().__init__(kind.name)
        self.kind, self.values = kind, tuple(values)
