"""Shows topics in Foxglove."""

from __future__ import annotations

from ...errors import ConfigurationError


def need_foxglove() -> None:
    """Raises ConfigurationError if the library is missing."""
    try:
        import foxglove  # noqa: F401
    except ImportError as exc:
        raise ConfigurationError("this needs foxglove-sdk; run: pip install 'robocomp-py[foxglove]'") from exc
