"""Limits of open files."""

from __future__ import annotations

from collections.abc import Iterator

from .facts import Facts, Finding, Weight

NAME = "files"
HELP = "processes that have nearly as many files open as they may"

_MUCH, _TOO_MUCH = 0.8, 0.97


def find(facts: Facts) -> Iterator[Finding]:
    for each in facts.machine.processes:
        if each.most_files and each.open_files >= _MUCH * each.most_files:
            weight = Weight.ERROR if each.open_files >= _TOO_MUCH * each.most_files else Weight.WARN
            text = f"{_name(facts, each.pid)} has {each.open_files} of at most {each.most_files} files open"
            yield Finding(weight, text, f"start it with a higher limit: ulimit -n {2 * each.most_files}")


def _name(facts: Facts, pid: int) -> str:
    owners = dict.fromkeys(end.told.owner or "?" for end in facts.network.ends if end.process == (facts.place, pid))
    return f"{', '.join(owners) or '?'} (process {pid})"
