"""What a C++ file says about one class: its methods, and what the file includes.

Read as tokens, without a compiler: the headers it needs are seldom there. Braces and parentheses say where something
ends, and what is not understood is stepped over. Of the branches of an `#if`, the first counts (of `#if 0`, the
second). A parser of all of C++ (tree-sitter's) finds the same methods in what RoboComp's users have published, so
nobody has to install one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True)
class Token:
    text: str
    line: int
    word: bool
    """Whether it is a name or a number."""


@dataclass(frozen=True)
class Parameter:
    type: str
    name: str
    """Empty if it has none."""

    @property
    def gives_back(self) -> bool:
        """Whether the caller gets something by it: a reference to what may be changed."""
        return self.type.endswith("&") and not self.type.endswith("&&") and "const" not in self.type.split()


@dataclass(frozen=True)
class Method:
    name: str
    line: int
    returns: str
    """Empty of constructors and destructors."""
    parameters: tuple[Parameter, ...] = ()
    body: tuple[Token, ...] | None = None
    """None if it is only declared."""
    section: str = ""
    """Of a declaration: `slots`, `signals`, or nothing in particular."""

    @property
    def text(self) -> str:
        given = ", ".join(f"{each.type} {each.name}".rstrip() for each in self.parameters)
        return f"{self.returns} {self.name}({given})".lstrip()


@dataclass(frozen=True)
class Include:
    name: str
    line: int
    quoted: bool
    """Whether it is looked for beside the file first."""


@dataclass(frozen=True)
class Unit:
    """What one file says."""

    file: str
    includes: tuple[Include, ...]
    defined: tuple[Method, ...]
    declared: tuple[Method, ...]


def read(file: str, text: str, of: str) -> Unit:
    """The methods of class `of` that a file defines or declares. Whatever the text is, this raises nothing."""
    tokens, includes = _tokens(text)
    found = list(_file(tokens, of))
    defined = tuple(each for each in found if each.body is not None)
    return Unit(file, tuple(includes), defined, tuple(each for each in found if each.body is None))


# Text to tokens.

_TOKEN = re.compile(
    r"""
      (?P<blank> \s+ | //(?:\\\r?\n|[^\n])* | /\*.*?(?:\*/|\Z) )
    | (?P<directive> \#(?:\\\r?\n|/\*.*?\*/|[^\n])* )
    | (?P<string> (?:u8|[uUL])?R"(?P<edge>[^()\\\s]{0,16})\(.*?(?:\)(?P=edge)"|\Z)
                | (?:u8|[uUL])?"(?:\\.|[^"\\\n])*"?
                | (?:u8|[uUL])?'(?:\\.|[^'\\\n])*'? )
    | (?P<word> [^\W\d]\w* | \.?\d(?:'?\w|\.)* )
    | (?P<mark> ::|->|&&|. )
    """,
    re.VERBOSE | re.DOTALL,
)
_INCLUDE = re.compile(r'#\s*include\s*(?:"([^"\n]+)"|<([^>\n]+)>)')
_DIRECTIVE = re.compile(r"#\s*(\w+)\s*(.*)", re.DOTALL)


def _tokens(text: str) -> tuple[list[Token], list[Include]]:
    tokens: list[Token] = []
    includes: list[Include] = []
    branches = _Branches()
    line = 1
    for match in _TOKEN.finditer(text):
        piece, kind = match.group(), match.lastgroup
        if kind == "directive":
            branches.see(piece)
            include = _INCLUDE.match(piece)
            if include and branches.taken:
                includes.append(Include(include[1] or include[2], line, bool(include[1])))
            tokens.append(Token("#", line, False))  # nothing goes on across it
        elif kind != "blank" and branches.taken:
            tokens.append(Token(piece, line, kind == "word"))
        line += piece.count("\n")
    return tokens, includes


class _Branches:
    """Which of the alternatives of the preprocessor count."""

    def __init__(self) -> None:
        self._open: list[tuple[bool, bool]] = []
        """Of each `#if`: whether its present branch counts, and whether one counted before."""

    @property
    def taken(self) -> bool:
        return all(taken for taken, _ in self._open)

    def see(self, directive: str) -> None:
        match = _DIRECTIVE.match(directive)
        name, condition = (match[1], match[2].strip()) if match else ("", "")
        if name in ("if", "ifdef", "ifndef"):
            taken = not (name == "if" and condition in ("0", "false"))
            self._open.append((taken, taken))
        elif name in ("else", "elif") and self._open:
            _, before = self._open.pop()
            self._open.append((not before, True))
        elif name == "endif" and self._open:
            self._open.pop()


# Tokens to methods.

_OPEN = {"(": ")", "[": "]", "{": "}"}
_AFTER = {"const", "noexcept", "override", "final", "volatile", "mutable", "try", "&", "&&"}
_NO_NAMES = {
    *("auto", "bool", "char", "const", "double", "float", "int", "long", "short", "signed", "unsigned", "void"),
    *("alignas", "case", "catch", "decltype", "delete", "do", "else", "for", "if", "new", "return", "sizeof", "switch"),
    *("static_assert", "throw", "while"),
}
_KINDS = {"class", "struct", "union", "enum"}
_SECTIONS = {"public", "private", "protected", "signals", "Q_SIGNALS", "slots", "Q_SLOTS"}


def _file(tokens: Sequence[Token], of: str) -> Iterator[Method]:
    """The methods of a class in a file, or in a namespace of it."""
    place = start = 0
    while place < len(tokens):
        text = tokens[place].text
        if text in (";", "}", "#"):
            start = place + 1
        elif text == "{":
            head = {token.text for token in tokens[start:place]}
            end = _closing(tokens, place)
            if of in head and head & _KINDS:
                yield from _members(tokens[place + 1 : end], of)
            if not head & {"namespace", "extern"}:
                place = end
            start = place + 1
        elif text == "(":
            path = _path(tokens, place)
            found = _definition(tokens, start, place, path, of) if len(path) > 1 and path[0].text == of else None
            if found:
                method, place = found
                start = place + 1
                yield method
            else:
                place = _closing(tokens, place)
        place += 1


def _path(tokens: Sequence[Token], place: int) -> list[Token]:
    """The names before a parenthesis: SpecificWorker::compute, without the `::`."""
    path: list[Token] = []
    while place > 0 and tokens[place - 1].word:
        place -= 1
        path.append(tokens[place])
        if place > 0 and tokens[place - 1].text == "~":
            place -= 1
            path[-1] = replace(path[-1], text=f"~{path[-1].text}")
        if place == 0 or tokens[place - 1].text != "::":
            break
        place -= 1
    return path[::-1]


def _definition(
    tokens: Sequence[Token], start: int, place: int, path: Sequence[Token], of: str
) -> tuple[Method, int] | None:
    """A method that is defined here, and where it ends; None if it is only called."""
    close = _closing(tokens, place)
    body, trailing = _body(tokens, close + 1)
    if body is None:
        return None
    end = _closing(tokens, body) if tokens[body].text == "{" else body
    first = next(at for at in range(start, place) if tokens[at] is path[0])
    name = "::".join(token.text for token in path[1:])
    inside = tuple(tokens[body + 1 : end])
    returned = trailing or _returned(tokens[start:first])
    if path[-1].text.lstrip("~") == path[-2].text:
        returned = ""
    return Method(name, path[-1].line, returned, _parameters(tokens[place + 1 : close]), inside), end


def _body(tokens: Sequence[Token], place: int) -> tuple[int | None, str]:
    """Where the body begins after the parameters, and the type that was said behind them."""
    trailing: list[Token] = []
    while place < len(tokens):
        text = tokens[place].text
        if text == "{":
            return place, _spelt(trailing)
        if text == ":":
            return _after_initializers(tokens, place + 1), ""
        if text == "=":  # = default
            end = place
            while end < len(tokens) and tokens[end].text != ";":
                end += 1
            return min(end, len(tokens) - 1), ""
        if text == "->":
            while place + 1 < len(tokens) and tokens[place + 1].text not in ("{", ";"):
                place += 1
                trailing.append(tokens[place])
        elif text == "(":
            place = _closing(tokens, place)
        elif text not in _AFTER and text != "#" and not tokens[place].word:
            return None, ""
        place += 1
    return None, ""


def _after_initializers(tokens: Sequence[Token], place: int) -> int | None:
    """The body of a constructor, behind `: base(1), member{2}`."""
    item = False
    while place < len(tokens):
        text = tokens[place].text
        if text == "{" and not item:
            return place
        if text in ("(", "{"):
            place = _closing(tokens, place)
            item = False
        elif tokens[place].word:
            item = True
        elif text == ";":
            return None
        place += 1
    return None


def _members(tokens: Sequence[Token], of: str) -> Iterator[Method]:
    """The methods that a class declares, or defines inside."""
    place = start = 0
    section = ""
    while place < len(tokens):
        text = tokens[place].text
        if text == "#" or (text.startswith("Q_") and text not in _SECTIONS and place == start):
            start = place + 1
        elif text == "(" and place == start:
            place = _closing(tokens, place)  # of Q_PROPERTY(…)
            start = place + 1
        elif text == ":" and start < place and {token.text for token in tokens[start:place]} <= _SECTIONS:
            section = tokens[place - 1].text.replace("Q_", "").lower()
            section = section if section in ("slots", "signals") else ""
            start = place + 1
        elif text == ";":
            method = _member(tokens[start:place], of)
            if method:
                yield replace(method, section=section)
            start = place + 1
        elif text == "{":
            end = _closing(tokens, place)
            head = tokens[start:place]
            method = None if head and head[0].text in _KINDS else _member(head, of)
            if method:
                yield replace(method, body=tuple(tokens[place + 1 : end]), section=section)
                start = end + 1
            place = end
        place += 1


def _member(tokens: Sequence[Token], of: str) -> Method | None:
    """The method that a declaration in a class is, if it is one."""
    tokens = _without_attributes(tokens)
    if not tokens or tokens[0].text in ("using", "typedef", "friend", "static_assert"):
        return None
    angles = 0
    for place, token in enumerate(tokens):
        if token.text in ("=", "[", "{") and not angles:
            return None
        angles += {"<": 1, ">": -1}.get(token.text, 0)
        if token.text != "(" or angles:
            continue
        name = tokens[place - 1] if place else token
        if not name.word or name.text in _NO_NAMES:
            return None
        destroys = place > 1 and tokens[place - 2].text == "~"
        before = tokens[: place - 2 if destroys else place - 1]
        returned = _returned(before)
        if not returned and name.text != of:
            return None  # a macro
        close = _closing(tokens, place)
        trailing = next((at for at in range(close, len(tokens)) if tokens[at].text == "->"), None)
        returned = _spelt(tokens[trailing + 1 :]) if trailing else "" if name.text == of else returned
        parameters = _parameters(tokens[place + 1 : close])
        return Method(f"~{name.text}" if destroys else name.text, name.line, returned, parameters)
    return None


_NO_TYPES = {"virtual", "static", "inline", "explicit", "constexpr", "friend", "extern", "Q_INVOKABLE", "Q_SLOT"}


def _returned(tokens: Sequence[Token]) -> str:
    if tokens and tokens[0].text == "template":
        end = next((at for at in _angle_ends(tokens) if at), 0)
        tokens = tokens[end + 1 :]
    return _spelt([token for token in _without_attributes(tokens) if token.text not in _NO_TYPES])


def _without_attributes(tokens: Sequence[Token]) -> Sequence[Token]:
    """Behind `[[nodiscard]]`."""
    while len(tokens) > 1 and tokens[0].text == tokens[1].text == "[":
        tokens = tokens[_closing(tokens, 0) + 1 :]
    return tokens


def _angle_ends(tokens: Sequence[Token]) -> Iterator[int]:
    depth = 0
    for place, token in enumerate(tokens):
        depth += {"<": 1, ">": -1}.get(token.text, 0)
        if token.text == ">" and not depth:
            yield place


def _parameters(tokens: Sequence[Token]) -> tuple[Parameter, ...]:
    found, piece, depth = [], list[Token](), 0
    for token in tokens:
        if token.text == "," and not depth:
            found.append(_parameter(piece))
            piece = []
            continue
        depth += {"(": 1, "[": 1, "{": 1, "<": 1, ")": -1, "]": -1, "}": -1, ">": -1}.get(token.text, 0)
        piece.append(token)
    found.append(_parameter(piece))
    return tuple(each for each in found if each.type not in ("", "void"))


def _parameter(tokens: list[Token]) -> Parameter:
    tokens = [token for token in tokens if token.text != "#"]
    default = next((at for at, token in enumerate(tokens) if token.text == "="), len(tokens))
    tokens = tokens[:default]
    array = next((at for at, token in enumerate(tokens) if token.text == "["), len(tokens))
    kind, behind = tokens[:array], tokens[array:]
    words = [token for token in kind if token.text not in ("const", "volatile", "struct")]
    named = (
        len(words) > 1
        and kind[-1].word
        and kind[-1].text not in (*_NO_NAMES, "const", "volatile")
        and kind[-2].text != "::"
    )
    name = kind.pop().text if named else ""
    return Parameter(_spelt([*kind, *behind]), name)


def _closing(tokens: Sequence[Token], place: int) -> int:
    """Where what is opened there is closed, or the last place of all."""
    opening = tokens[place].text
    closing, depth = _OPEN[opening], 0
    for at in range(place, len(tokens)):
        depth += {opening: 1, closing: -1}.get(tokens[at].text, 0)
        if not depth:
            return at
    return len(tokens) - 1


def _spelt(tokens: Sequence[Token]) -> str:
    """As people write it: `const std::map<std::string, int>&`."""
    text = ""
    before = ""
    for token in tokens:
        if token.text == "#":
            continue
        apart = token.word and (before[-1:].isalnum() or before[-1:] in ("_", "&", "*", ">", ","))
        text += f" {token.text}" if apart and text else token.text
        before = token.text
    return text
