"""From a grammar to the tables of its parser: made by lark, or loaded from a file beside the grammar.

To make them takes much longer than to load them, and every process of ours that reads a file needs them. `make golden`
writes the file, which is plain data. It is used only with the grammar and the version of lark that it names.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import lark
from lark import Lark
from lark.grammar import Rule
from lark.lexer import PatternRE, TerminalDef

FOLDER = Path(__file__).parent
OF_MAKING = ("edit_terminals", "import_paths")
"""Options of lark that make tables; loaded ones do without."""


@dataclass(frozen=True, slots=True)
class Grammar:
    """The texts of one language's grammar: its own, the one it imports, and its tables, which may be out of date."""

    own: str
    shared: str
    tables: str

    @property
    def origin(self) -> dict[str, str]:
        """What tables of this grammar depend on."""
        return {"lark": lark.__version__, "grammar": sha256(f"{self.own}\0{self.shared}".encode()).hexdigest()}


@dataclass(frozen=True, slots=True)
class Tables:
    """What parses a language, and its keywords and marks by their kinds."""

    lark: Lark
    fixed: dict[str, str]


def tables_file(name: str) -> Path:
    return FOLDER / name / "tables.json"


def read_grammar(name: str) -> Grammar:
    """The grammar of the language in a folder of this package: its file, and for DDSL the rules of its clauses."""
    own = (FOLDER / name / "grammar.lark").read_text(encoding="utf-8")
    if name == "ddsl":
        from .ddsl.clauses import grammar_rules  # other languages do without the models of DDSL

        own += grammar_rules()
    shared = (FOLDER / "common.lark").read_text(encoding="utf-8")
    try:
        tables = tables_file(name).read_text(encoding="utf-8")
    except FileNotFoundError:
        tables = "{}"
    return Grammar(own, shared, tables)


def make(grammar: Grammar) -> Tables:
    """Have lark make the tables."""
    values: dict[str, str] = {}

    def edit(terminal: TerminalDef) -> TerminalDef:
        """Make keywords whole words with priority over names, but below a language's own kinds of words."""
        terminal.priority *= 2
        if terminal.pattern.type == "str":
            values[terminal.name] = terminal.pattern.value
            if terminal.pattern.value[0].isalpha():
                terminal.pattern = PatternRE(rf"{terminal.pattern.value}(?![A-Za-z0-9_])", terminal.pattern.flags)
                terminal.priority = 1
        return terminal

    made = Lark(
        grammar.own,
        parser="lalr",
        lexer="contextual",
        maybe_placeholders=False,
        propagate_positions=True,
        import_paths=[str(FOLDER)],
        edit_terminals=edit,
    )
    return Tables(made, {each.name: values[each.name] for each in made.terminals if each.name in values})


def load(grammar: Grammar) -> Tables | None:
    """The tables in the grammar's file, or None if that was made from another grammar or by another version of lark."""
    kept = json.loads(grammar.tables)
    if not kept.items() >= grammar.origin.items():
        return None
    data, states = kept["data"], {}
    for number, row in enumerate(kept["states"]):
        states[number] = {
            token: (0, action) if action >= 0 else (1, {"@": ~action})
            for token, action in zip(row[::2], row[1::2], strict=True)
        }
    data["parser"]["parser"] |= {"tokens": dict(enumerate(kept["tokens"])), "states": states}
    return Tables(Lark.load({"data": data, "memo": dict(enumerate(kept["memo"]))}), kept["fixed"])


def text_of(grammar: Grammar, made: Tables) -> str:
    """The text of the file that `load` reads. The same grammar gives the same text, though lark numbers states at will.

    In a row of `states`, each word is followed by an action: the next state, or below zero the complement of a rule.
    """
    data, memo = made.lark.memo_serialize([TerminalDef, Rule])
    data["options"] = {key: value for key, value in data["options"].items() if key not in OF_MAKING}
    parser = data["parser"]["parser"]
    tokens = sorted(parser.pop("tokens").items(), key=lambda item: str(item[1]))
    places = {old: new for new, (old, _) in enumerate(tokens)}
    rows = {
        state: sorted((places[token], *action) for token, action in actions.items())
        for state, actions in parser.pop("states").items()
    }
    numbers = _numbered(parser["start_states"].values(), rows)
    for key in ("start_states", "end_states"):
        parser[key] = {start: numbers[state] for start, state in parser[key].items()}
    kept = {
        **grammar.origin,
        "fixed": made.fixed,
        "tokens": [token for _, token in tokens],
        "states": [
            [part for token, kind, to in rows[state] for part in (token, ~to["@"] if kind else numbers[to])]
            for state in numbers
        ],
        "memo": [memo[number] for number in range(len(memo))],
        "data": data,
    }
    return "{" + ",\n".join(f"{_dense(key)}:{_lines(value)}" for key, value in kept.items()) + "}\n"


def _numbered(starts: Iterable[int], rows: Mapping[int, list[tuple[int, int, Any]]]) -> dict[int, int]:
    """New numbers for all states, in the order in which they are reached."""
    numbers: dict[int, int] = {}
    waiting = list(starts)
    for state in waiting:  # which grows meanwhile
        if state not in numbers:
            numbers[state] = len(numbers)
            waiting += [to for _, kind, to in rows[state] if not kind]
    return numbers


def _lines(value: object) -> str:
    """Lists have a line for each element, so that a search through files does not print all of them."""
    return "[\n" + ",\n".join(map(_dense, value)) + "\n]" if isinstance(value, list) else _dense(value)


def _dense(value: object) -> str:
    return json.dumps(value, separators=(",", ":"))
