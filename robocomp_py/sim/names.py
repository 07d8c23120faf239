"""Names of what MuJoCo has of a scene. Ids of nodes are printable, so none of these names is that of another node."""

from __future__ import annotations

PREFIX = "."
"""Before the id of a node: `world` is a reserved name in MuJoCo, and the id of a node in nearly every file."""

_BETWEEN = "\t"


def of_part(name: str, part: str) -> str:
    """The name of a part of what has a name: `turn` of a base."""
    return f"{name}{_BETWEEN}{part}"


def split(name: str) -> tuple[str, str]:
    """What has the part of this name, and the part."""
    whole, _, part = name.rpartition(_BETWEEN)
    return whole, part
