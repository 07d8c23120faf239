"""Changes a name everywhere in the project's models. Uses in Python code are reported, but not changed."""

from __future__ import annotations

import ast
import keyword
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ..dsl.diagnostics import Diagnostic, Severity
from ..dsl.idsl.check import BUILTIN
from ..dsl.workspace import read_file
from .edits import Edit, apply
from .index import Found, Index
from .outline import DEFINITIONS, Kind, Symbol
from .project import Project, real, without_mark

_RENAMED = {
    *DEFINITIONS,
    Kind.FIELD,
    Kind.ENUMERATOR,
    Kind.OPERATION,
    Kind.ARGUMENT,
    Kind.COMPONENT,
    Kind.TIMER,
    Kind.PARAMETER,
    Kind.LIST,
    Kind.CHOICE,
    Kind.HOST,
    Kind.SYSTEM,
    Kind.INSTANCE,
    Kind.NAMED,
    Kind.STATE,
}
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_WORDS_OF_IDSL = {"void", "sequence", "out", "idempotent", *BUILTIN}

_LATER = "config"
"""Prefixes of the codes of diagnostics that the user has to resolve afterwards."""

_TAKEN = "shadowed-name"
"""The code of the warning that a name now means something else."""

_MOST_CODE = 50
"""The most Python files of one component that are searched."""


class CannotRename(ValueError):
    """A rename is impossible; the message says why."""


@dataclass(frozen=True)
class Mention:
    """A place in another file with the old name, which the user has to change."""

    word: str
    path: Path
    line: int

    def __str__(self) -> str:
        return f"`{self.word}` in {self.path}:{self.line}"


@dataclass(frozen=True)
class Renaming:
    edits: tuple[Edit, ...]
    mentions: tuple[Mention, ...]


def can_be_renamed(symbol: Symbol) -> bool:
    return symbol.kind in _RENAMED


def renamed_at(index: Index, path: Path, offset: int) -> Found | None:
    """The word at a place that can be renamed; None if there is none."""
    found = index.at(path, offset)
    if found is None or len(found.symbols) != 1 or found.symbols[0].kind not in _RENAMED:
        return None
    return found


def rename(index: Index, path: Path, offset: int, new: str) -> Renaming:
    """All changes of a rename. Raises CannotRename."""
    found = renamed_at(index, path, offset)
    if found is None:
        raise CannotRename("nothing here can be renamed")
    symbol = found.symbols[0]
    home = symbol.name.span.source.path
    if not index.project.owns(home):
        raise CannotRename(f"{symbol.kind} `{symbol.name}` is defined in {home}, which is not part of this project")
    _check_name(new, symbol)
    edits = tuple(_edits(index, symbol, new)) if new != symbol.name.text else ()
    _check_outcome(index, symbol, new, edits)
    return Renaming(edits, tuple(_mentions(index, symbol)))


def _check_name(new: str, symbol: Symbol) -> None:
    if symbol.kind is Kind.CHOICE:
        if not new or '"' in new or "\n" in new:
            raise CannotRename(f"`{new}` cannot be a choice")
        return
    if not _IDENTIFIER.fullmatch(new):
        raise CannotRename(
            f"`{new}` is not a name: names are made of the letters a to z, digits and `_`, a digit not first"
        )
    if keyword.iskeyword(new) or new == "self":
        raise CannotRename(f"`{new}` is a keyword of Python")
    if new.startswith("__"):
        raise CannotRename(f"`{new}`: names that begin with two underscores are reserved by Python")
    if new in _WORDS_OF_IDSL and symbol.name.span.source.path.suffix == ".idsl":
        raise CannotRename(f"`{new}` is a word of IDSL")


def _edits(index: Index, symbol: Symbol, new: str) -> Iterator[Edit]:
    home = index.outline(symbol.name.span.source.path)
    implied = [use for use in home.uses if use.implied and use.name.span == symbol.name.span] if home else []
    yield Edit(symbol.name.span, f"{new} : {symbol.name}" if implied and symbol.kind is Kind.INSTANCE else new)
    for use in index.uses_of(symbol):
        if use.implied:  # the instance keeps its name, and now names its component
            yield Edit(use.name.span.source.span(use.name.span.end, use.name.span.end), f" : {new}")
        elif use.name.span != symbol.name.span:
            yield Edit(use.name.span, new)


def by_file(edits: Iterable[Edit]) -> dict[Path, list[Edit]]:
    found: dict[str, tuple[Path, dict[Edit, None]]] = {}
    for each in edits:
        path = each.span.source.path
        found.setdefault(real(path), (path, {}))[1][each] = None
    return {path: list(some) for path, some in found.values()}


def _check_outcome(index: Index, symbol: Symbol, new: str, edits: tuple[Edit, ...]) -> None:
    """Refuse changes that cause a new error."""
    changed = by_file(edits)
    texts = [(path, apply(without_mark(index.project.text(path)), some)) for path, some in changed.items()]
    concerned = {real(path): path for path in (*changed, *index.seeing(symbol))}
    after = index.project.with_texts(texts)
    for path in concerned.values():
        worse = _worse(_errors(index.project, path), _errors(after, path))
        if worse:
            line, _ = worse.span.source.position(worse.span.start)
            raise CannotRename(f"`{symbol.name}` cannot be called `{new}`: {worse.message} ({path.name}:{line})")


def _errors(project: Project, path: Path) -> list[Diagnostic]:
    own = (each for each in project.check(path) if each.span.source.path == path)
    wrong = (each for each in own if each.severity is Severity.ERROR or each.code == _TAKEN)
    return [each for each in wrong if not each.code.startswith(_LATER)]


