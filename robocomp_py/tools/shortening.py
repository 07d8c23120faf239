"""Cuts long values for people."""

from __future__ import annotations

from typing import Any

_LONGEST = 8
"""Items of a sequence that are shown, unless all are wanted."""


def shortened(value: Any) -> Any:
    """The same JSON, with long arrays and texts cut."""
    match value:
        case dict():
            return {key: shortened(each) for key, each in value.items()}
        case list() if len(value) > _LONGEST:
            return [*map(shortened, value[: _LONGEST - 2]), f"… {len(value) - _LONGEST + 2} more"]
        case list():
            return [shortened(each) for each in value]
        case str() if len(value) > 200:
            return f"{value[:80]}… {len(value) - 80} more"
        case _:
            return value
