"""How the choice of a middleware is written, and what carries messages if it is left open.

zeromq       always this middleware
auto         rcdeploy chooses the fastest for each link, or DEFAULT if nothing is faster
auto(dds)    the same, with dds instead of DEFAULT
"""

from __future__ import annotations

import re
from pathlib import Path

AUTO = "auto"
"""The choice of a component that was generated without one."""

DEFAULT = "zeromq"
"""What carries the messages if no middleware is named and nothing faster is available."""

_AUTO = re.compile(rf"{AUTO}(?:\(\s*(\w+)\s*\))?")


_GENERATED = re.compile(r'^    middleware = "([^"]+)"$', re.MULTILINE)


def is_auto(middleware: str | None) -> bool:
    """Whether the choice is rcdeploy's: no middleware is named, or the choice is `auto`."""
    return middleware is None or _AUTO.fullmatch(middleware) is not None


def carrier(middleware: str | None, generated_for: str) -> str:
    """What carries messages for which rcdeploy has not chosen anything faster.

    `middleware` is what the configuration says; `generated_for` is the choice in the generated code, or "" if there is
    none: then the result is "" unless the configuration names a middleware.
    """
    for said in filter(None, (middleware, generated_for)):
        found = _AUTO.fullmatch(said)
        if named := found[1] if found else said:
            return str(named)
    return DEFAULT if generated_for else ""


def generated_for(folder: Path) -> str:
    """The choice in a component's generic part: a middleware, or auto; "" if it names neither."""
    try:
        text = (folder / "generic" / "genericworker.py").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    found = _GENERATED.search(text)
    return found[1] if found else ""
