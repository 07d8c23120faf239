"""When messages of a replay are due, and what keys do."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocomp_py.tools.recording.bag import Options
from robocomp_py.tools.recording.reader import Recording
from robocomp_py.tools.replay import ahead
from robocomp_py.tools.replay.ahead import Ahead, Upcoming
from robocomp_py.tools.replay.pace import FASTEST, SLOWEST, Pace
from robocomp_py.tools.replay.player import Player

from ..recording.recordings import filled

S = 10**9


def test_a_position_is_due_when_the_rate_says_so() -> None:
    pace = Pace(100 * S, 2.0)
    assert (pace.due(6 * S), pace.position(103 * S)) == (103 * S, 6 * S)


def test_a_pause_takes_no_position() -> None:
    pace = Pace(0)
    pace.toggle(2 * S)
    assert (pace.due(3 * S), pace.position(50 * S)) == (None, 2 * S)
    pace.toggle(50 * S)
    assert pace.due(3 * S) == 51 * S


def test_a_change_of_rate_moves_nothing() -> None:
    pace = Pace(0)
    pace.change_rate(2.0, 4 * S)
    assert (pace.position(4 * S), pace.due(8 * S)) == (4 * S, 6 * S)


@pytest.mark.parametrize(("factor", "end"), [(2.0, FASTEST), (0.5, SLOWEST)])
def test_keys_reach_no_extreme_rate(factor: float, end: float) -> None:
    pace = Pace(0)
    for _ in range(20):
        pace.change_rate(factor, 0)
    assert pace.rate == end
    pace.rate = end * factor * 10 if factor > 1 else end * factor / 10
    before = pace.rate
    pace.change_rate(factor, 0)
    assert pace.rate == before


class Script:
    """A clock, and keys pressed at given times."""

    def __init__(self, *keys: tuple[float, str]) -> None:
        self.now = 0
        self.keys = [(int(at * S), key) for at, key in keys]
        self.sent: list[tuple[float, str]] = []
        self.slow = 0

    def wait(self, seconds: float) -> str:
        end = self.now + int(seconds * S)
        if self.keys and self.keys[0][0] <= end:
            at, key = self.keys.pop(0)
            self.now = max(self.now, at)
            return key
        self.now = end
        return ""

    def send(self, topic: str, data: bytes) -> None:
        self.sent.append((self.now / S, topic))
        self.now += self.slow

    def played(self, positions: list[float]) -> Player:
        player = Player(Pace(0), self, self.send, lambda pace, now: None, lambda: self.now)
        player.play(Upcoming(int(at * S), str(at), b"") for at in positions)
        return player


def test_messages_are_sent_when_they_are_due() -> None:
    script = Script()
    player = script.played([0, 0.5, 2])
    assert script.sent == [(0, "0"), (0.5, "0.5"), (2, "2")]
    assert player.delays == (0, 0, 0, 0)


def test_keys_pause_step_and_change_the_rate() -> None:
    script = Script((1.1, " "), (5, "s"), (6, "s"), (7, " "), (8, "+"), (9, "?"))
    script.played([0, 1, 2, 3, 4, 8])
    assert script.sent == [(0, "0"), (1, "1"), (5, "2"), (6, "3"), (8, "4"), (10, "8")]


def test_a_step_pauses_a_running_replay() -> None:
    script = Script((0.2, "s"), (9, "s"))
    script.played([0, 1, 2])
    assert script.sent == [(0, "0"), (0.2, "1"), (9, "2")]


def test_a_replay_that_was_held_up_does_not_catch_up() -> None:
    script = Script()
    script.slow = 3 * S
    player = script.played([0, 1, 2])
    assert script.sent == [(0, "0"), (3, "1"), (6, "2")]
    assert player.delays.held_up == 4
    script = Script()
    script.slow = S // 2
    player = script.played([0, 0.2, 0.4])
    assert [at for at, _ in script.sent] == [0, 0.5, 1]
    assert (player.delays.longest, player.delays.held_up) == (0.6, 0)


def test_a_recording_is_read_ahead_and_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "MOST_MESSAGES", 2)
    with Recording(filled(tmp_path / "run", Options(), 4)) as recording:
        names = list(recording.topics)
        with Ahead(recording, names, start=S, end=None, is_loop=False) as messages:
            assert [each.position for each in messages] == [0, S, 2 * S]
        with Ahead(recording, names, start=0, end=2 * S, is_loop=True) as messages:
            assert [each.position for _, each in zip(range(5), messages, strict=False)] == [0, S, 2 * S, 3 * S, 4 * S]
