"""The checker finds each kind of violation, and none where there is none."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from .checker import Allowed, check, check_commands
from .history import Asked, Counted, Ended, Event, Executed, Heard, Journal, Left, Published, events, read
from .nemesis import deeds

FINE: tuple[Event, ...] = (
    Asked("c-1", "query", 1.0, 10.0),
    Executed("c-1", "s", 10.1),
    Ended("c-1", "ok", 10.2, "s"),
    Asked("c-2", "idempotent", 1.0, 11.0),
    Executed("c-2", "s", 11.1),
    Executed("c-2", "t", 11.4),
    Ended("c-2", "ok", 11.5, "t"),
    Asked("c-3", "query", 0.1, 12.0),
    Ended("c-3", "expired", 12.1),
    Asked("c-4", "command", 1.0, 13.0),
    Ended("c-4", "ok", 13.0),
    Published("p", 1),
    Published("p", 2),
    Published("p", 3),
    Heard("h", "p", 1),
    Heard("h", "p", 3),
    Counted("h", 1),
)


def broken(history: Sequence[Event], allowed: Allowed = Allowed()) -> list[str]:  # noqa: B008 - frozen
    return [violation.rule for violation in check(history, allowed)]


def test_a_history_that_keeps_all_promises_has_no_violation() -> None:
    assert broken(FINE) == []


@pytest.mark.parametrize(
    ("also", "rule"),
    [
        ([Executed("c-1", "s", 10.3)], "once"),
        ([Executed("c-1", "another life", 10.3)], "once"),
        ([Executed("c-2", "s", 11.2)], "once"),
        ([Executed("c-4", "s", 13.1), Executed("c-4", "s", 13.2)], "once"),
        ([Executed("nobody's", "s", 1.0)], "once"),
        ([Asked("c-5", "query", 1.0, 14.0), Ended("c-5", "ok", 14.1, "s")], "ok"),
        ([Asked("c-5", "query", 1.0, 14.0), Executed("c-5", "s", 14.1), Ended("c-5", "ok", 14.2, "t")], "ok"),
        ([Executed("c-3", "s", 12.1)], "expired"),
        ([Asked("c-5", "query", 1.0, 14.0), Executed("c-5", "s", 15.2), Ended("c-5", "Timeout", 15.0)], "late"),
        ([Asked("c-5", "query", 1.0, 14.0)], "one end"),
        ([Ended("c-1", "Timeout", 10.3)], "one end"),
        ([Ended("c-5", "Timeout", 10.3)], "one end"),
        ([Heard("h", "p", 3)], "order"),
        ([Heard("h", "p", 2)], "order"),
        ([Heard("h", "p", 4)], "order"),
        ([Counted("h", 2)], "losses"),
        ([Counted("h", 0)], "losses"),
        ([Left(7, "python")], "nobody left"),
    ],
)
def test_each_broken_promise_is_found(also: list[Event], rule: str) -> None:
    assert rule in broken((*FINE, *also))


def test_calls_of_a_killed_client_need_not_have_ended() -> None:
    history = (*FINE, Asked("dead-1", "query", 1.0, 14.0))
    assert broken(history) == ["one end"]
    assert broken(history, Allowed(killed=frozenset({"dead-"}))) == []


def test_a_fault_may_keep_a_request_on_its_way() -> None:
    late = (Asked("c-5", "query", 1.0, 14.0), Executed("c-5", "s", 16.0), Ended("c-5", "Timeout", 15.0))
    assert broken((*FINE, *late)) == ["late"]
    assert broken((*FINE, *late), Allowed(late=1.5)) == []


def commands(executed: int, lost: int, failed: int = 0) -> list[Event]:
    """Ten that were sent well, and some that were not."""
    sent: list[Event] = []
    for number in range(10 + failed):
        sent += [
            Asked(f"c-{number}", "command", 1.0, 0.0),
            Ended(f"c-{number}", "ok" if number < 10 else "Timeout", 0.1),
        ]
    return [*sent, *(Executed(f"c-{number}", "s", 0.2) for number in range(executed)), Counted("s", lost)]


def test_commands_are_executed_or_counted_as_lost() -> None:
    assert check_commands(commands(executed=10, lost=0), "s") == []
    assert check_commands(commands(executed=8, lost=2), "s") == []
    assert check_commands(commands(executed=8, lost=3, failed=1), "s") == []
    assert check_commands(commands(executed=8, lost=1), "s") != []
    assert check_commands(commands(executed=8, lost=3), "s") != []
    assert check_commands(commands(executed=10, lost=0)[:-1], "s") != []


def test_what_was_written_is_read_again_but_for_half_a_line(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "a.events")
    for event in FINE:
        journal.note(event)
    journal.close()
    assert read(tmp_path) == list(FINE)
    written = (tmp_path / "a.events").read_bytes()
    assert list(events(written[:-5])) == list(FINE[:-1])


def test_the_same_seed_gives_the_same_plan() -> None:
    def plan(seed: int) -> list[tuple[float, str]]:
        return list(deeds(seed, 20, ["kill", "stop"], 0.1, 0.2))

    assert plan(7) == plan(7)
    assert plan(7) != plan(8)
    assert all(0.1 <= after <= 0.2 for after, _ in plan(7))
