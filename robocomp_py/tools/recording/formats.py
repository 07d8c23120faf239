"""Imports the library that reads and writes MCAP, an extra."""

from __future__ import annotations

from importlib import import_module

from ...errors import ConfigurationError

COMPRESSIONS = ("none", "lz4", "zstd")


def need_mcap() -> None:
    """Raise ConfigurationError if the extra is missing."""
    for name in ("mcap.records", "lz4.frame", "zstandard"):
        try:
            import_module(name)
        except ImportError as exc:
            raise ConfigurationError(
                f"recordings need {name.partition('.')[0]}: pip install 'robocomp-py[record]'"
            ) from exc
