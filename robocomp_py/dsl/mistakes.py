"""Explains syntax errors, and mends the text so that the rest of it can be read.

If the intention is clear, the text is corrected; otherwise the statement is blanked. No text moves,
so that later errors are reported at their places in the file.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from ..spelling import closest
from .diagnostics import Diagnostic, Severity
from .source import Source, Span

_MOST_LISTED = 8

END = "the end of the file"
"""The name of the end among the expected words."""

_STRAY = re.compile(r'"[^"\n]*"|[;{](?:\s*;)+')
"""A text, in which nothing is stray, or what ends or opens something, and the semicolons that follow it."""

_ENDIF = re.compile(r"[ \t]*(#[ \t]*endif\b.*)")

_CONFLICT = re.compile(r"^(<{7}|={7}|>{7})(?![<=>])[^\n]*", re.MULTILINE)
"""Marks of git in a text."""

_ENDS = re.compile(r'"[^"\n]*"|[{};]')
_LINE_COMMENT = re.compile(r"[ \t]*//[^\n]*")
_OPENER = re.compile(r"\b(struct|enum|exception|interface)\s+\w+\s*\Z")
_ALIKE = {**dict.fromkeys("({[<", "({[<"), **dict.fromkeys(")]>", ")}]>")}
"""Brackets that are often confused."""


@dataclass(frozen=True)
class Mistake:
    """A syntax error, and how to continue: this part of the text is blanked, and a text is put at its beginning."""

    diagnostic: Diagnostic
    start: int
    end: int
    instead: str = ""

    def mend(self, text: str) -> str:
        """The text to parse next; nothing moves, except that closers may be added at the very end."""
        hole = self.instead + _blank(text[self.start + len(self.instead) : self.end])
        return text[: self.start] + hole + text[self.end :]


def find_stray(text: str) -> list[tuple[int, int]]:
    """The places of semicolons that end nothing, because another one or a `{` is before them; and that of an
    `#endif` in the last line."""
    runs = (found for found in _STRAY.finditer(text) if found[0][0] != '"')
    semicolons = [run.start() + at for run in runs for at, char in enumerate(run[0]) if at and char == ";"]
    return [*((at, at + 1) for at in semicolons), *_last_endif(text)]


def _last_endif(text: str) -> list[tuple[int, int]]:
    end = len(text.rstrip())
    begin = text.rfind("\n", 0, end) + 1
    found = _ENDIF.fullmatch(text, begin, end)
    return [found.span(1)] if found and text[:begin].rstrip().endswith(("}", ";")) else []


def without_stray(text: str) -> str:
    """The text with spaces in place of stray characters, which all generators accept."""
    done, parts = 0, list[str]()
    for start, end in find_stray(text):
        parts += [text[done:start], " " * (end - start)]
        done = end
    return "".join([*parts, text[done:]])


def explain_stray(source: Source, start: int, end: int) -> Diagnostic:
    span = source.span(start, end)
    if span.text.startswith("#"):
        hint = "remove the line"
        return Diagnostic("stray-endif", "there is no preprocessor", span, Severity.WARNING, hint=hint)
    return Diagnostic("stray-semicolon", "a `;` too many", span, Severity.WARNING, hint="remove it")


@dataclass(frozen=True)
class Conflict:
    """An unresolved merge conflict: its begin, the begin of its second version, and its end."""

    begin: int
    middle: int
    end: int


def find_conflicts(text: str) -> list[Conflict]:
    found, begin, middle = list[Conflict](), -1, -1
    for mark in _CONFLICT.finditer(text):
        match mark[1][0]:
            case "<":
                begin, middle = mark.start(), -1
            case "=" if begin >= 0 > middle:
                middle = mark.start()
            case ">" if middle >= 0:
                found.append(Conflict(begin, middle, mark.end()))
                begin = middle = -1
    return found


def without_conflicts(text: str, conflicts: Iterable[Conflict]) -> str:
    """The text with the first version of each conflict."""
    done, parts = 0, list[str]()
    for each in conflicts:
        first = text.index("\n", each.begin)
        parts += [text[done : each.begin], _blank(text[each.begin : first]), text[first : each.middle]]
        parts.append(_blank(text[each.middle : each.end]))
        done = each.end
    return "".join([*parts, text[done:]])


def explain_conflict(source: Source, conflict: Conflict) -> Diagnostic:
    end = source.text.index("\n", conflict.begin)
    hint = "keep one of the two versions, and remove the lines of `<<<<<<<`, `=======` and `>>>>>>>`"
    return Diagnostic("syntax", "a merge conflict is not resolved here", source.span(conflict.begin, end), hint=hint)


def explain_endless(source: Source, comment: Span) -> Diagnostic:
    opening = source.span(comment.start, comment.start + 2)
    return Diagnostic("syntax", "this comment has no end", opening, hint="close it by `*/`")


def explain_character(source: Source, text: str, at: int, expected: list[str]) -> Mistake:
    """A character that begins no word of the language."""
    char, span = text[at], source.span(at, at + 1)
    if char == "#":
        end = text.find("\n", at) if "\n" in text[at:] else len(text)
        span = source.span(at, at + len(text[at:end].rstrip()))
        included = re.match(r'#\s*include\s*[<"]([^>"]+)', span.text)
        hint = "remove the line"
        if included:
            hint = f'write `import "{re.sub(r"[.](ice|h|hpp)$", ".idsl", included[1])}";`'
        return Mistake(Diagnostic("stray-directive", "there is no preprocessor", span, hint=hint), at, end)
    if char == '"':
        return Mistake(
            Diagnostic("syntax", "this string has no end", span, hint='close it by `"`'), *_statement(text, at)
        )
    shown = f"`{char}`" if char.isprintable() else f"character U+{ord(char):04X}"
    name = "" if char.isascii() else f" ({unicodedata.name(char, 'without a name').lower()})"
    hint = ""
    if char.isalpha():
        hint = "names are made of the letters a to z, digits and `_`"
    elif char in "“”„‘’‚«»\N{NO-BREAK SPACE}":
        hint = "write a plain one"
    message = f"unexpected {shown}{name}" + (f"; expected {_listed(expected)}" if char.isascii() and not hint else "")
    return Mistake(Diagnostic("syntax", message, span, hint=hint), *_statement(text, at))


def explain_end(source: Source, text: str, expected: list[str]) -> Mistake:
    """A file that ends too early. Blocks that are not closed are closed, so that they can be checked."""
    end = len(text.rstrip())
    place = source.span(max(0, end - 1), end)
    if not text.strip():
        diagnostic = Diagnostic("syntax", f"there is nothing in this file; expected {_listed(expected)}", place)
        return Mistake(diagnostic, len(text), len(text))
    unclosed = _unclosed(text)
    related = tuple((f"this `{text[at]}` is not closed", source.span(at, at + 1)) for at in unclosed[-1:])
    diagnostic = Diagnostic("syntax", f"the file ends too early; expected {_listed(expected)}", place, related=related)
    closers = "}" * len(unclosed) if "`}`" in expected and len(text) == len(source.text) else ""
    return Mistake(diagnostic, len(text), len(text), closers)


def is_open(text: str) -> bool:
    """Whether a block is not closed somewhere in a text."""
    return bool(_unclosed(text))


def misspelt(found: str, expected: list[str]) -> str:
    """The keyword that a word may be a misspelling of, or nothing."""
    keywords = [word.strip("`") for word in expected if word.startswith("`") and word[1].isalpha()]
    return closest(found, keywords) if re.match(r"\w", found) else ""


@dataclass(frozen=True)
class Ways:
    """How a misplaced word could make sense. The parser has tried each of these."""

    missing: str = ""
    """The mark that may be missing before it."""
    replaced: bool = False
    """Whether the next words fit the keyword that it resembles."""
    removed: bool = False
    """Whether the next words begin a statement without it."""
    keywords: Collection[str] = ()
    """The words of the language that cannot be names."""


def explain_token(source: Source, text: str, span: Span, expected: list[str], ways: Ways) -> Mistake:
    """A word that the grammar does not allow at its place."""
    found, before = text[span.start : span.end], text[: span.start].rstrip()
    if END in expected and set(expected) <= {END, "`;`"}:
        return _explain_rest(text, span)
    block = _block_inside(text, span)
    if block and block.text in ways.keywords:
        message, hint = f"unexpected `{block.text}` in a block", "add `};` above it, to close the block before"
        return Mistake(Diagnostic("syntax", message, block, hint=hint), block.start - 1, block.start, "}")
    meant, missing = misspelt(found, expected), ways.missing
    hint = f"did you mean `{meant}`?" if meant else ""
    if missing and not hint:
        at = len(before)
        hint = f"add `{missing}` here"
        if missing in (_LINE_COMMENT.match(source.text, at) or [""])[0]:
            hint = f"the `//` starts a comment: add `{missing}` in front of it"
        diagnostic = Diagnostic("syntax", f"expected `{missing}` before `{found}`", source.span(at - 1, at), hint=hint)
        end = at + len(missing)
        return Mistake(diagnostic, *((at, end, missing) if end <= span.start else _statement(text, at - 1)))
    message = f"unexpected `{found}`; expected {_listed(expected)}"
    right = [mark for mark in _ALIKE.get(found, "") if f"`{mark}`" in expected]
    if len(right) == 1:
        hint = f"write `{right[0]}` instead"
        return Mistake(Diagnostic("syntax", message, span, hint=hint), span.start, span.end, right[0])
    start = span.end - max(len(meant), len(found))  # a longer keyword replaces spaces before it
    if ways.replaced and start >= 0 and re.fullmatch(r"\W?\s*", text[max(0, start - 1) : span.start]):
        return Mistake(Diagnostic("syntax", message, span, hint=hint), start, span.end, meant)
    if before.endswith("=") and re.match(r"[+-]?[.\d]", found):  # a number, and not one of those that can be there
        return Mistake(Diagnostic("syntax", message, span, hint=hint), len(before) - 1, span.end)
    if ways.removed and not hint and re.match(r"\w", found) and (not before or before[-1] in ";{}"):
        return Mistake(Diagnostic("syntax", message, span, hint="remove it"), span.start, span.end)
    return Mistake(Diagnostic("syntax", message, span, hint=hint), *_statement(text, span.start))


def _explain_rest(text: str, span: Span) -> Mistake:
    """Text after the one definition of a file: all of it is left out."""
    hint = "a file has only one definition; remove the text after it"
    if span.text == "}":
        hint = "remove it, or a `}` above that is one too many"
    return Mistake(
        Diagnostic("trailing-text", f"unexpected `{span.text}` after the end", span, hint=hint), span.start, len(text)
    )


def _block_inside(text: str, span: Span) -> Span | None:
    """A word that begins a definition inside a block, because the block before it was not closed."""
    opener = _OPENER.search(text, 0, span.start) if span.text == "{" else None
    if opener and text[opener.start() - 1 : opener.start()].isspace():
        return span.source.span(*opener.span(1))
    return None


def _blank(text: str) -> str:
    return re.sub(r"[^\n]", " ", text)


def _listed(words: list[str]) -> str:
    if len(words) > _MOST_LISTED:
        words = [*words[:_MOST_LISTED], "…"]
    return ", ".join(words[:-1]) + " or " + words[-1] if len(words) > 1 else "".join(words)


def _statement(text: str, at: int) -> tuple[int, int]:
    """The statement around an offset: from after the last `;`, `{` or `}` to its `;`, its block included."""
    start = 0
    for found in _ENDS.finditer(text, 0, at):
        if found[0] in "{};":
            start = found.end()
    depth = 0
    for found in _ENDS.finditer(text, at):
        match found[0]:
            case ";" if depth == 0:
                return start, found.end()
            case "{":
                depth += 1
            case "}" if depth == 0:
                alone = found.start() == at and not text[start:at].strip()
                return start, found.end() if alone else found.start()
            case "}":
                depth -= 1
                if depth == 0:
                    rest = re.match(r"\s*;", text[found.end() :])
                    return start, found.end() + (rest.end() if rest else 0)
    return start, len(text)


def _unclosed(text: str) -> list[int]:
    """The places of braces that are not closed, outermost first."""
    waiting: list[int] = []
    for found in _ENDS.finditer(text):
        if found[0] == "{":
            waiting.append(found.start())
        elif found[0] == "}" and waiting:
            waiting.pop()
    return waiting
