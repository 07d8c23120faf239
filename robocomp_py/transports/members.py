"""The members of a directory and their entries, and how files hold them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

from ..wire.names import matches


@dataclass(frozen=True, slots=True)
class Entry:
    """One link. `role` says which end of the channel it is, in the words of the transport."""

    role: str
    channel: str
    fingerprint: int
    text: str
    address: str = ""
    traits: str = ""
    """What it offers, as `contract.qos.traits` writes it."""


@dataclass(frozen=True, slots=True)
class Member:
    """One open transport and its entries."""

    id: str
    owner: str
    pid: int
    entries: tuple[Entry, ...]

    def facing(self, role: str, channel: str) -> Iterator[Found]:
        """Its links of a channel in that role; either channel may have `*` for its instance."""
        for entry in self.entries:
            if entry.role == role and (matches(channel, entry.channel) or matches(entry.channel, channel)):
                yield Found(self, entry)


class Found(NamedTuple):
    """A link in the directory: its entry, and the member that announces it."""

    member: Member
    entry: Entry

    @property
    def channel(self) -> str:
        return self.entry.channel

    @property
    def fingerprint(self) -> int:
        return self.entry.fingerprint

    @property
    def text(self) -> str:
        return self.entry.text

    @property
    def key(self) -> tuple[str, int]:
        return self.member.id, self.entry.fingerprint


def member_in(raw: bytes, name: str) -> Member:
    """The member that a file describes. Raises ValueError, TypeError or KeyError."""
    try:
        record = json.loads(raw)
    except RecursionError as exc:
        raise ValueError(f"the record of {name} is nested too deep") from exc
    return member_of(record, name)


def member_of(record: Any, member_id: str) -> Member:
    """The member that a record describes. Raises ValueError, TypeError or KeyError."""
    owner, pid = record["owner"], record["pid"]
    if type(owner) is not str or type(pid) is not int:
        raise TypeError("owner or pid of a member")
    return Member(member_id, owner, pid, tuple(map(_entry, record["entries"])))


_KEYS = tuple(each.name for each in fields(Entry))


def told_of(entry: Entry) -> dict[str, Any]:
    """An entry as a JSON object."""
    return {key: getattr(entry, key) for key in _KEYS}


def _entry(told: dict[str, Any]) -> Entry:
    """An entry from a JSON object, perhaps of another program. Ignores unknown keys. Raises TypeError."""
    entry = Entry(**{key: told[key] for key in _KEYS if key in told})
    for key in _KEYS:
        if type(getattr(entry, key)) is not (int if key == "fingerprint" else str):
            raise TypeError(f"{key} of an entry")
    return entry


def understood(raw: bytes, name: str) -> Member | None:
    """The same; None if the file is not understood."""
    try:
        return member_in(raw, name)
    except (ValueError, TypeError, KeyError):
        return None  # written by another version of this package, or by another program
