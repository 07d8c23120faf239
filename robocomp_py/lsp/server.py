"""The server itself: receives the editor's messages and sends answers. It has one thread, which never blocks.

A changed file is checked, and so are the open files that depend on it. A check that took long the last
time is delayed by that time, in case further changes come.
"""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import time
import traceback
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from lsprotocol import types as lsp
from pygls.exceptions import JsonRpcException, JsonRpcInternalError
from pygls.lsp.server import LanguageServer

from .. import __version__, installed
from ..dsl.workspace import ENDINGS
from . import answers
from .complaints import complaints
from .features import FEATURES, Feature
from .places import Places, path_of
from .project import Project

QUICK_S = 0.05
"""Checks that took less than these seconds run at once."""

LATEST = 1.0
"""The longest delay of a check, in seconds."""

_WATCHED = f"**/*{{{','.join((*ENDINGS, '.xml', '.toml', '.py'))}}}"


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


def make_server() -> Server:
    logging.getLogger("pygls").setLevel(logging.CRITICAL)  # the editor already gets what it would print
    server = Server()
    for name, handler, options in (*_LIFE, *FEATURES):
        server.feature(name, options)(partial(handler, server))
    return server


# The life of a session.


def _initialize(server: Server, params: lsp.InitializeParams) -> None:
    folders = [path_of(each.uri) for each in params.workspace_folders or ()]
    root = path_of(params.root_uri) if params.root_uri else None
    server.project.folders = [each for each in folders or [root] if each]
    server.configure(params.initialization_options)


def _initialized(server: Server, params: lsp.InitializedParams) -> None:
    """Subscribe to changes on the disk, if the editor supports it."""
    workspace = server.client_capabilities.workspace
    watching = workspace.did_change_watched_files if workspace else None
    if watching and watching.dynamic_registration:
        watcher = lsp.FileSystemWatcher(_WATCHED)
        options = lsp.DidChangeWatchedFilesRegistrationOptions([watcher])
        registration = lsp.Registration("files", lsp.WORKSPACE_DID_CHANGE_WATCHED_FILES, options)
        server.client_register_capability(lsp.RegistrationParams([registration]))


def _shutdown(server: Server, params: None) -> None:
    server.ended_well = True


def _did_change_configuration(server: Server, params: lsp.DidChangeConfigurationParams) -> None:
    if isinstance(params.settings, dict) and params.settings:
        server.configure(params.settings)
        server.check_all()


def _did_change_folders(server: Server, params: lsp.DidChangeWorkspaceFoldersParams) -> None:
    gone = {path_of(each.uri) for each in params.event.removed}
    new = [path_of(each.uri) for each in params.event.added]
    server.project.folders = [each for each in server.project.folders if each not in gone]
    server.project.folders += [each for each in new if each]
    server.project.forget_disk()


def _did_change_watched_files(server: Server, params: lsp.DidChangeWatchedFilesParams) -> None:
    server.project.forget_disk()
    server.check_all()


# Documents.


def _did_open(server: Server, params: lsp.DidOpenTextDocumentParams) -> None:
    document = params.text_document
    _take_over(server, document.uri, document.text, document.version)


def _did_change(server: Server, params: lsp.DidChangeTextDocumentParams) -> None:
    text = server.workspace.get_text_document(params.text_document.uri).source
    _take_over(server, params.text_document.uri, text, params.text_document.version)


def _take_over(server: Server, uri: str, text: str, version: int) -> None:
    path = path_of(uri)
    if path is None:
        return  # for example a revision that an editor compares with, which has no path
    server.project.open(path, text, version, uri)
    server.changed(path)


def _did_close(server: Server, params: lsp.DidCloseTextDocumentParams) -> None:
    path = path_of(params.text_document.uri)
    if path is None:
        return
    dependents = server.project.dependents(path)
    server.project.close(path)
    server.publish(params.text_document.uri, [])
    for each in dependents:
        server.changed(each)


_LIFE: tuple[Feature, ...] = (
    (lsp.INITIALIZE, _initialize, None),
    (lsp.INITIALIZED, _initialized, None),
    (lsp.SHUTDOWN, _shutdown, None),
    (lsp.WORKSPACE_DID_CHANGE_CONFIGURATION, _did_change_configuration, None),
    (lsp.WORKSPACE_DID_CHANGE_WORKSPACE_FOLDERS, _did_change_folders, None),
    (lsp.WORKSPACE_DID_CHANGE_WATCHED_FILES, _did_change_watched_files, None),
    (lsp.TEXT_DOCUMENT_DID_OPEN, _did_open, None),
    (lsp.TEXT_DOCUMENT_DID_CHANGE, _did_change, None),
    (lsp.TEXT_DOCUMENT_DID_CLOSE, _did_close, None),
)
