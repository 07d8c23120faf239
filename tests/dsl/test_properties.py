"""Whatever the text: a model or diagnostics."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocomp_py.dsl.workspace import ENDINGS, SHIPPED, Workspace, read_file

from .texts import FOLDER

COMMON = [
    "{",
    "}",
    "};",
    ";",
    ";;",
    ",",
    "<",
    ">",
    "(",
    ")",
    "[",
    "]",
    ":",
    "::",
    "=",
    '"',
    '"x"',
    "//",
    "/*",
    "*/",
    "#",
]
COMMON += [
    "\n",
    "\r\n",
    "\0",
    "\ufeff",
    "é",
    "\u2028",
    "a",
    "A",
    "_",
    "__x",
    "self",
    "import",
    "0",
    "-1",
    "1e999",
    "007",
    "0x1F",
]
COMMON += ["9" * 30, "9" * 50, "1.5", "ms"]
WORDS = {
    ".idsl": "module struct enum exception extends dictionary sequence const interface idempotent out throws query"
    " records command publish int float string bool byte void time Laser TData",
    ".cdsl": "Component Communications requires implements publishes subscribesTo Laser LaserPub qos depth keep_last"
    " deadline reliable language python gui Qt options statemachine params period timer s worker concurrent",
    ".pdsl": "ComponentParams List int float double string bool true enum mandatory T",
    ".ddsl": "Deployment Component path ip port config dependences middleware namespace env args requires from host"
    " System restart ::1 10.0.0.1 process qos publishes ( ) depth 5 existing notifies",
    ".smdsl": "game states initial_state end_state transitions transition parallel => : begin loop over",
}
MODELS = {
    ".idsl": [path.read_text() for path in sorted(SHIPPED.glob("*.idsl"))],
    ".cdsl": [
        'import "Laser.idsl"; import "LaserPub.idsl"; Component a { Communications { requires Laser, Laser(zeromq);'
        " publishes LaserPub qos(sensor_data, depth 1, deadline 5 ms); implements Laser concurrent; };"
        ' language python; gui Qt(QWidget); options dsr; statemachine "a.smdsl" visual; period 50 ms;'
        " timer poll 1 s; };"
    ],
    ".pdsl": [
        'import "b.pdsl"; ComponentParams a { device "where" string "" T; n int 16 0:1000 mandatory; x float 1 0:10;'
        " mode enum a { a, b }; on bool true; List motors [1:3] { id int 0; List gains { p double 1; }; }; };"
    ],
    ".ddsl": [
        'import "a.cdsl"; Deployment net { middleware zeromq; namespace a/b; Component x : a { path "x"; ip ::1;'
        ' port 5; config "c"; dependences y, z; env A "b"; args "c", "d"; requires Laser from y;'
        " process p; qos LaserPub(reliable, depth 3,); qos publishes X(deadline 0.5 s, liveliness automatic);"
        ' host h { user "r"; }; }; };'
    ],
    ".smdsl": [
        "game { initial_state begin; states loop, pause; end_state over; transitions { begin => loop; loop => loop,"
        " pause, over; pause => loop; }; }; :loop parallel { states left, right; transitions { left => left; }; };"
        " :left { initial_state up; states down; transition { up => down; down => up; } }"
    ],
}

usual = settings(max_examples=25)  # `make fuzz` tries thousands


def lint(ending: str, text: str) -> None:
    """Check a text; whatever is said of it can be shown."""
    path = FOLDER / f"Arm{ending}"

    def read(wanted: Path) -> bytes:
        return text.encode("utf-8", "surrogatepass") if wanted == path else read_file(wanted)

    workspace = Workspace(read=read)
    workspace.check(path)
    told = [each.render() for each in workspace.report.diagnostics]
    assert len(told) == len(set(told)), "one mistake, told twice"
    for each in workspace.report.diagnostics:
        assert each.render().startswith(str(each.span.source.path))
        assert each.to_json()["line"] >= 1
        assert each.message[:1].islower() or not each.message[:1].isalpha()
        assert not each.message.endswith(".")
    if ending == ".idsl" and not workspace.report.errors:
        assert workspace.interfaces(path) is not None


@pytest.mark.parametrize("ending", ENDINGS)
@usual
@given(data=st.data())
def test_any_text_is_understood_or_complained_about(ending: str, data: st.DataObject) -> None:
    lint(ending, data.draw(st.text(max_size=300)))


@pytest.mark.parametrize("ending", ENDINGS)
@usual
@given(data=st.data())
def test_any_words_of_the_language_are_understood_or_complained_about(ending: str, data: st.DataObject) -> None:
    words = st.sampled_from([*COMMON, *WORDS[ending].split()])
    lint(ending, data.draw(st.sampled_from(["", " "])).join(data.draw(st.lists(words, max_size=60))))


@pytest.mark.parametrize("ending", ENDINGS)
@usual
@given(data=st.data())
def test_any_damage_to_a_file_is_survived(ending: str, data: st.DataObject) -> None:
    text = data.draw(st.sampled_from(MODELS[ending]))
    words = st.sampled_from([*COMMON, *WORDS[ending].split()])
    for _ in range(data.draw(st.integers(1, 5))):
        at = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(at, min(len(text), at + 40)))
        text = text[:at] + data.draw(st.one_of(st.just(""), words, st.text(max_size=3))) + text[end:]
    lint(ending, text)


@pytest.mark.parametrize("ending", ENDINGS)
def test_every_beginning_of_a_file_is_survived(ending: str) -> None:
    """A text ends before a word or sign, or after the first letter of a word: longer parts of a word are words, too."""
    text = max(MODELS[ending], key=len)[:400]
    for each in re.finditer(r"\w+|\s+|[^\w\s]", text):
        lint(ending, text[: each.start()])
        if len(each[0]) > 1 and not each[0].isspace():
            lint(ending, text[: each.start() + 1])
