"""Hover texts: the kind of a word, its declaration, its documentation, and its uses."""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from pathlib import Path

from ..contract.qos import PRESETS
from ..dsl.comments import find_comments
from ..dsl.ddsl.clauses import explanation
from ..dsl.idsl.check import BUILTIN
from ..dsl.source import Source
from ..transports.deployment import deployment_of
from .index import Index
from .outline import Kind, Symbol
from .project import real

_MOST_LINES = 24
"""Of a definition."""

_MOST_FILES = 8

_WHOLE = (
    Kind.STRUCT,
    Kind.ENUM,
    Kind.EXCEPTION,
    Kind.INTERFACE,
    Kind.SEQUENCE,
    Kind.DICTIONARY,
    Kind.CONST,
    Kind.HOST,
    Kind.NAMED,
)
"""Kinds that are shown with the text of their files."""


def hover(index: Index, path: Path, offset: int, text: str) -> str:
    """Markdown; nothing if there is nothing to say."""
    found = index.at(path, offset)
    if found:
        symbols = found.symbols
        if found.use is None and symbols[0].kind is Kind.INSTANCE:
            symbols = (*symbols, *_components_of(index, symbols[0]))
        return "\n\n---\n\n".join(_of_symbol(index, each) for each in symbols)
    link = index.link_at(path, offset)
    if link:
        target = index.target(link)
        return f"`{target}`" if target else f"`{link.name}` was not found"
    return _of_word(
        _word_at(text, offset), path.suffix.lower(), _first_word(find_comments(Source(path, text[:offset])).bare)
    )


def _of_symbol(index: Index, symbol: Symbol) -> str:
    language = symbol.name.span.source.path.suffix.removeprefix(".")
    parts = [f"```{language}\n{_declaration(symbol)}\n```"]
    if symbol.doc:
        parts.append(symbol.doc)
    home = symbol.name.span.source.path
    parts.append(f"{symbol.kind} of `{symbol.within or home.name}`, in {home.name}")
    used = _used(index, symbol)
    return "\n\n".join([*parts, used] if used else parts)


def _declaration(symbol: Symbol) -> str:
    match symbol.kind:
        case Kind.OPERATION:
            return symbol.detail
        case Kind.FIELD | Kind.ARGUMENT:
            return f"{symbol.detail} {symbol.name}"
        case Kind.PARAMETER:
            return f"{symbol.name} {symbol.detail}"
        case Kind.COMPONENT:
            return "\n".join(
                [f"Component {symbol.name}", *(f"    {port};" for port in symbol.detail.split(", ") if port)]
            )
        case Kind.INSTANCE:
            return f"Component {symbol.name} : {symbol.detail}"
        case kind if kind in _WHOLE:
            return _cut(symbol)
        case kind:
            return f"{kind} {symbol.name} {symbol.detail}".rstrip()


def _cut(symbol: Symbol) -> str:
    span = symbol.span
    indent = len(span.text) and span.source.position(span.start)[1] - 1
    lines = textwrap.dedent(" " * indent + span.text).splitlines()
    return "\n".join(lines if len(lines) <= _MOST_LINES else [*lines[:_MOST_LINES], "    …"])


def _used(index: Index, symbol: Symbol) -> str:
    files = Counter(
        real(use.name.span.source.path)
        for use in index.uses_of(symbol)
        if not use.implied or symbol.kind is Kind.COMPONENT
    )
    if not files:
        return ""
    names = [f"{Path(each).name}{f' ({count} times)' if count > 1 else ''}" for each, count in sorted(files.items())]
    more = f" and {len(names) - _MOST_FILES} more" if len(names) > _MOST_FILES else ""
    return f"Used in {', '.join(names[:_MOST_FILES])}{more}"


def _components_of(index: Index, instance: Symbol) -> list[Symbol]:
    seen = index.visible(instance.name.span.source.path)
    return [each for each in seen if each.kind is Kind.COMPONENT and each.name.text.lower() == instance.detail.lower()]


def _of_word(word: str, ending: str, first: str) -> str:
    """`first` is the word that begins its statement."""
    if ending == ".idsl" and word in BUILTIN:
        return f"`{word}`: {BUILTIN[word]}, built in"
    if ending in (".cdsl", ".ddsl") and word in PRESETS:
        qos = PRESETS[word]
        return f"`{word}`: {qos.reliability}, {qos.durability}, {qos.history}, depth {qos.depth}"
    if ending == ".cdsl" and word.lower() in POLICY_WORDS:
        return f"`{word}`: {POLICY_WORDS[word.lower()]}"
    if ending == ".cdsl" and word.lower() in COMPONENT_WORDS:
        return f"`{word}`: {COMPONENT_WORDS[word.lower()]}"
    if ending == ".idsl" and word in ACTION_WORDS:
        return f"`{word}`: {ACTION_WORDS[word]}"
    if ending in (".cdsl", ".ddsl") and (summary := deployment_of(word.lower()).summary):
        return f"`{word}`: {summary}"
    text = explanation(word, first) if ending == ".ddsl" else ""
    return f"`{word}`: {text}" if text else ""


POLICY_WORDS = {
    "refuse": "while a goal of the action is active, another one is refused; this is the default",
    "preempt": "a new goal of the action cancels the active one",
    "queue": "a new goal of the action waits until the active one is over",
}
ACTION_WORDS = {
    "action": "an operation that takes long: its client gets a goal with feedback, cancellation and a result",
    "confirm": "tools ask a person before they call it by hand: it stops or moves something",
    "feedback": "what the server of an action tells its client on the way",
}


COMPONENT_WORDS = {
    "period": "the time from one `compute` to the next, as in `period 50 ms;`",
    "timer": "a method that is called once in a period: `timer report 1 s;` calls `timer_report`",
    "each": "the component provides the interface under any number of names, which it adds while it runs",
    "concurrent": "handlers of the interface run at any time, also while other code of the component runs",
}


def _first_word(before: str) -> str:
    """Of the statement that a text ends with."""
    found = re.match(r"\s*(\w*)", re.split(r"[;{}]", before)[-1])
    return found[1] if found else ""


def _word_at(text: str, offset: int) -> str:
    before = re.search(r"\w*$", text[:offset])
    behind = re.match(r"\w*", text[offset:])
    return (before[0] if before else "") + (behind[0] if behind else "")
