"""What components print cannot hide, move or reorder what others read."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robocomp_py.deploy.harmless import harmless, plain
from robocomp_py.deploy.logs import Form, Logs
from robocomp_py.deploy.ring import Line


@pytest.mark.parametrize(
    ("text", "shown", "kept"),
    [
        ("10 %, ünïcödé ☃\tend", "10 %, ünïcödé ☃\tend", "10 %, ünïcödé ☃\tend"),
        ("\x1b[31mred\x1b[0m", "\x1b[31mred\x1b[0m", "red"),
        ("\x1b[1;31mleft open", "\x1b[1;31mleft open\x1b[0m", "left open"),
        ("\x1b[8mpassword", "password", "password"),
        ("\x1b[1;08;31mpassword\x1b[m", "\x1b[1;31mpassword\x1b[m", "password"),
        ("\x1b[38;5;8mgrey\x1b[48;2;8;8;8;8mtext\x1b[m", "\x1b[38;5;8mgrey\x1b[48;2;8;8;8mtext\x1b[m", "greytext"),
        ("\x1b]0;title\x07 \x1b[2J \x9b2J \x1bc", "]0;title [2J 2J c", "]0;title [2J 2J c"),
        ("rm \u202egpj.tac\u2066\u2029", "rm \\u202egpj.tac\\u2066\\u2029", "rm \\u202egpj.tac\\u2066\\u2029"),
    ],
)
def test_text_keeps_its_colours_on_a_terminal_and_loses_them_in_files(text: str, shown: str, kept: str) -> None:
    assert harmless(text) == shown
    assert plain(text) == kept


@pytest.mark.parametrize("form", Form)
def test_files_have_no_control_sequences(tmp_path: Path, form: Form) -> None:
    logs = Logs(tmp_path, form=form)
    logs.write(Line(0.0, "laser", "\x1b[8mhidden\x1b[0m \x1b]0;title\x07 \u202edrow"))
    logs.close()
    (line,) = (tmp_path / "laser.log").read_text().splitlines()
    told = json.loads(line)["text"] if form is Form.JSON else line.partition(" ")[2]
    assert told == "hidden ]0;title \\u202edrow"
