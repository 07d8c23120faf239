"""The tables of a grammar: made by lark, and kept in the user's cache, as making them takes longer than their use.

What is kept names what it was made from. If anything of that is different, it is made anew.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import lark

from .lexer import Terminal


class Rule(NamedTuple):
    """What a rule makes: a branch of this name, out of so many words and branches."""

    size: int
    origin: str
    name: str
    kept: Sequence[tuple[int, bool]]
    """Which of them are kept, and whether only their children are."""


class Tables(NamedTuple):
    terminals: Sequence[Terminal]
    rules: Sequence[Rule]
    states: dict[int, dict[str, int]]
    """By state and kind of word: the next state, or `~n` for the n-th rule, which is complete."""
    start: int
    end: int


def read_tables(name: str) -> Tables:
    """The tables of a language. `name` is the package that holds its grammar.lark."""
    package = files(__package__ or "")
    grammar, common, ours = (
        package.joinpath(*path.split("/")).read_text(encoding="utf-8")
        for path in (f"{name}/grammar.lark", "common.lark", "tables.py")
    )
    made_from = (grammar, common, ours, lark.__version__)
    key = hashlib.sha256("\0".join(made_from).encode()).hexdigest()
    file = _cache() / f"{name}.json"
    with contextlib.suppress(OSError, ValueError, TypeError, KeyError):  # not there, or not as we write it
        kept = json.loads(_read(file))
        if kept["key"] == key:
            return _restored(kept)
    tables = _made(grammar, str(package))
    with contextlib.suppress(OSError):  # who has no cache waits a moment longer the next time
        _keep(file, json.dumps({"key": key, **tables._asdict()}))
    return tables


def _made(grammar: str, folder: str) -> Tables:
    parser = lark.Lark(
        grammar,
        parser="lalr",
        lexer="basic",  # unused, and the one that takes the least time to make
        maybe_placeholders=False,
        import_paths=[folder],
    )
    table = parser.parse_interactive("").parser_state.parse_conf
    number = {rule: at for at, rule in enumerate(parser.rules)}
    return Tables(
        [
            Terminal(each.name, each.pattern.value, each.pattern.type == "str", "i" in each.pattern.flags)
            for each in sorted(parser.terminals, key=lambda each: -each.priority)
        ],
        [_rule(rule) for rule in parser.rules],
        {
            state: {str(kind): ~number[to] if to in number else to for kind, (_, to) in row.items()}
            for state, row in table.states.items()
        },
        table.start_state,
        table.end_state,
    )


def _rule(rule: Any) -> Rule:
    origin = str(rule.origin.name)
    assert rule.expansion, f"the rule `{origin}` may be empty, so nobody could say where it stands"
    kept = [
        (at, not symbol.is_term and symbol.name.startswith("_"))
        for at, symbol in enumerate(rule.expansion)
        if rule.options.keep_all_tokens or not (symbol.is_term and symbol.filter_out)
    ]
    return Rule(len(rule.expansion), origin, str(rule.alias or origin), kept)


def _cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(base) / "robocomp_py" / "grammars"


def _restored(kept: dict[str, Any]) -> Tables:
    return Tables(
        [Terminal(*each) for each in kept["terminals"]],
        [Rule(*each) for each in kept["rules"]],
        {int(state): row for state, row in kept["states"].items()},
        kept["start"],
        kept["end"],
    )


def _read(file: Path) -> str:
    """What we kept; where others may write, too, theirs is none of ours."""
    with file.open(encoding="utf-8") as kept:
        if os.fstat(kept.fileno()).st_uid not in (os.geteuid(), 0):
            raise PermissionError(f"{file} is somebody else's")
        return kept.read()


def _keep(file: Path, text: str) -> None:
    """Write a file, so that nobody ever reads half of it."""
    if not file.is_absolute():  # nobody knows where home is
        return
    for folder in (file.parent.parent, file.parent):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    handle, beside = tempfile.mkstemp(dir=file.parent, prefix=file.name)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as into:
            into.write(text)
        os.replace(beside, file)
    except BaseException:  # Ctrl-C, too
        os.unlink(beside)
        raise