def _worse(before: list[Diagnostic], after: list[Diagnostic]) -> Diagnostic | None:
    more = Counter(each.code for each in after) - Counter(each.code for each in before)
    return next((each for each in after if each.code in more), None)


# Python code and configurations.


def _mentions(index: Index, symbol: Symbol) -> Iterator[Mention]:
    if symbol.kind is Kind.NAMED:
        yield from _names_in_text(index, symbol)
    pattern = _in_python(symbol)
    for folder in _components_with(index, symbol) if pattern else ():
        for path in _code_in(folder)[:_MOST_CODE]:
            yield from _words_in(path, pattern)
        if symbol.kind in (Kind.PARAMETER, Kind.LIST, Kind.TIMER):
            yield from _keys_in(folder / "etc" / "config.toml", symbol.name.text)


def _names_in_text(index: Index, symbol: Symbol) -> Iterator[Mention]:
    """Where the code of the component that offers a named instance has its name, and its configuration."""
    name = symbol.name.text
    for model in users_of(index, symbol):
        for path in _code_in(model.parent)[:_MOST_CODE]:
            yield from (Mention(name, path, line) for line in _lines_with(path, rf"""(["']){name}\1"""))
        config = model.parent / "etc" / "config.toml"
        yield from (Mention(name, config, line) for line in _lines_with(config, rf"\s*\[offers\.{name}\b"))


def _lines_with(path: Path, pattern: str) -> Iterator[int]:
    try:
        lines = read_file(path).decode("utf-8", "replace").splitlines()
    except (OSError, ValueError):
        return
    yield from (number for number, line in enumerate(lines, 1) if re.search(pattern, line))


def _code_in(folder: Path) -> list[Path]:
    """The specific part comes first."""
    return sorted(folder.glob("*.py"), key=lambda path: (path.name != "specificworker.py", path.name))


def _in_python(symbol: Symbol) -> str:
    """A pattern for the names in Python code that are derived from a symbol's name."""
    name, owner = symbol.name.text, symbol.within.rpartition("::")[2]
    match symbol.kind:
        case Kind.INTERFACE:
            return rf"{name}\d*_\w+|{name.lower()}\d*_proxy|{name}(Proxy|Publisher)"
        case Kind.OPERATION:
            return rf"{owner}\d*_{name}|\w+_proxy\.{name}(Async)?"
        case Kind.TIMER:
            return rf"timer_{name}|timers\.{name}"
        case Kind.STATE:
            return rf"sm_{name}|t_{name}_to_\w+|t_\w+_to_{name}"
        case Kind.PARAMETER | Kind.LIST | Kind.STRUCT | Kind.ENUM | Kind.ENUMERATOR | Kind.EXCEPTION | Kind.FIELD:
            return rf"(\w+\.)?{name}"
        case _:
            return ""


def _components_with(index: Index, symbol: Symbol) -> list[Path]:
    """The folders of the components that use a symbol."""
    return list(dict.fromkeys(path.parent for path in users_of(index, symbol)))


def users_of(index: Index, symbol: Symbol) -> list[Path]:
    """The models of the components whose code may use a symbol."""
    home = symbol.name.span.source.path
    if symbol.kind is Kind.NAMED:
        return [each.name.span.source.path for each in component_of(index, symbol)]
    return [home] if symbol.kind is Kind.TIMER else index.files_that_need(home)


def component_of(index: Index, named: Symbol) -> list[Symbol]:
    """The component that offers a named instance; none if it is unknown."""
    home = named.name.span.source.path
    made = index.outline(home)
    kind = next((each.detail.lower() for each in made.walk() if named in each.children), "") if made else ""
    return [each for each in index.visible(home) if each.kind is Kind.COMPONENT and each.name.text.lower() == kind]


def namesakes(index: Index, named: Symbol) -> list[Symbol]:
    """The named instances of the same name that the same component offers elsewhere."""
    component = component_of(index, named)
    found = (each for each in index.symbols() if each.kind is Kind.NAMED and each.name.text == named.name.text)
    return [each for each in found if each != named and component and component_of(index, each) == component]


def _words_in(path: Path, pattern: str) -> Iterator[Mention]:
    try:
        tree = ast.parse(read_file(path))
    except (OSError, ValueError, SyntaxError):
        return  # an unreadable file mentions nothing
    seen = set()
    for node in ast.walk(tree):
        word = _word(node)
        line = getattr(node, "lineno", 0)
        if word and (word, line) not in seen and re.fullmatch(pattern, word):
            seen.add((word, line))
            yield Mention(word, path, line)


def _word(node: ast.AST) -> str:
    match node:
        case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.Name(id=name) | ast.alias(name=name):
            return name
        case ast.Attribute(attr=attribute, value=ast.Attribute(attr=owner) | ast.Name(id=owner)):
            return f"{owner}.{attribute}" if owner != "self" else attribute
        case ast.Attribute(attr=attribute):
            return attribute
        case ast.keyword(arg=str(name)):
            return name
        case _:
            return ""


def _keys_in(path: Path, name: str) -> Iterator[Mention]:
    try:
        lines = read_file(path).decode("utf-8", "replace").splitlines()
    except OSError:
        return
    for number, line in enumerate(lines, 1):
        if re.match(rf"\s*{name}\s*=|\s*\[+params\.(\w+\.)*{name}\b", line):
            yield Mention(name, path, number)
