"""The differences between two plans of a network that matter to running processes: JSON in, changes out."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Any

from .contracts import Contracts
from .process import Process

Json = Mapping[str, Any]


class Kind(StrEnum):
    ADDED = "added"
    REMOVED = "removed"
    CHANGED = "changed"


@dataclass(frozen=True, slots=True)
class Change:
    kind: Kind
    what: str
    """A process; nothing for the network itself."""
    of: str = ""
    """The changed parts: its command, its host, its restarts."""
    removed: tuple[str, ...] = ()
    added: tuple[str, ...] = ()


def changes(running: Json, wanted: Json, contracts: Contracts | None = None) -> list[Change]:
    """The differences that stopping a network and starting it anew would make.

    `contracts` are those that its instances run, which may have been started again since; by default, those of its
    plan. Parts that a plan of an older version lacks count as empty.
    """
    before, after = _by_name(running, "processes"), _by_name(wanted, "processes")
    found = [
        change
        for key in ("security", "middleware", "clock")
        for change in _differing("", key, running.get(key), wanted.get(key))
    ]
    found += _differing("", "hosts", _hosts(running), _hosts(wanted))
    found += _differing("", "escalation", running.get("escalations"), wanted.get("escalations"))
    found += [Change(Kind.REMOVED, name, removed=(_kind(before[name]),)) for name in before if name not in after]
    for name, process in after.items():
        if name not in before:
            found.append(Change(Kind.ADDED, name, added=(_kind(process),)))
        else:
            found += _changed(name, before[name], process)
            found += _older(process["instances"], _contracts(running) | dict(contracts or {}), _contracts(wanted))
    return found


def _older(instances: Sequence[str], before: Contracts, after: Contracts) -> list[Change]:
    """The operations whose contracts differ from those that instances run."""
    return [
        Change(Kind.CHANGED, name, "contract, of which it runs an older one", _told(old, new), _told(new, old))
        for name in instances
        if (old := before.get(name)) != (new := after.get(name)) and old is not None and new is not None
    ]


def _told(operations: Mapping[str, str], others: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(f"{name} {operations[name]}" for name in operations if operations[name] != others.get(name))


def _contracts(plan: Json) -> dict[str, Mapping[str, str]]:
    return {name: each["operations"] for name, each in plan.get("ours", {}).items()}


_NOT_SHOWN = {"name", "command", "is_program", "members", "ready_after", "stops_before", "system", "files"}
_FIELDS = ("instances", *(each.name for each in fields(Process) if each.name not in _NOT_SHOWN))


def _changed(name: str, before: Json, after: Json) -> list[Change]:
    found = []
    old, new = _arguments(before.get("command", ())), _arguments(after.get("command", ()))
    if old != new:
        removed, added = _without_common(old, new)
        found.append(Change(Kind.CHANGED, name, "command", removed, added))
    for key in _FIELDS:
        found += _differing(name, key, before.get(key), after.get(key))
    return found


def _differing(name: str, key: str, before: object, after: object) -> list[Change]:
    if before == after:
        return []
    removed, added = _without_common(_words(before), _words(after))
    return [Change(Kind.CHANGED, name, key, removed, added)]


def _arguments(command: Sequence[str]) -> list[str]:
    """With options and their values together."""
    found: list[str] = []
    for word in command:
        if found and found[-1] in ("--set", "--name", "--config", "--after"):
            found[-1] += f" {word}"
        else:
            found.append(word)
    return found


def _words(value: object) -> list[str]:
    """A value as words that can be compared one by one."""
    match value:
        case None | "":
            return []
        case bool():
            return ["yes" if value else "no"]
        case dict():
            return [f"{key}={inner}" for key, inner in value.items()]
        case list() | tuple():
            return [str(each) for each in value]
        case _:
            return [str(value)]


def _without_common(before: Sequence[str], after: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    removed: list[str] = []
    added: list[str] = []
    for tag, a, b, c, d in difflib.SequenceMatcher(None, before, after, autojunk=False).get_opcodes():
        if tag != "equal":
            removed += before[a:b]
            added += after[c:d]
    return tuple(removed), tuple(added)


def _by_name(plan: Json, key: str) -> dict[str, Json]:
    return {str(each["name"]): each for each in plan.get(key, ())}


def _hosts(plan: Json) -> dict[str, str]:
    return {name: " ".join(_words(dict(host))) for name, host in _by_name(plan, "hosts").items()}


def _kind(process: Json) -> str:
    return str(process.get("component", ""))
