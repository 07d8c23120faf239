"""Free space on disks."""

from __future__ import annotations

from collections.abc import Iterator

from .facts import Facts, Finding, Weight, size

NAME = "disk"
HELP = "the space for sockets, directory entries and logs"

_NOTHING, _LITTLE = 1 << 20, 100 << 20
"""Octets."""

_FEW = 1000
"""Files."""


def find(facts: Facts) -> Iterator[Finding]:
    for each in facts.machine.disks:
        if each.free < min(_LITTLE, each.size // 2):
            weight = Weight.ERROR if each.free < _NOTHING else Weight.WARN
            text = f"{each.path} has {size(each.free)} of {size(each.size)} left for {each.purpose}"
            yield Finding(weight, text, f"make room; see: du -xsh {each.path}/*")
        if each.files and each.free_files < min(_FEW, each.files // 2):
            text = f"{each.path} has room for {each.free_files} more files, for {each.purpose}"
            yield Finding(Weight.WARN, text, f"remove files; see: du -x --inodes {each.path}")
