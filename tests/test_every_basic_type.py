"""Each place that must know every basic type is tried with all of them; a failure names the place and the types."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.codegen import expressions
from robocomp_py.contract.types import Dictionary, Field, Primitive, Sequence, Struct, is_key
from robocomp_py.dsl.idsl.check import BUILTIN
from robocomp_py.dsl.idsl.literals import literal_value
from robocomp_py.dsl.idsl.model import Literal
from robocomp_py.dsl.source import Source, Span
from robocomp_py.errors import CodecError
from robocomp_py.runtime import api
from robocomp_py.testing.components import zero
from robocomp_py.testing.everything import Scalars
from robocomp_py.transports.dds.types import BODY, CODEC, Message, publication_type
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.ice import Ice
from robocomp_py.wire.identity import Identity
from robocomp_py.wire.messagepack import MessagePack

from .codegen.exported import in_format

LANGUAGE = Path(__file__).parents[1] / "docs" / "reference" / "languages" / "idsl.md"
SAMPLES: dict[type[Any], Any] = {bool: True, int: 7, float: 1.5, str: "text"}
NUMBERED = {f"{sign}int{bits}" for sign in ("u", "") for bits in (8, 16, 32, 64)}
WORDS = {
    "omgidl": NUMBERED | {"boolean", "octet", "char", "float", "double", "string", "robocomp::Time"},
    "rosmsg": NUMBERED | {"bool", "byte", "char", "float32", "float64", "string", "builtin_interfaces/Time"},
}
"""What a member can be in other languages of interfaces, as far as we use it."""


class Pair:
    """A struct of two equal fields, as generated modules have them."""

    __slots__ = ("one", "other")

    def __init__(self, one: Any = None, other: Any = None) -> None:
        self.one, self.other = one, other

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Pair) and (self.one, self.other) == (other.one, other.other)

    __hash__ = None  # type: ignore[assignment]  # it can be changed


def message(kind: Primitive) -> tuple[Struct, tuple[Any, ...]]:
    """Whatever a type can be part of, and values for it."""
    value = SAMPLES[kind.python]
    pair = Struct("Basic::Pair", (Field("one", kind), Field("other", kind)), Pair)
    fields = [Field("plain", kind), Field("pair", pair), Field("pairs", Sequence(pair)), Field("many", Sequence(kind))]
    values = [value, Pair(value, kind.zero), [Pair(value, kind.zero)] * 40, [value] * 3]
    fields.append(Field("named", Dictionary(Primitive.STRING, kind)))
    values.append({"a": value})
    if is_key(kind):
        fields.append(Field("keyed", Dictionary(kind, Primitive.STRING)))
        values.append({value: "a"})
    return Struct("Basic::All", tuple(fields)), tuple(values)


def travels(codec: Any) -> Callable[[Primitive], bool]:
    def check(kind: Primitive) -> bool:
        kinds, values = message(kind)
        plain, pair, pairs, many, *rest = codec.decoder(kinds)(codec.encoder(kinds)(values))
        return [plain, pair, pairs, list(many), *rest] == list(values)

    return check


def is_refused(kind: Primitive) -> bool:
    kinds, (_, *others) = message(kind)
    with pytest.raises(CodecError, match="plain must be"):
        Cdr().encoder(kinds)((object(), *others))
    return True


def is_at_the_front_door(kind: Primitive) -> bool:
    return kind.name in api.__all__ and getattr(api, kind.name) is kind


def has_a_literal(kind: Primitive) -> bool:
    text = str(kind.zero).lower()
    span = Span(Source(Path("X.idsl"), text), 0, len(text))
    return BUILTIN[kind.value] is kind and literal_value(kind, Literal(text, span, kind.python is str)) == kind.zero


def is_generated(kind: Primitive) -> bool:
    value = eval(expressions.zero(kind, ""), {})
    return expressions.hint(kind, "") == type(value).__name__ and value == kind.zero == zero(kind)


def is_a_dds_type(kind: Primitive) -> bool:
    """Also whether the zeros that are sent in place of a message are those that the codec makes."""
    kinds, _ = message(kind)
    publication_type(f"Basic::{kind.name}Request", kinds)
    pair = Struct("Basic::Two", kinds.fields[1].type.fields)  # type: ignore[union-attr]  # it is a struct
    return Message(pair).sample(None)[BODY:] == CODEC.encoder(pair)((kind.zero, kind.zero))[BODY:]


def is_in_the_conformance_suite(kind: Primitive) -> bool:
    return kind in {field.type for field in Scalars.__contract__.fields}


def is_documented(kind: Primitive) -> bool:
    """Either by its own name or within a range of widths."""
    stem = kind.value.rstrip("0123456789")
    return any(text in LANGUAGE.read_text(encoding="utf-8") for text in (f"`{kind}`", f"`{stem}8` … `{stem}64`"))


PLACES: dict[str, Callable[[Primitive], bool]] = {
    "wire/cdr.py": travels(Cdr()),
    "wire/cdr.py with room for a header": travels(Cdr(room=40)),
    "wire/ice.py": travels(Ice()),
    "wire/messagepack.py, packing.py and plain.py": travels(MessagePack()),
    "wire/identity.py": travels(Identity()),
    "wire/values.py and explain.py": is_refused,
    "runtime/api.py": is_at_the_front_door,
    "dsl/idsl/literals.py": has_a_literal,
    "codegen/expressions.py": is_generated,
    "transports/dds/types.py": is_a_dds_type,
    "testing/everything.py": is_in_the_conformance_suite,
    "docs/reference/languages/idsl.md": is_documented,
}


@pytest.mark.parametrize("place", PLACES)
def test_every_basic_type_is_known(place: str) -> None:
    assert [str(kind) for kind in Primitive if not holds(PLACES[place], kind)] == []


def holds(check: Callable[[Primitive], bool], kind: Primitive) -> bool:
    """Whether a place knows a type; what it raises about one that it does not know is part of the answer."""
    try:
        return check(kind)
    except Exception as exc:
        pytest.fail(f"{kind}: {type(exc).__name__}: {exc}")


@pytest.mark.parametrize("language", WORDS)
@pytest.mark.parametrize("kind", Primitive)
def test_every_basic_type_has_a_word_in_other_languages(kind: Primitive, language: str, tmp_path: Path) -> None:
    idsl = f"module RoboCompX {{ struct S {{ {kind} a; }}; interface X {{ void f(S s); }}; }};"
    texts, _ = in_format(tmp_path, idsl, language)
    members = re.findall(r"^ *(\S+) a(?:;|$)", "\n".join(texts.values()), re.MULTILINE)
    assert members
    assert set(members) <= WORDS[language]
