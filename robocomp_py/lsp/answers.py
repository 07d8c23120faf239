"""Answers in the words of the protocol: our values become its types here."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate
from pathlib import Path

from lsprotocol import types as lsp

from ..dsl.diagnostics import Diagnostic, Severity
from ..dsl.source import Span
from .complaints import UNUSED_IMPORT
from .complete import Candidate
from .edits import Edit
from .index import Index
from .outline import Kind, Outline, Symbol
from .places import Places
from .project import real
from .rename import Renaming, by_file
from .tokens import MODIFIERS, TYPES, Coloured

_SYMBOLS = {
    Kind.MODULE: lsp.SymbolKind.Module,
    Kind.STRUCT: lsp.SymbolKind.Struct,
    Kind.ENUM: lsp.SymbolKind.Enum,
    Kind.ENUMERATOR: lsp.SymbolKind.EnumMember,
    Kind.EXCEPTION: lsp.SymbolKind.Class,
    Kind.SEQUENCE: lsp.SymbolKind.Array,
    Kind.DICTIONARY: lsp.SymbolKind.Object,
    Kind.CONST: lsp.SymbolKind.Constant,
    Kind.FIELD: lsp.SymbolKind.Field,
    Kind.INTERFACE: lsp.SymbolKind.Interface,
    Kind.OPERATION: lsp.SymbolKind.Method,
    Kind.ARGUMENT: lsp.SymbolKind.Variable,
    Kind.COMPONENT: lsp.SymbolKind.Class,
    Kind.TIMER: lsp.SymbolKind.Event,
    Kind.PARAMETERS: lsp.SymbolKind.Class,
    Kind.LIST: lsp.SymbolKind.Array,
    Kind.PARAMETER: lsp.SymbolKind.Property,
    Kind.CHOICE: lsp.SymbolKind.EnumMember,
    Kind.DEPLOYMENT: lsp.SymbolKind.Package,
    Kind.HOST: lsp.SymbolKind.Constant,
    Kind.SYSTEM: lsp.SymbolKind.Namespace,
    Kind.INSTANCE: lsp.SymbolKind.Object,
    Kind.NAMED: lsp.SymbolKind.Object,
    Kind.MACHINE: lsp.SymbolKind.Class,
    Kind.STATE: lsp.SymbolKind.EnumMember,
    Kind.NODE: lsp.SymbolKind.Object,
}

_COMPLETIONS: dict[str, lsp.CompletionItemKind] = {
    **dict.fromkeys((Kind.STRUCT, Kind.SEQUENCE, Kind.DICTIONARY), lsp.CompletionItemKind.Struct),
    Kind.ENUM: lsp.CompletionItemKind.Enum,
    Kind.ENUMERATOR: lsp.CompletionItemKind.EnumMember,
    Kind.INTERFACE: lsp.CompletionItemKind.Interface,
    **dict.fromkeys((Kind.COMPONENT, Kind.EXCEPTION), lsp.CompletionItemKind.Class),
    Kind.INSTANCE: lsp.CompletionItemKind.Variable,
    Kind.NAMED: lsp.CompletionItemKind.Variable,
    Kind.HOST: lsp.CompletionItemKind.Constant,
    "keyword": lsp.CompletionItemKind.Keyword,
    "file": lsp.CompletionItemKind.File,
}

_SEVERITIES = {
    Severity.ERROR: lsp.DiagnosticSeverity.Error,
    Severity.WARNING: lsp.DiagnosticSeverity.Warning,
    Severity.INFO: lsp.DiagnosticSeverity.Information,
}

_UNSHOWN = (Kind.ARGUMENT, Kind.CHOICE)
"""Kinds that an outline omits: they are on the line of their owner."""

_MOST_SYMBOLS = 500


# Diagnostics.


def diagnostic(complaint: Diagnostic, places: Places) -> lsp.Diagnostic:
    unused = complaint.code == UNUSED_IMPORT
    return lsp.Diagnostic(
        _range(complaint.span, places),
        f"{complaint.message}\n{complaint.hint}" if complaint.hint else complaint.message,
        lsp.DiagnosticSeverity.Hint if unused else _SEVERITIES[complaint.severity],
        complaint.code,
        source="robocomp",
        tags=[lsp.DiagnosticTag.Unnecessary] if unused else None,
        related_information=[
            lsp.DiagnosticRelatedInformation(places.location(span), text) for text, span in complaint.related
        ]
        or None,
    )


def _range(span: Span, places: Places) -> lsp.Range:
    """One character at least, so that there is something to be underlined."""
    end = span.end if span.end > span.start else min(span.start + 1, len(span.source.text))
    return places.of(span.source.path).between(span.start, end)


# Symbols.


def document_symbols(outline: Outline, places: Places) -> list[lsp.DocumentSymbol]:
    return [_document_symbol(each, places) for each in outline.symbols]


def _document_symbol(symbol: Symbol, places: Places) -> lsp.DocumentSymbol:
    shown = [each for each in symbol.children if each.kind not in _UNSHOWN]
    return lsp.DocumentSymbol(
        symbol.name.text or "(without a name)",
        _SYMBOLS[symbol.kind],
        places.range(symbol.span),
        places.range(symbol.name.span),
        symbol.detail or None,
        children=[_document_symbol(each, places) for each in shown],
    )


def workspace_symbols(index: Index, query: str, places: Places) -> list[lsp.WorkspaceSymbol]:
    """The symbols whose names contain the letters of the query in this order."""
    found = []
    for each in index.symbols():
        if each.kind not in _UNSHOWN and _fits(query.lower(), each.name.text.lower()):
            location = places.location(each.name.span)
            found.append(lsp.WorkspaceSymbol(location, each.name.text, _SYMBOLS[each.kind], container_name=each.within))
            if len(found) == _MOST_SYMBOLS:
                break
    return found


def _fits(query: str, name: str) -> bool:
    rest = iter(name)
    return all(char in rest for char in query)


# Completion.


def completion(candidates: Iterable[Candidate], places: Places) -> lsp.CompletionList:
    return lsp.CompletionList(False, [_completion_item(each, places) for each in candidates])


def _completion_item(candidate: Candidate, places: Places) -> lsp.CompletionItem:
    return lsp.CompletionItem(
        candidate.label,
        kind=_COMPLETIONS.get(candidate.kind, lsp.CompletionItemKind.Value),
        detail=candidate.detail or None,
        documentation=lsp.MarkupContent(lsp.MarkupKind.Markdown, candidate.doc) if candidate.doc else None,
        sort_text=f"{candidate.rank}{candidate.label}",
        insert_text=candidate.text or None,
        text_edit=lsp.TextEdit(places.range(candidate.over), candidate.label) if candidate.over else None,
        additional_text_edits=text_edits(candidate.also, places) or None,
    )


# Changes.


def text_edits(edits: Iterable[Edit], places: Places) -> list[lsp.TextEdit]:
    return [lsp.TextEdit(places.range(each.span), each.text) for each in edits]


def workspace_edit(
    edits: Sequence[Edit],
    places: Places,
    versions: dict[str, int | None] | None,
    why: lsp.ChangeAnnotation | None = None,
) -> lsp.WorkspaceEdit:
    """With `versions`, a change of documents in these versions; `why` is shown by editors with a preview of changes."""
    files = by_file(edits)
    if versions is None:
        return lsp.WorkspaceEdit({places.uri(path): text_edits(some, places) for path, some in files.items()})
    changes: list[lsp.TextDocumentEdit | lsp.CreateFile | lsp.RenameFile | lsp.DeleteFile] = []
    for path, some in files.items():
        document = lsp.OptionalVersionedTextDocumentIdentifier(places.uri(path), versions.get(real(path)))
        made: list[lsp.TextEdit | lsp.AnnotatedTextEdit | lsp.SnippetTextEdit] = []
        for each in some:
            where = places.range(each.span)
            made.append(lsp.AnnotatedTextEdit("why", where, each.text) if why else lsp.TextEdit(where, each.text))
        changes.append(lsp.TextDocumentEdit(document, made))
    return lsp.WorkspaceEdit(document_changes=changes, change_annotations={"why": why} if why else None)


def told(renaming: Renaming) -> str:
    """The changes left to the user; "" if there are none."""
    mentions = [str(each) for each in renaming.mentions]
    more = [f"and {len(mentions) - _MOST_TOLD} more"] if len(mentions) > _MOST_TOLD else []
    return "\n".join(["Still to be changed by hand:", *mentions[:_MOST_TOLD], *more]) if mentions else ""


_MOST_TOLD = 20


def by_lines(before: str, after: str, places_of: Places, path: Path) -> list[lsp.TextEdit]:
    """The change from one text to another that has the same words, by the lines that differ."""
    old, new = before.splitlines(keepends=True), after.splitlines(keepends=True)
    starts = [0, *accumulate(map(len, old))]
    positions = places_of.of(path)
    edits = []
    for (i1, i2), (j1, j2) in _stretches(old, new):
        while i1 < i2 and j1 < j2 and old[i1] == new[j1]:
            i1, j1 = i1 + 1, j1 + 1
        while i1 < i2 and j1 < j2 and old[i2 - 1] == new[j2 - 1]:
            i2, j2 = i2 - 1, j2 - 1
        if i1 < i2 or j1 < j2:
            edits.append(lsp.TextEdit(positions.between(starts[i1], starts[i2]), "".join(new[j1:j2])))
    return edits


def _stretches(old: Sequence[str], new: Sequence[str]) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Ranges of corresponding lines: at the end of each, both texts have the same number of letters.

    In time proportional to their number; to look for equal lines, as difflib does, takes minutes for some thousands.
    """
    theirs = _line_ends(new)
    ends = [(number, theirs[letters]) for letters, number in _line_ends(old).items() if letters in theirs]
    i1 = j1 = 0
    for i2, j2 in (*ends, (len(old), len(new))):
        yield (i1, i2), (j1, j2)
        i1, j1 = i2, j2


def _line_ends(lines: Sequence[str]) -> dict[int, int]:
    """For each number of letters and digits so far, the number of lines."""
    found: dict[int, int] = {}
    for number, letters in enumerate(accumulate(sum(map(str.isalnum, line)) for line in lines), start=1):
        found.setdefault(letters, number)
    return found


# Colours.


LEGEND = lsp.SemanticTokensLegend(list(TYPES), list(MODIFIERS))


def semantic_tokens(coloured: Iterable[Coloured], places: Places) -> lsp.SemanticTokens:
    """Five numbers for each word: lines and columns from the one before, length, type, modifiers."""
    numbers: list[int] = []
    line = column = 0
    for each in coloured:
        where = places.range(each.span)
        start, length = where.start, where.end.character - where.start.character
        numbers += [start.line - line, start.character - (column if start.line == line else 0), length]
        numbers += [TYPES.index(each.type), sum(1 << MODIFIERS.index(modifier) for modifier in each.modifiers)]
        line, column = start.line, start.character
    return lsp.SemanticTokens(numbers)
