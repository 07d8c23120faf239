"""Finds the records of flat structs. Their module needs numpy, so it is imported with the first of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..contract.types import Struct

if TYPE_CHECKING:
    from .records import Records


def flat_records(kind: Any) -> Records | None:
    """The records of a type, if it is a flat struct."""
    return records(kind) if isinstance(kind, Struct) and kind.is_flat else None


def records(kind: Struct) -> Records:
    """The `Records` of a flat struct, made once."""
    from . import records as module

    return module.records(kind)
