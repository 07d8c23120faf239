"""Finds contracts that programs announce by their fingerprints alone, in the IDSL files of the user."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..dsl.workspace import Workspace
    from ..tools.network import Network


def define(network: Network, include: Sequence[Path]) -> None:
    """Complete the contracts of channels of which nothing announces the text.

    Files are searched for in the current folder, in `include` and where imports are searched for. Only those are read
    that name a wanted interface.
    """
    wanted = network.undefined()
    if not wanted:
        return
    from ..contract.interface import Interface
    from ..dsl.workspace import Workspace  # most programs announce their contracts

    workspace = Workspace(include)
    texts: dict[int, str] = {}
    for path in _files(workspace, set(wanted.values())):
        module = workspace.interfaces(path)
        for interface in module.definitions if module else ():
            if isinstance(interface, Interface):
                texts |= {each.fingerprint: each.text for each in interface.operations if each.fingerprint in wanted}
    network.define(texts)


def _files(workspace: Workspace, interfaces: set[str]) -> Iterator[Path]:
    """The IDSL files that name one of these interfaces."""
    words = [each.encode() for each in interfaces]
    for folder in workspace.search_path(Path("here.idsl")):
        with contextlib.suppress(OSError):
            for path in sorted(folder.glob("*.idsl")):
                content = path.read_bytes()
                if any(each in content for each in words):
                    yield path
