"""Log records of running components, as tools show them. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from ..runtime.records import Record, record_of


@dataclass(frozen=True, slots=True)
class Entry:
    """What one component has logged."""

    component: str
    """Its whole name, as `robot1/wander`."""
    record: Record

    @property
    def told(self) -> dict[str, Any]:
        """For machines."""
        return {"component": self.component, **asdict(self.record)}


def entry_of(component: str, message: Any) -> tuple[Entry | None, int]:
    """A message of `IntrospectionPub.logged` as JSON, and the number of records before it that are not told.

    None if it is something else: it comes from another process.
    """
    found = message.get("entry") if isinstance(message, Mapping) else None
    if not isinstance(found, Mapping):
        return None, 0
    at, dropped = found.get("at"), found.get("dropped")
    facts = {
        name: found.get(name) for name in ("level", "logger", "instance", "thread", "file", "line", "text", "trace")
    }
    record = record_of(facts | {"time": at / 1e9 if isinstance(at, int) else None})
    return (Entry(component, record) if record else None), dropped if isinstance(dropped, int) else 0
