"""Members of a class that have the same name as a type that later members need.

    class Scan:
        list: int = 0
        points: list[float] = field(default_factory=list)     # the int

A built-in is then written as `builtins.list`; a name of the module gets an alias, `_Point = Point`.
"""

from __future__ import annotations

import re

from .imports import BUILTINS, STANDARD

_NAME = re.compile(r'"(?:[^"\\]|\\.)*"|(?<![\w.])[A-Za-z_]\w*')
_QUALIFIED = {name: f"builtins.{name}" for name in BUILTINS} | {name: f"typing.{name}" for name in STANDARD["typing"]}


class Shadows:
    """The names that the members of a class hide from later members. Add members in the order of the class."""

    def __init__(self) -> None:
        self._members: set[str] = set()
        self._hidden: set[str] = set()

    def member(self, name: str, text: str) -> None:
        """Add a member, and the text in which it uses names of the module."""
        self._hidden |= self._members & set(_NAME.findall(text))
        self._members.add(name)

    def avoid(self, text: str) -> str:
        """The expression, with other names for those that are hidden."""
        return _NAME.sub(lambda found: _another(found[0]) if found[0] in self._hidden else found[0], text)

    def aliases(self) -> list[str]:
        """The statements that define the other names."""
        return [f"{_another(name)} = {name}" for name in sorted(self._hidden) if name not in _QUALIFIED]


def _another(name: str) -> str:
    return _QUALIFIED.get(name, f"_{name}")
