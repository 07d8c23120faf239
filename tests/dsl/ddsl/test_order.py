"""Who is started first."""

from __future__ import annotations

from pathlib import Path

from robocomp_py.dsl.ddsl.order import start_order
from robocomp_py.dsl.source import Name, Source

NOWHERE = Source(Path("net.ddsl"), "").span(0, 0)


def order(**waits_for: str) -> tuple[list[str], list[tuple[str, str]]]:
    found, closing = start_order(
        {who: [Name(each, NOWHERE) for each in names.split()] for who, names in waits_for.items()}
    )
    return found, [(who, str(name)) for who, name in closing]


def test_dependencies_come_first_and_the_rest_in_written_order() -> None:
    assert order(eye="arm", hand="arm", arm="", ear="") == (["arm", "eye", "hand", "ear"], [])
    assert order(a="b c", b="c", c="") == (["c", "b", "a"], [])


def test_an_unknown_dependency_is_not_waited_for() -> None:
    assert order(eye="nobody") == (["eye"], [])


def test_the_closing_step_of_each_cycle_is_reported() -> None:
    assert order(a="b", b="c", c="a")[1] == [("c", "a")]
    assert order(a="a", b="c", c="b", d="a")[1] == [("a", "a"), ("c", "b")]


def test_a_long_row_is_no_trouble() -> None:
    row = {f"n{number}": f"n{number + 1}" for number in range(5000)}
    found, closing = order(**row, n5000="n2500")
    assert (found[0], found[-1], closing) == ("n5000", "n0", [("n5000", "n2500")])
