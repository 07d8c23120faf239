"""Gives agents, such as language models, a running network over the Model Context Protocol."""

from __future__ import annotations

from ...errors import ConfigurationError


def need_mcp() -> None:
    """Raises ConfigurationError if the library is missing."""
    try:
        import mcp  # noqa: F401
    except ImportError as exc:
        raise ConfigurationError("this needs mcp; run: pip install 'robocomp-py[mcp]'") from exc
