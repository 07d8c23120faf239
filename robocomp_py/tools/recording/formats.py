"""Imports the library that reads and writes MCAP, an extra."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ...errors import ConfigurationError

if TYPE_CHECKING:
    from mcap.writer import CompressionType

COMPRESSIONS = ("none", "lz4", "zstd")


def need_mcap() -> None:
    """Raise ConfigurationError if the extra is missing."""
    for name in ("mcap.writer", "lz4.frame", "zstandard"):
        try:
            import_module(name)
        except ImportError as exc:
            raise ConfigurationError(
                f"recordings need {name.partition('.')[0]}: pip install 'robocomp-py[record]'"
            ) from exc


def compression(name: str) -> CompressionType:
    from mcap.writer import CompressionType

    kinds: dict[str, Any] = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
    found: CompressionType = kinds[name]
    return found
