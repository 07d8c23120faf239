"""Texts of a language as its grammar makes them, written in unusual ways: for properties of every text."""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files
from itertools import count

from hypothesis import strategies as st
from lark import Lark
from lark.grammar import NonTerminal, Rule, Symbol

from robocomp_py.dsl.tables import read_grammar

WORDS = {
    "NAME": ["a", "Laser", "x_1", "qos", "A" * 40],
    "STRING": ['""', '"x.idsl"', '"a\tb // {;,"'],
    "INT": ["0", "-1", "0x1F"],
    "NUMBER": ["0", "-1.5", "1e3"],
    "LANGUAGE": ["python", "Cpp11"],
    "ADDRESS": ["::1", "10.0.0.1"],
    "WHOLE": ["left/arm", "/arm", "/a/b/c"],
}
"""Of each kind of word that is no keyword, some."""

SPACES = ("", "  ", "\t", "\n", "\n\n", "\n \n\n    ")
COMMENTS = ("// {}\n", "//{}  \n", "/* {} */", "/*{}*/", "/* {}\n   more */", "/** {}\n\t* more\n\n  */")
GAPS = [" ", *SPACES, *(f"{before}{comment}{behind}" for before in SPACES for comment in COMMENTS for behind in SPACES)]
GAPS += [f"{one}{space}{other}" for one in COMMENTS for space in ("", "\n", "\n\n") for other in COMMENTS]
"""What may stand between two words."""

_MOST_STEPS = 80
"""After so many, a sentence is brought to its end as fast as possible."""


@cache
def lark_of(language: str) -> Lark:
    dsl = files("robocomp_py.dsl")
    return Lark(read_grammar(language).own, parser="lalr", maybe_placeholders=False, import_paths=[str(dsl)])


@st.composite
def sentences(draw: st.DrawFn, language: str) -> list[str]:
    """The words of a text that the grammar allows."""
    found = list[str]()
    waiting: list[Symbol] = [NonTerminal("start")]
    steps = 0
    while waiting:
        symbol = waiting.pop()
        steps += 1
        if symbol.is_term:
            found.append(draw(_words(language, symbol.name)))
            continue
        rules = _expansions(language)[symbol]
        rule = rules[0] if steps > _MOST_STEPS else draw(st.sampled_from(rules))
        waiting += reversed(rule.expansion)
    return found


@st.composite
def texts(draw: st.DrawFn, language: str) -> str:
    """A sentence, with spaces, comments, and semicolons that end nothing, anywhere."""
    number = count()

    def gap() -> str:
        chosen = draw(st.integers(0, 2 * len(GAPS)))
        return re.sub("{}", lambda _: f"c{next(number)}", GAPS[chosen] if chosen < len(GAPS) else " ")

    text = ""
    for word in draw(sentences(language)):
        between = gap()
        if text.endswith("/") and between.startswith("/"):
            text += " "  # or the comment would begin one character sooner
        text += between or ("" if _stand_alone(text[-1:], word[0]) else " ")
        text += word
        if word in (";", "{") and draw(st.integers(0, 9)) == 0:
            text += gap() + ";"
    text += gap()
    return draw(st.sampled_from(["", "\ufeff"])) + (text.replace("\n", "\r\n") if draw(st.booleans()) else text)


def _words(language: str, terminal: str) -> st.SearchStrategy[str]:
    pattern = next(each.pattern for each in lark_of(language).terminals if each.name == terminal)
    word = pattern.value
    if pattern.type == "re":  # PDSL's keyword `int` is an `INT` for lark, too
        return st.sampled_from(WORDS[terminal])
    return st.sampled_from([word, word, word.lower(), word.upper()]) if "i" in pattern.flags else st.just(word)


@cache
def _expansions(language: str) -> dict[NonTerminal, list[Rule]]:
    """What each symbol can become, the shortest first."""
    rules = lark_of(language).rules
    heights: dict[Symbol, int] = {}
    for _ in rules:
        for rule in rules:
            below = [0 if each.is_term else heights.get(each, len(rules)) for each in rule.expansion]
            heights[rule.origin] = min(heights.get(rule.origin, len(rules)), 1 + max(below, default=0))
    found: dict[NonTerminal, list[Rule]] = {}
    for rule in sorted(rules, key=lambda each: sum(0 if s.is_term else heights[s] for s in each.expansion)):
        found.setdefault(rule.origin, []).append(rule)
    return found


def _stand_alone(before: str, after: str) -> bool:
    """Whether two words can do without a space between them."""
    return not before or before in "{}()<>,;=" or after in "{}()<>,;="
