"""Finds contracts in IDSL files of the user, for programs that announce only fingerprints."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .dsl.workspace import Workspace


class Definitions:
    """Searches for each contract once, even if it is not found.

    Files are searched for in the current folder, in `include` and where imports are searched for. Only those are read
    that name a wanted interface. For any number of threads.
    """

    def __init__(self, include: Sequence[Path]) -> None:
        self._include = include
        self._texts: dict[int, str] = {}

    def search(self, wanted: Mapping[int, str]) -> Mapping[int, str]:
        """The texts of contracts by their fingerprints, "" for one that is not found.

        `wanted` has the name of the interface for each fingerprint.
        """
        if new := {each: name for each, name in wanted.items() if each not in self._texts}:
            self._texts = self._texts | dict.fromkeys(new, "") | _found(new, self._include)
        return self._texts


def _found(wanted: Mapping[int, str], include: Sequence[Path]) -> dict[int, str]:
    """The contracts with these fingerprints, each of an interface of that name."""
    from .contract.interface import Interface
    from .dsl.workspace import Workspace  # most programs announce their contracts

    workspace = Workspace(include)
    texts: dict[int, str] = {}
    for path in _files(workspace, set(wanted.values())):
        module = workspace.interfaces(path)
        for interface in module.definitions if module else ():
            if isinstance(interface, Interface):
                parts = (part for action in interface.actions for part in action.parts)
                texts |= {each.fingerprint: each.text for each in (*interface.operations, *parts)}
    return texts


def _files(workspace: Workspace, interfaces: set[str]) -> Iterator[Path]:
    """The IDSL files that name one of these interfaces."""
    words = [each.encode() for each in interfaces]
    for folder in workspace.search_path(Path("here.idsl")):
        with contextlib.suppress(OSError):
            for path in sorted(folder.glob("*.idsl")):
                content = path.read_bytes()
                if any(each in content for each in words):
                    yield path
