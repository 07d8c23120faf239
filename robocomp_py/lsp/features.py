"""The requests of an editor, and how they are answered.

For a place without a symbol, or in a file of another format, the answer is empty.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lsprotocol import types as lsp
from pygls.exceptions import JsonRpcException

from ..dsl.diagnostics import DslError
from ..dsl.format import LANGUAGES, format_text
from ..dsl.innermodel.check import ENDING, is_root
from ..dsl.source import Source
from . import answers, innermodel
from .complaints import complaints
from .complete import complete
from .fixes import fixes
from .hover import hover
from .index import Index
from .places import Places, path_of
from .project import without_mark
from .rename import CannotRename, rename, renamed_at
from .tokens import colours

if TYPE_CHECKING:
    from .server import Server

_START = lsp.Position(0, 0)


@dataclass(frozen=True)
class _At:
    """The place that a request is about."""

    path: Path
    text: str
    offset: int
    index: Index
    places: Places

    @property
    def scene(self) -> Source | None:
        """The text, if it is an InnerModel."""
        return Source(self.path, self.text) if self.path.suffix.lower() == ENDING else None


def _at(server: Server, uri: str, position: lsp.Position = _START) -> _At | None:
    path = path_of(uri)
    if path is None or path.suffix.lower().removeprefix(".") not in LANGUAGES:
        return None
    return _placed(server, path, position)


def _at_any(server: Server, uri: str, position: lsp.Position = _START) -> _At | None:
    """The same, also in an InnerModel. Other XML is not ours."""
    path = path_of(uri)
    if path is None or path.suffix.lower() != ENDING:
        return _at(server, uri, position)
    return _placed(server, path, position) if is_root(server.project.text(path)) else None


def _placed(server: Server, path: Path, position: lsp.Position) -> _At:
    places = server.places
    text = without_mark(server.project.text(path))
    return _At(path, text, places.offset(path, position), Index(server.project), places)


# Reading.


def _hover(server: Server, params: lsp.HoverParams) -> lsp.Hover | None:
    at = _at_any(server, params.text_document.uri, params.position)
    if at and at.scene:
        said = innermodel.hover(at.scene, at.offset)
    else:
        said = hover(at.index, at.path, at.offset, at.text) if at else ""
    return lsp.Hover(lsp.MarkupContent(lsp.MarkupKind.Markdown, said)) if said else None


def _definition(server: Server, params: lsp.DefinitionParams) -> list[lsp.Location]:
    at = _at_any(server, params.text_document.uri, params.position)
    if at is None:
        return []
    found = at.index.elsewhere(at.path, at.offset)
    if found:
        return [at.places.location(each.name.span) for each in found]
    link = at.index.link_at(at.path, at.offset)
    target = at.index.target(link) if link else None
    return [lsp.Location(at.places.uri(target), lsp.Range(_START, _START))] if target else []


def _references(server: Server, params: lsp.ReferenceParams) -> list[lsp.Location]:
    at = _at(server, params.text_document.uri, params.position)
    found = at.index.at(at.path, at.offset) if at else None
    if at is None or found is None:
        return []
    spans = [each.name.span for each in found.symbols] if params.context.include_declaration else []
    spans += [use.name.span for each in found.symbols for use in at.index.uses_of(each)]
    return [at.places.location(span) for span in dict.fromkeys(spans)]


def _highlights(server: Server, params: lsp.DocumentHighlightParams) -> list[lsp.DocumentHighlight]:
    at = _at(server, params.text_document.uri, params.position)
    found = at.index.at(at.path, at.offset) if at else None
    if at is None or found is None:
        return []
    return [lsp.DocumentHighlight(at.places.range(each)) for each in at.index.occurrences(at.path, found.symbols)]


def _completion(server: Server, params: lsp.CompletionParams) -> lsp.CompletionList:
    at = _at_any(server, params.text_document.uri, params.position)
    if at and at.scene:
        return answers.completion(innermodel.complete(at.scene, at.offset), server.places)
    return answers.completion(complete(at.index, at.path, at.text, at.offset) if at else (), server.places)


def _document_symbols(server: Server, params: lsp.DocumentSymbolParams) -> list[lsp.DocumentSymbol]:
    at = _at_any(server, params.text_document.uri)
    made = at.index.outline(at.path) if at else None
    return answers.document_symbols(made, at.places) if at and made else []


def _workspace_symbols(server: Server, params: lsp.WorkspaceSymbolParams) -> list[lsp.WorkspaceSymbol]:
    return answers.workspace_symbols(Index(server.project), params.query, server.places)


def _links(server: Server, params: lsp.DocumentLinkParams) -> list[lsp.DocumentLink]:
    at = _at_any(server, params.text_document.uri)
    made = at.index.outline(at.path) if at else None
    if at is None or made is None:
        return []
    found = [(link, target) for link in made.links if (target := at.index.target(link))]
    return [lsp.DocumentLink(at.places.range(link.name.span), at.places.uri(target)) for link, target in found]


def _semantic_tokens(server: Server, params: lsp.SemanticTokensParams) -> lsp.SemanticTokens:
    at = _at(server, params.text_document.uri)
    return answers.semantic_tokens(colours(at.index, at.path, at.text) if at else (), server.places)


# Changing.


def _prepare_rename(server: Server, params: lsp.PrepareRenameParams) -> lsp.PrepareRenamePlaceholder | None:
    at = _at(server, params.text_document.uri, params.position)
    found = renamed_at(at.index, at.path, at.offset) if at else None
    return lsp.PrepareRenamePlaceholder(at.places.range(found.name.span), found.name.text) if at and found else None


def _rename(server: Server, params: lsp.RenameParams) -> lsp.WorkspaceEdit | None:
    at = _at(server, params.text_document.uri, params.position)
    if at is None:
        return None
    try:
        renaming = rename(at.index, at.path, at.offset, params.new_name)
    except CannotRename as exc:
        raise JsonRpcException(str(exc), lsp.LSPErrorCodes.RequestFailed) from exc
    said = answers.told(renaming)
    if said:
        server.window_show_message(lsp.ShowMessageParams(lsp.MessageType.Info, said))
    why = lsp.ChangeAnnotation("Rename", description=said) if said and server.annotates else None
    return answers.workspace_edit(renaming.edits, at.places, server.versions, why)


def _code_actions(server: Server, params: lsp.CodeActionParams) -> list[lsp.CodeAction]:
    at = _at(server, params.text_document.uri, params.range.start)
    if at is None or not _wants_fixes(params.context.only):
        return []
    end = at.places.offset(at.path, params.range.end)
    actions = []
    for each in complaints(server.project, at.path):
        if each.span.start <= end and each.span.end >= at.offset:
            told = answers.diagnostic(each, at.places)
            for number, fix in enumerate(fixes(each, at.index)):
                edit = answers.workspace_edit(fix.edits, at.places, server.versions)
                kind = lsp.CodeActionKind.QuickFix
                actions.append(lsp.CodeAction(fix.title, kind, [told], is_preferred=number == 0, edit=edit))
    return actions


def _wants_fixes(only: Sequence[str] | None) -> bool:
    """Whether an editor asks for fixes. It asks by prefixes of kinds; the empty prefix means all."""
    wanted = [str(getattr(each, "value", each)) for each in only] if only else [""]
    return any(lsp.CodeActionKind.QuickFix.value.startswith(each) for each in wanted)


def _formatting(server: Server, params: lsp.DocumentFormattingParams) -> list[lsp.TextEdit] | None:
    """No change for a file with syntax errors, which its diagnostics show."""
    at = _at(server, params.text_document.uri)
    if at is None:
        return None
    try:
        formatted = format_text(at.text, at.path.suffix.lower().removeprefix("."), at.path)
    except DslError:
        return None
    if "\r\n" in at.text:
        formatted = formatted.replace("\n", "\r\n")  # the editor decides how lines end
    return answers.by_lines(at.text, formatted, at.places, at.path)


Feature = tuple[str, Callable[..., Any], Any]
"""A request of the protocol: its name, its handler, and the capability that the editor is told."""

FEATURES: tuple[Feature, ...] = (
    (lsp.TEXT_DOCUMENT_HOVER, _hover, None),
    (lsp.TEXT_DOCUMENT_DEFINITION, _definition, None),
    (lsp.TEXT_DOCUMENT_REFERENCES, _references, None),
    (lsp.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT, _highlights, None),
    (lsp.TEXT_DOCUMENT_COMPLETION, _completion, lsp.CompletionOptions(trigger_characters=['"', ":", "(", "[", "<"])),
    (lsp.TEXT_DOCUMENT_DOCUMENT_SYMBOL, _document_symbols, None),
    (lsp.WORKSPACE_SYMBOL, _workspace_symbols, None),
    (lsp.TEXT_DOCUMENT_DOCUMENT_LINK, _links, None),
    (lsp.TEXT_DOCUMENT_SEMANTIC_TOKENS_FULL, _semantic_tokens, answers.LEGEND),
    (lsp.TEXT_DOCUMENT_PREPARE_RENAME, _prepare_rename, None),
    (lsp.TEXT_DOCUMENT_RENAME, _rename, lsp.RenameOptions(prepare_provider=True)),
    (lsp.TEXT_DOCUMENT_CODE_ACTION, _code_actions, lsp.CodeActionOptions([lsp.CodeActionKind.QuickFix])),
    (lsp.TEXT_DOCUMENT_FORMATTING, _formatting, None),
)
