"""A session with an editor: how it begins and ends, and which documents are open."""

from __future__ import annotations

import logging
from functools import partial

from lsprotocol import types as lsp

from ..dsl.workspace import ENDINGS
from .features import FEATURES, Feature
from .places import path_of
from .server import Server

_WATCHED = f"**/*{{{','.join((*ENDINGS, '.xml', '.toml', '.py'))}}}"


def make_server() -> Server:
    logging.getLogger("pygls").setLevel(logging.CRITICAL)  # the editor already gets what it would print
    server = Server()
    for name, handler, options in (*_LIFE, *FEATURES):
        server.feature(name, options)(partial(handler, server))
    return server


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
