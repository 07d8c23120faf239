"""How generated lines are laid out."""

from __future__ import annotations

import pytest

from robocomp_py.codegen.layout import docstring

LONG = "Go to a place: its name, which may be empty, its x and y on the floor in mm, and where"


def test_a_sentence_that_is_too_long_for_a_line_runs_on_into_the_next() -> None:
    assert docstring(f"{LONG}\nto look there in rad.\n\nIDSL: void go()", 8) == (
        '"""Go to a place: its name, which may be empty, its x and y on the floor in mm,\n'
        "        and where to look there in rad.\n"
        "\n"
        "        IDSL: void go()\n"
        '        """'
    )


@pytest.mark.parametrize("item", ["- to look there", "speed: in rad/s", "1) turn", "2. turn", "Return nothing"])
def test_an_item_of_a_list_keeps_a_line_of_its_own(item: str) -> None:
    assert f"\n        and where\n        {item}\n" in docstring(f"{LONG}\n{item}", 8)


def test_lines_that_fit_stay_as_they_are() -> None:
    assert docstring("One line,\nand another.", 8) == '"""One line,\n        and another.\n        """'
