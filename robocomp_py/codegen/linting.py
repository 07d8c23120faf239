"""Comments that silence linters in generated code, where names and texts of the models break a rule.

    one line     # noqa: E741, RUF100           an argument `l`, a text that cannot be split
    one file     # ruff: noqa: N999, RUF100     rules that can only be silenced for the whole file

RUF100 is silenced, too: a linter that does not check the rule would complain about the comment.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import lru_cache

from .layout import WIDTH

_UNUSED = "RUF100"
_CONFUSING = ("l", "O", "I")
_CONFUSING_WORD = re.compile(rf"\b[{''.join(_CONFUSING)}]\b")
_MODULE = re.compile(r"[a-z_][a-z0-9_]*")
_LOWER_ALIAS = re.compile(r"_?[a-z0-9]")


TEXTS = 64
"""How many texts are remembered. Components that use one interface have the same text for its module."""


@lru_cache(maxsize=2)
def parsed(text: str) -> ast.Module:
    """The syntax of a text, which several steps look at, one after the other. None may change it."""
    return ast.parse(text)


@lru_cache(TEXTS)
def excused(text: str) -> str:
    """The text with comments on the lines that break a rule."""
    lines = text.splitlines()
    reasons: dict[int, set[str]] = {}
    may_break = max(map(len, lines), default=0) > WIDTH or _CONFUSING_WORD.search(text)
    for node in ast.walk(parsed(text)) if may_break else ():
        match node:
            case ast.arg(arg=name) | ast.AnnAssign(target=ast.Name(id=name)) | ast.Assign(targets=[ast.Name(id=name)]):
                rule = "E741"
            case ast.ClassDef(name=name):
                rule = "E742"
            case ast.FunctionDef(name=name):
                rule = "E743"
            case ast.Constant(value=str(), lineno=line, end_lineno=end) if line == end:
                name, rule = ("l", "E501") if len(lines[line - 1]) > WIDTH else ("", "")
            case _:
                continue
        if name in _CONFUSING:
            reasons.setdefault(node.lineno, set()).add(rule)
    for number, rules in reasons.items():
        lines[number - 1] += f"  # noqa: {', '.join((*sorted(rules), _UNUSED))}"
    return "\n".join(lines) + "\n"


@lru_cache(TEXTS)
def excused_file(text: str, module: str) -> str:
    """The text of a generated module, with a comment below its first line if it breaks rules for whole files."""
    rules = sorted(set(_whole_file(text, module)))
    if not rules:
        return text
    first, rest = text.split("\n", 1)
    return f"{first}\n# ruff: noqa: {', '.join((*rules, _UNUSED))}\n{rest}"


def _whole_file(text: str, module: str) -> Iterator[str]:
    if not _MODULE.fullmatch(module):
        yield "N999"  # the module has the name of its IDSL module
    for node in ast.walk(parsed(text)) if "TypeAlias" in text or "_field" in text else ():
        match node:
            case ast.AnnAssign(target=ast.Name(id=name), annotation=ast.Name(id="TypeAlias")):
                yield "UP040"  # `type X = …` needs Python 3.12
                if _LOWER_ALIAS.match(name):
                    yield "PYI042"
            case ast.AnnAssign(value=ast.Call(func=ast.Name(id="_field"))):
                yield "RUF009"  # it is `dataclasses.field`, whose name is taken
            case _:
                pass
