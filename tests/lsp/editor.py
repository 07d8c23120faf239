"""An editor for tests: a real session with a real server, over its stdin and stdout."""

from __future__ import annotations

import asyncio
import os
import sys
from collections import defaultdict
from collections.abc import Callable, Coroutine, Sequence
from pathlib import Path
from typing import Any, TypeVar

from lsprotocol import types as lsp
from pygls.lsp.client import LanguageClient

from robocomp_py.testing.patience import SOON

T = TypeVar("T")

ABLE = lsp.ClientCapabilities(
    workspace=lsp.WorkspaceClientCapabilities(
        workspace_edit=lsp.WorkspaceEditClientCapabilities(
            document_changes=True, change_annotation_support=lsp.ChangeAnnotationsSupportOptions()
        ),
        did_change_watched_files=lsp.DidChangeWatchedFilesClientCapabilities(dynamic_registration=True),
    )
)
"""An editor that can do a lot."""

COMMAND = (sys.executable, "-m", "robocomp_py.cli.rc", "lsp")


class Editor:
    """Every method waits for its answer. Texts are kept, and places found in them: `|` marks the place."""

    def __init__(
        self,
        folder: Path,
        *,
        capabilities: lsp.ClientCapabilities = ABLE,
        options: object = None,
        folders: Sequence[Path] | None = None,
    ) -> None:
        self.folder = folder
        self.texts: dict[str, str] = {}
        self.published: dict[str, list[lsp.PublishDiagnosticsParams]] = defaultdict(list)
        self.messages: list[str] = []
        self.mistakes: list[str] = []
        self.registered: list[str] = []
        self._versions: dict[str, int] = defaultdict(int)
        self._loop = asyncio.new_event_loop()
        self._news = asyncio.Event()
        self.client = self._make_client()
        self._run(self.client.start_io(*COMMAND, env=_environment(folder)))
        roots = [folder] if folders is None else folders
        parameters = lsp.InitializeParams(
            capabilities=capabilities,
            process_id=os.getpid(),
            initialization_options=options,
            workspace_folders=[lsp.WorkspaceFolder(each.as_uri(), each.name) for each in roots],
        )
        self.server = self.ask(self.client.initialize_async(parameters)).capabilities
        self.client.initialized(lsp.InitializedParams())

    def _make_client(self) -> LanguageClient:
        client = LanguageClient("tests", "1")

        @client.feature(lsp.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        def publish(params: lsp.PublishDiagnosticsParams) -> None:
            self.published[params.uri].append(params)
            self._news.set()

        @client.feature(lsp.WINDOW_SHOW_MESSAGE)
        def show(params: lsp.ShowMessageParams) -> None:
            self.messages.append(params.message)
            self._news.set()

        @client.feature(lsp.WINDOW_LOG_MESSAGE)
        def log(params: lsp.LogMessageParams) -> None:
            self.mistakes.append(params.message)
            self._news.set()

        @client.feature(lsp.CLIENT_REGISTER_CAPABILITY)
        def register(params: lsp.RegistrationParams) -> None:
            self.registered += [each.method for each in params.registrations]
            self._news.set()

        return client

    # Waiting.

    def _run(self, doing: Coroutine[Any, Any, T]) -> T:
        return self._loop.run_until_complete(asyncio.wait_for(doing, 3 * SOON))

    def ask(self, doing: Coroutine[Any, Any, T]) -> T:
        """The answer to a request."""
        return self._run(doing)

    def until(self, condition: Callable[[], bool]) -> None:
        """Let messages in until something is so."""

        async def waiting() -> None:
            while not condition():
                self._news.clear()
                await self._news.wait()

        self._run(waiting())

    # Files.

    def uri(self, name: str) -> str:
        return (self.folder / name).as_uri()

    def identifier(self, name: str) -> lsp.TextDocumentIdentifier:
        return lsp.TextDocumentIdentifier(self.uri(name))

    def open(self, name: str, text: str | None = None) -> list[lsp.Diagnostic]:
        """Its diagnostics, as for the methods below."""
        self.texts[name] = (self.folder / name).read_text(encoding="utf-8") if text is None else text
        self._versions[name] += 1
        item = lsp.TextDocumentItem(self.uri(name), Path(name).suffix[1:], self._versions[name], self.texts[name])
        self.client.text_document_did_open(lsp.DidOpenTextDocumentParams(item))
        return self._checked(name)

    def change(self, name: str, text: str) -> list[lsp.Diagnostic]:
        self.type(name, text)
        return self._checked(name)

    def type(self, name: str, text: str) -> None:
        """Without waiting for anything."""
        self.texts[name] = text
        self._versions[name] += 1
        document = lsp.VersionedTextDocumentIdentifier(self._versions[name], self.uri(name))
        change = lsp.TextDocumentContentChangeWholeDocument(text)
        self.client.text_document_did_change(lsp.DidChangeTextDocumentParams(document, [change]))

    def close(self, name: str) -> None:
        self.client.text_document_did_close(lsp.DidCloseTextDocumentParams(self.identifier(name)))

    def _checked(self, name: str) -> list[lsp.Diagnostic]:
        wanted, got = self._versions[name], self.published[self.uri(name)]
        self.until(lambda: any(each.version == wanted for each in got))
        return list(got[-1].diagnostics)

    def codes(self, name: str) -> list[object]:
        """Of the last diagnostics of a file."""
        got = self.published[self.uri(name)]
        return [each.code for each in got[-1].diagnostics] if got else []

    # Places.

    def at(self, name: str, marked: str) -> dict[str, Any]:
        """What a request about a place begins with: `requires La|ser` is behind the `La` there."""
        before, _, behind = marked.partition("|")
        text = self.texts[name]
        assert text.count(before + behind) == 1, f"{before + behind!r} is {text.count(before + behind)} times in {name}"
        return {
            "text_document": self.identifier(name),
            "position": position(text, text.index(before + behind) + len(before)),
        }

    def text_in(self, name: str, where: lsp.Range) -> str:
        text = self.texts[name] if name in self.texts else (self.folder / name).read_text(encoding="utf-8")
        return text[offset(text, where.start) : offset(text, where.end)]

    def applied(self, name: str, edits: Sequence[lsp.TextEdit | lsp.AnnotatedTextEdit]) -> str:
        """The text of a file with edits made."""
        text = self.texts[name] if name in self.texts else (self.folder / name).read_text(encoding="utf-8")
        for each in sorted(edits, key=lambda edit: offset(text, edit.range.start), reverse=True):
            text = text[: offset(text, each.range.start)] + each.new_text + text[offset(text, each.range.end) :]
        return text

    # The end.

    def move_to(self, folder: Path) -> None:
        """Close everything, and go on in another folder, as if nothing had been."""
        for uri in [uri for uri, texts in self.published.items() if texts[-1].version is not None]:
            self.client.text_document_did_close(lsp.DidCloseTextDocumentParams(lsp.TextDocumentIdentifier(uri)))
        old, new = (lsp.WorkspaceFolder(each.as_uri(), each.name) for each in (self.folder, folder))
        event = lsp.WorkspaceFoldersChangeEvent([new], [old])
        self.client.workspace_did_change_workspace_folders(lsp.DidChangeWorkspaceFoldersParams(event))
        self.folder = folder
        for each in (self.texts, self.published, self.messages, self.mistakes, self._versions):
            each.clear()

    def leave(self) -> int:
        """Say good-bye; how the server ended."""
        self.ask(self.client.shutdown_async(None))
        self.client.exit(None)
        return self._ended()

    def vanish(self) -> int:
        """Without a word."""
        process = self._process
        assert process.stdin
        process.stdin.close()
        return self._ended()

    @property
    def _process(self) -> asyncio.subprocess.Process:
        process = self.client._server
        assert process
        return process

    def _ended(self) -> int:
        process = self._process
        assert process.stderr
        self.complaints = self._run(process.stderr.read()).decode()
        code = self._run(process.wait())
        self._run(self.client.stop())
        self._loop.close()
        return code


def position(text: str, at: int) -> lsp.Position:
    """In UTF-16, counted by Python's codec."""
    before = text[:at]
    return lsp.Position(before.count("\n"), len(before.rpartition("\n")[2].encode("utf-16-le")) // 2)


def offset(text: str, where: lsp.Position) -> int:
    lines = text.split("\n")
    line = (
        lines[where.line].encode("utf-16-le")[: 2 * where.character].decode("utf-16-le")
        if where.line < len(lines)
        else ""
    )
    return min(sum(len(each) + 1 for each in lines[: where.line]) + len(line), len(text))


def _environment(folder: Path) -> dict[str, str]:
    """One in which imports are found beside the importing file and among the shipped interfaces only."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith("ROBOCOMP")}
    return inherited | {"HOME": str(folder / "nobody"), "PYTHONUTF8": "1"}
