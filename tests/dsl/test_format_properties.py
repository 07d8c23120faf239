"""Whatever the text: formatted, it means the same, its comments are all there, and it stays as it is."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from robocomp_py.dsl.cdsl.parser import parse as parse_cdsl
from robocomp_py.dsl.comments import find_comments
from robocomp_py.dsl.ddsl.parser import parse as parse_ddsl
from robocomp_py.dsl.diagnostics import DslError, Report
from robocomp_py.dsl.format import LANGUAGES, format_text
from robocomp_py.dsl.idsl.model import Operation
from robocomp_py.dsl.idsl.parser import parse as parse_idsl
from robocomp_py.dsl.pdsl.parser import parse as parse_pdsl
from robocomp_py.dsl.smdsl.parser import parse as parse_smdsl
from robocomp_py.dsl.source import Name, Source, Span

from .sentences import sentences, texts

PARSERS: dict[str, Callable[[Source, Report], object]] = {
    "idsl": parse_idsl,
    "cdsl": parse_cdsl,
    "pdsl": parse_pdsl,
    "ddsl": parse_ddsl,
    "smdsl": parse_smdsl,
}

often = settings(
    max_examples=75, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much]
)


def model_of(text: str, language: str) -> object:
    """What a text says and documents, without where."""
    report = Report()
    model = PARSERS[language](Source(Path("text"), text.removeprefix("\ufeff")), report)
    return _without_places(model), sorted(each.code for each in report.diagnostics if each.code != "stray-semicolon")


def _without_places(value: Any) -> object:
    match value:
        case Span() | Source():
            return None
        case Name():
            return value.text
        case Operation():
            bare = dataclasses.replace(value, text=re.sub(r"\s", "", value.text))
            return tuple(_without_places(getattr(bare, each.name)) for each in dataclasses.fields(bare))
        case tuple() | list():
            return tuple(map(_without_places, value))
    if dataclasses.is_dataclass(value):
        return type(value), *(_without_places(getattr(value, each.name)) for each in dataclasses.fields(value))
    return value


def comments_of(text: str) -> list[str]:
    """The comments, without what moves with their lines."""
    return [re.sub(r"\s*\n\s*", "\n", each.text).rstrip() for each in find_comments(Source(Path("text"), text)).spans]


def formatted(text: str, language: str) -> str:
    """The text formatted, if it is one of the language: a name may stand where it means a keyword."""
    try:
        return format_text(text, language)
    except DslError:
        assume(False)
        raise


@pytest.mark.parametrize("language", LANGUAGES)
@often
@given(data=st.data())
def test_formatting_changes_neither_the_meaning_nor_the_comments_and_is_done_once(
    language: str, data: st.DataObject
) -> None:
    text = data.draw(texts(language))
    result = formatted(text, language)
    assert model_of(result, language) == model_of(text, language)
    assert comments_of(result) == comments_of(text)
    assert format_text(result, language) == result
    assert not re.search(r"[ \t\r]\n|\n\n\n|\A\n|\n\n\Z|\A\ufeff|\n *\{\n\n|\n\n *\}", result)


@pytest.mark.parametrize("language", LANGUAGES)
@often
@given(data=st.data())
def test_the_same_words_always_look_the_same(language: str, data: st.DataObject) -> None:
    words = data.draw(sentences(language))
    assert formatted(" ".join(words), language) == formatted("\n".join(words), language)
