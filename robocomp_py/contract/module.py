"""What an IDSL module defines, resolved: the unit that becomes one Python module."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .interface import Interface
from .types import Dictionary, Enumeration, ExceptionType, Sequence, Struct, Type


@dataclass(frozen=True)
class Constant:
    name: str
    type: Type
    value: Any
    doc: str = field(default="", compare=False, repr=False)


Definition = Struct | Enumeration | Sequence | Dictionary | ExceptionType | Constant | Interface


@dataclass(frozen=True)
class Module:
    """Definitions in an order in which each comes after those it uses. All names are qualified."""

    name: str
    definitions: tuple[Definition, ...]
    files: tuple[str, ...] = ()
    """The names of the IDSL files it was read from."""
