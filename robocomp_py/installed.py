"""What installed packages add to this one, by their entry points."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points


def transports() -> dict[str, EntryPoint]:
    """Every transport there is, by the name of its middleware; none is imported."""
    entries = entry_points(group="robocomp_py.transports")
    return {entry.name: entry for entry in sorted(entries, key=lambda entry: entry.name)}
