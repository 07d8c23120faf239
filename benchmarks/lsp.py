"""Measures the time from a change of a file in an editor to the language server's diagnostics.

Client and server are two processes, connected by the server's stdin and stdout. The file is similar to those of
users, and imports a shipped one. It changes as if it was typed: one character after the other, so that every other
text is wrong.
"""

from __future__ import annotations

import asyncio
import statistics
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from .languages import interfaces
from .query import Tell
from .rounds import Effort
from .tables import Table

LINES = 500
GOAL = 0.03
"""Seconds."""

CHANGES = 40
"""In a round."""

_IMPORT = 'import "GenericBase.idsl";'
_TYPED = "sequence<RoboCompGenericBase::TBaseState> States;"
_PATIENCE = 30.0


@dataclass(frozen=True)
class Row:
    """Times in seconds."""

    what: str
    middle: float
    late: float
    """All but one of a hundred take less."""


def run(effort: Effort, tell: Tell) -> list[Row]:
    tell("lsp")
    taken = asyncio.run(_session(effort.rounds * CHANGES))
    ordered = sorted(taken)
    late = ordered[min(len(ordered) - 1, len(ordered) * 99 // 100)]
    return [Row(f"a change in an IDSL of {LINES} lines", statistics.median(taken), late)]


async def _session(changes: int) -> list[float]:
    """The duration of each change."""
    from lsprotocol import types as lsp
    from pygls.lsp.client import LanguageClient

    client = LanguageClient("benchmarks", "1")
    told: asyncio.Queue[int | None] = asyncio.Queue()

    def publish(params: lsp.PublishDiagnosticsParams) -> None:
        told.put_nowait(params.version)

    client.feature(lsp.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)(publish)

    async def diagnosed(version: int) -> None:
        while await asyncio.wait_for(told.get(), _PATIENCE) != version:
            pass

    with tempfile.TemporaryDirectory(prefix="rc-") as folder:
        uri = Path(folder, "Big.idsl").as_uri()
        await client.start_io(sys.executable, "-m", "robocomp_py.cli.rc", "lsp")
        try:
            await client.initialize_async(
                lsp.InitializeParams(lsp.ClientCapabilities(), root_uri=Path(folder).as_uri())
            )
            client.initialized(lsp.InitializedParams())
            item = lsp.TextDocumentItem(uri, "idsl", 0, _text(""))
            client.text_document_did_open(lsp.DidOpenTextDocumentParams(item))
            await diagnosed(0)
            taken = []
            for version in range(1, changes + 1):
                text = _text(_TYPED[: version % (len(_TYPED) + 1)])
                change = lsp.TextDocumentContentChangeWholeDocument(text)
                document = lsp.VersionedTextDocumentIdentifier(version, uri)
                begun = time.perf_counter()
                client.text_document_did_change(lsp.DidChangeTextDocumentParams(document, [change]))
                await diagnosed(version)
                taken.append(time.perf_counter() - begun)
            await client.shutdown_async(None)
            client.exit(None)
        finally:
            await client.stop()  # type: ignore[no-untyped-call]  # pygls has not typed it
    return taken


def _text(typed: str) -> str:
    """The file with this much of a definition in the middle typed."""
    lines = interfaces("Big", LINES, _IMPORT).splitlines()
    middle = next(number for number, line in enumerate(lines) if number > LINES // 2 and line.startswith("    // What"))
    return "\n".join([*lines[:middle], f"    {typed}", *lines[middle:], ""])


def table(rows: list[Row]) -> Table:
    head = ("", "median", "99 of 100", "goal")
    cells = [
        (
            row.what,
            f"{row.middle * 1e3:.1f} ms",
            f"{row.late * 1e3:.1f} ms",
            f"≤ {GOAL * 1e3:g} ms: {'met' if row.middle <= GOAL else 'missed'}",
        )
        for row in rows
    ]
    return Table("lsp", "from a change to its diagnostics, through the language server", head, cells, labels=1)
