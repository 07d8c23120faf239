"""Which lines of logs are shown."""

from __future__ import annotations

import time

import pytest

from robocomp_py.arguments import Parser
from robocomp_py.cli.logged import Wanted, add_filters, wanted


def choice(*arguments: str) -> Wanted:
    parser = Parser(prog="logs")
    add_filters(parser)
    return wanted(parser.parse_args(arguments))


def test_without_options_everything_is_shown() -> None:
    assert choice().everything
    assert choice()(0.0, "", "printed")


def test_a_level_leaves_out_lower_ones_and_what_was_printed() -> None:
    chosen = choice("--level", "Warning")
    assert [level for level in ("", "INFO", "WARNING", "error", "CRITICAL") if chosen(0.0, level, "")] == [
        *("WARNING", "error", "CRITICAL")
    ]


@pytest.mark.parametrize(("text", "seconds"), [("90", 90), ("30s", 30), ("1.5m", 90), ("2h", 7200), ("1d", 86400)])
def test_since_is_a_time_before_now(text: str, seconds: float) -> None:
    before = time.time()
    assert before <= choice("--since", text).since + seconds <= time.time()


def test_grep_looks_anywhere_in_a_text_of_several_lines() -> None:
    assert choice("--grep", "Value|Key")(0.0, "", "failed\nValueError: no")
    assert not choice("--grep", "^Value")(0.0, "", "failed\nValueError: no")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--level", "loud"), "--level: `loud` is no level; there are: debug, info, warning, error, critical"),
        (("--since", "10 minutes"), "--since: `10 minutes` is no time such as 30s, 10m, 2h or 1d"),
        (("--since", "1" * 400), "is no time such as"),
        (("--grep", "("), "--grep: `(` is no regular expression: missing )"),
    ],
)
def test_wrong_options_are_explained(arguments: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        choice(*arguments)
    assert says in capsys.readouterr().err
