"""Texts made from the grammars, and what becomes of them when they are damaged: never more than diagnostics.

`make fuzz` makes many more of them: `ROBOCOMP_FUZZ` is how many for each test.
"""

from __future__ import annotations

import os

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robocomp_py.dsl.diagnostics import Diagnostic
from robocomp_py.dsl.workspace import Workspace, read_file

from .sentences import texts
from .texts import FOLDER

MANY = int(os.environ.get("ROBOCOMP_FUZZ", "25"))
pytestmark = [pytest.mark.usefixtures("standard_folders_are_empty"), pytest.mark.timeout(120 + MANY)]

LANGUAGES = ("idsl", "cdsl", "pdsl", "ddsl", "smdsl")
"""Those that have a grammar."""

NOISE = [
    "",
    "\n",
    "\r",
    "\t",
    "\v",
    "// c\n",
    "/* } */",
    ";",
    "é",
    "\0",
    "\u2028",
    "\x85",
    "\ufeff",
    '"',
    "/*",
    "*/",
    "“",
]
NOISE += [
    "#endif\n",
    "#include <x>\n",
    "\n<<<<<<< a\n",
    "\n=======\n",
    "\n>>>>>>> b\n",
    "{" * 120,
    "9" * 50,
    "&",
    "= 0",
]

bounded = settings(max_examples=MANY, deadline=None, suppress_health_check=list(HealthCheck))


@st.composite
def damaged(draw: st.DrawFn, language: str) -> str:
    """A text in which something is left out, put twice, exchanged for noise, or for a part of another text."""
    text, other = draw(texts(language)), draw(texts(language))
    for _ in range(draw(st.integers(1, 6))):
        start, begin = draw(st.integers(0, len(text))), draw(st.integers(0, len(other)))
        end = start + draw(st.integers(0, 80))
        parts = [st.sampled_from(NOISE), st.text(max_size=4)]
        parts += [st.just(text[start:end] * 2), st.just(other[begin : begin + 60])]
        text = text[:start] + draw(st.one_of(parts)) + text[end:]
    return text


def check(language: str, data: bytes) -> list[Diagnostic]:
    """What is said of a file. All of it can be shown, stands within its file, and is said once."""
    path = FOLDER / f"fuzz.{language}"
    workspace = Workspace(read=lambda wanted: data if wanted == path else read_file(wanted), middlewares=["zeromq"])
    workspace.check(path)
    found = workspace.report.diagnostics
    for each in found:
        assert 0 <= each.span.start <= each.span.end <= len(each.span.source.text)
    assert len({each.render() for each in found}) == len(found)
    return found


@pytest.mark.parametrize("language", LANGUAGES)
@bounded
@given(data=st.data())
def test_the_syntax_of_what_a_grammar_makes_is_never_complained_about(language: str, data: st.DataObject) -> None:
    found = check(language, data.draw(texts(language)).encode())
    assert [each.render() for each in found if each.code in ("syntax", "trailing-text", "stray-directive")] == []


@pytest.mark.parametrize("language", LANGUAGES)
@bounded
@given(data=st.data())
def test_damage_to_what_a_grammar_makes_ends_in_diagnostics(language: str, data: st.DataObject) -> None:
    check(language, data.draw(damaged(language)).encode("utf-8", "surrogatepass"))


@pytest.mark.parametrize("language", LANGUAGES)
@bounded
@given(data=st.data())
def test_bytes_that_are_no_text_end_in_diagnostics(language: str, data: st.DataObject) -> None:
    text = data.draw(texts(language)).encode()
    at = data.draw(st.integers(0, len(text)))
    check(language, text[:at] + data.draw(st.binary(min_size=1, max_size=40)) + text[at:])
