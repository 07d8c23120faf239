"""A component's configuration in the forms that RoboComp's main programs pass to it.

until 2024   setParams(params): every key of the file, values as text, as Ice's properties are
since 2025   configData: nested tables by the dots of the keys, values as what they look like
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...contract.parameters import Key
from ...runtime.document import Document, parsed
from ...spelling import unknown
from .. import configuration as classic

Entries = dict[tuple[str, ...], Any]


class _Table(dict[str, Any]):
    """A part of a configuration, which proposes a key for a misspelt one."""

    def __missing__(self, key: str) -> Any:
        raise KeyError(unknown("parameter", str(key), self))


def entries(document: Document, period: float) -> tuple[dict[str, str], dict[str, Any]]:
    """The parameters as texts and as tables, with overrides of the file in both. `period` is in seconds."""
    texts: dict[str, str] = _Table()
    values: Entries = {}
    for names, text, value in _of_file(document):
        texts[".".join(names)], values[names] = text, value
    overridden = [key for key, _ in document.overrides]
    for key, value in _set(document.data, overridden):
        texts[".".join(key)], values[key] = _text(value), value
    return texts, _nested(values, period)


def _of_file(document: Document) -> list[tuple[tuple[str, ...], str, Any]]:
    if document.path is None:
        return []
    if document.path.suffix == ".toml" and not classic.is_of_2025(parsed(document.text, document.path)):
        params = document.data.get("params", {})
        return [(key, _text(value), value) for key, value in _flat(params if isinstance(params, Mapping) else {})]
    return classic.as_written(document.text, Path(document.path))


def _set(data: Mapping[str, Any], overridden: list[Key]) -> list[tuple[tuple[str, ...], Any]]:
    """Parameters that the command line, the environment or a deployment have set."""
    found: list[tuple[tuple[str, ...], Any]] = []
    for key in overridden:
        value: Any = data
        for part in key:
            value = value[part]
        if key == ("component", "period"):
            found.append((("Period", "Compute"), round(value * 1000)))
        elif key[0] == "params" and len(key) > 1:
            found.append((tuple(map(str, key[1:])), value))
    return found


def _nested(values: Entries, period: float) -> dict[str, Any]:
    tables: dict[str, Any] = _Table({"Period": _Table({"Compute": round(period * 1000), "Emergency": 500})})
    for names, value in values.items():
        table = tables
        for name in names[:-1]:
            below = table.setdefault(name, _Table())
            if not isinstance(below, dict):
                below = table[name] = _Table()  # `a = 1` and `a.b = 2`: the later one counts
            table = below
        table[names[-1]] = value
    return tables


def _flat(table: Mapping[str, Any], at: tuple[str, ...] = ()) -> list[tuple[tuple[str, ...], Any]]:
    found: list[tuple[tuple[str, ...], Any]] = []
    for name, value in table.items():
        found += _flat(value, (*at, name)) if isinstance(value, Mapping) else [((*at, name), value)]
    return found


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
