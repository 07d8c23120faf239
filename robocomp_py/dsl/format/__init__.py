"""Formats files of the languages: the same words and comments in one layout.

The meaning of a file, and which comment documents what, do not change. A formatted text stays as it is.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from ..cdsl.parser import parse as parse_cdsl
from ..comments import find_comments
from ..ddsl.parser import parse as parse_ddsl
from ..diagnostics import DslError, Report
from ..idsl.parser import parse as parse_idsl
from ..pdsl.parser import parse as parse_pdsl
from ..smdsl.parser import parse as parse_smdsl
from ..source import Source
from ..syntax import Grammar
from .layout import Customs, lay_out
from .words import read_words


@dataclass(frozen=True)
class _Language:
    grammar: Grammar
    parse: Callable[[Source, Report], object]
    """Reports the errors in a text."""
    customs: Customs = field(default_factory=Customs)


_LANGUAGES = {
    "idsl": _Language(Grammar("idsl"), parse_idsl),
    "cdsl": _Language(Grammar("cdsl"), parse_cdsl, Customs(apart=False)),
    "pdsl": _Language(Grammar("pdsl"), parse_pdsl, Customs(tight=frozenset({":"}), goes_on=True)),
    "ddsl": _Language(Grammar("ddsl"), parse_ddsl),
    "smdsl": _Language(Grammar("smdsl"), parse_smdsl, Customs(tight=frozenset({":"}), apart=False)),
}
LANGUAGES = tuple(_LANGUAGES)

_LINE_END = re.compile(r"\r+\n")


def format_text(text: str, language: str, path: Path = Path("<text>")) -> str:
    """The formatted text. Raises DslError if its syntax is wrong; `path` is its name in diagnostics.

    `language` is one of LANGUAGES. Lines end in LF, and there is no byte order mark.
    """
    known = _LANGUAGES[language]
    source = Source(path, _LINE_END.sub("\n", text.removeprefix("\ufeff")))
    comments = find_comments(source)
    tokens = known.grammar.tokens(source, comments)
    if tokens is None:
        report = Report()
        known.parse(Source(path, text.removeprefix("\ufeff")), report)
        raise DslError(report.diagnostics)
    keywords = {kind: word for kind, word in known.grammar.keywords.items() if not kind.startswith("LEGACY")}
    return lay_out(read_words(source.text, tokens, comments.spans, keywords), known.customs)
