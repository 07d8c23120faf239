"""How far a command is: on a terminal only, and only if it takes long."""

from __future__ import annotations

import io
from itertools import count

import pytest

from robocomp_py.cli.progress import Progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def shown(to: io.StringIO, seconds: float) -> list[str]:
    """What is written while five items take so many seconds each."""
    times = count()
    with Progress("rcgen", to, lambda: next(times) * seconds) as progress:
        assert list(progress.over("abcde", "components read")) == list("abcde")
    return to.getvalue().split("\r\x1b[K")[1:]


def test_progress_is_shown_from_one_second_on_and_erased_at_the_end() -> None:
    assert shown(Terminal(), 0.4) == ["rcgen: components read: 2 of 5", "rcgen: components read: 3 of 5",
                                      "rcgen: components read: 4 of 5", ""]  # fmt: skip


def test_a_quick_command_shows_no_progress() -> None:
    assert shown(Terminal(), 0.15) == []


def test_a_line_is_cut_at_the_width_of_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "20")
    assert shown(Terminal(), 2.0)[0] == "rcgen: components r"


def test_updates_are_limited_to_a_readable_rate() -> None:
    assert len(shown(Terminal(), 1.0)) == 6
    times = iter([0.0, *(1 + n / 1000 for n in range(5))])
    to = Terminal()
    with Progress("rcgen", to, lambda: next(times)) as progress:
        assert len(list(progress.over("abcde", "components read"))) == 5
    assert to.getvalue() == "\r\x1b[Krcgen: components read: 0 of 5\r\x1b[K"


def test_no_progress_is_shown_outside_a_terminal() -> None:
    assert shown(io.StringIO(), 10.0) == []


def test_an_error_erases_the_line_first() -> None:
    to, times = Terminal(), count()
    try:
        with Progress("rcgen", to, lambda: next(times)) as progress:
            progress.show("writing")
            raise KeyError
    except KeyError:
        assert to.getvalue() == "\r\x1b[Krcgen: writing\r\x1b[K"
