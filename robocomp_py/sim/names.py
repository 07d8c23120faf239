"""Names that the model in MuJoCo has for nodes and their parts. They are unique, since the separator is not printable,
and ids of nodes are."""

from __future__ import annotations

PREFIX = "."
"""Before the id of a node: `world` is a reserved name in MuJoCo, and the id of a node in nearly every file."""

_BETWEEN = "\t"


def of_part(name: str, part: str) -> str:
    """The name of a part, such as the joint `turn` of a base. `name` is that of the whole."""
    return f"{name}{_BETWEEN}{part}"


def split(name: str) -> tuple[str, str]:
    """The name of the whole, and the part, from the name that `of_part` made."""
    whole, _, part = name.rpartition(_BETWEEN)
    return whole, part
