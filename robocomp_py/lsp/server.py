"""The server itself: receives the editor's messages and sends answers. It has one thread, which never blocks.

A changed file is checked, and so are the open files that depend on it. A check that took long the last
time is delayed by that time, in case further changes come.
"""

from __future__ import annotations

import asyncio
import gc
import os
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

from lsprotocol import types as lsp
from pygls.exceptions import JsonRpcException, JsonRpcInternalError
from pygls.lsp.server import LanguageServer

from .. import installed
from ..version import __version__
from . import answers
from .complaints import complaints
from .places import Places
from .project import Project

QUICK_S = 0.05
"""Checks that took less than these seconds run at once."""

LATEST = 1.0
"""The longest delay of a check, in seconds."""


class Server(LanguageServer):
    """Holds and checks the project; `features` answers requests."""

    def __init__(self) -> None:
        super().__init__("rc lsp", __version__, lsp.TextDocumentSyncKind.Full, max_workers=1)
        self.project = Project()
        self.ended_well = False
        self._waiting: dict[Path, asyncio.TimerHandle] = {}
        self._took: dict[Path, float] = {}

    def serve(self, stdin: BinaryIO, stdout: BinaryIO) -> bool:
        """Serve until the editor is gone. Returns whether it ended the session properly."""
        gc.freeze()  # modules stay: scanning them repeatedly makes every hundredth answer slow
        with installed.asked_once():  # for the session: looking them up takes longer than most checks
            self.start_io(stdin, stdout)
        return self.ended_well

    @property
    def places(self) -> Places:
        return Places(self.project, self.workspace.position_encoding or lsp.PositionEncodingKind.Utf16)

    @property
    def versions(self) -> dict[str, int | None] | None:
        """The versions of open files; None if the editor does not accept changes with versions."""
        workspace = self.client_capabilities.workspace
        edit = workspace.workspace_edit if workspace else None
        return self.project.versions if edit and edit.document_changes else None

    @property
    def annotates(self) -> bool:
        """Whether the editor shows the description of a change."""
        workspace = self.client_capabilities.workspace
        edit = workspace.workspace_edit if workspace else None
        return bool(edit and edit.document_changes and edit.change_annotation_support)

    def configure(self, settings: Any) -> None:
        """Apply the user's settings: `include`, folders relative to the first one of the project.

        Other settings are ignored: some editors send all their settings to every server.
        """
        given = settings.get("robocomp", settings) if isinstance(settings, dict) else {}
        include = given.get("include") if isinstance(given, dict) else None
        if not isinstance(include, list):
            return
        base = self.project.folders[0] if self.project.folders else Path.cwd()
        folders = [each for each in include if isinstance(each, str)]
        self.project.include = [base / os.path.expanduser(each) for each in folders]

    # Checking.

    def changed(self, path: Path) -> None:
        """Schedule checks of a file and of those that depend on it."""
        self._check_soon(path)
        for each in self.project.dependents(path):
            self._check_soon(each)

    def check_all(self) -> None:
        for each in self.project.opened:
            self._check_soon(each)

    def _check_soon(self, path: Path) -> None:
        waiting = self._waiting.pop(path, None)
        if waiting:
            waiting.cancel()
        took = self._took.get(path, 0.0)
        delay = 0.0 if took < QUICK_S else min(took, LATEST)
        self._waiting[path] = asyncio.get_running_loop().call_later(delay, self._check, path)

    def _check(self, path: Path) -> None:
        del self._waiting[path]
        buffer = self.project.buffer(path)
        if buffer is None:
            return
        begun = time.thread_time()  # the load of other processes must not increase the delay
        try:
            places = self.places
            found = [answers.diagnostic(each, places) for each in complaints(self.project, path)]
        except Exception as exc:
            self.tell_of(exc)  # an error in the server; the next change may avoid it
            return
        self._took[path] = time.thread_time() - begun
        self.publish(buffer.uri, found, buffer.version)

    def publish(self, uri: str, found: Sequence[lsp.Diagnostic], version: int | None = None) -> None:
        self.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(uri, list(found), version))

    # Errors in the server.

    def tell_of(self, error: BaseException) -> None:
        text = "".join(traceback.format_exception(error))
        self.window_log_message(lsp.LogMessageParams(lsp.MessageType.Error, f"a mistake in rc lsp: {text}"))

    def report_server_error(self, error: Exception, source: Any) -> None:
        if not isinstance(error, JsonRpcException) or isinstance(error, JsonRpcInternalError):
            self.tell_of(error)  # others are refusals, which the editor already gets as answers
