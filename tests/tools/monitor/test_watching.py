"""Looks are shown while something reads, and what goes wrong is shown, too."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from robocomp_py.errors import TransportError
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.flows import Flow
from robocomp_py.tools.lookout import Look
from robocomp_py.tools.monitor.server import Board, Shown
from robocomp_py.tools.monitor.watching import watch

from ..facts import THERE
from .test_view import ALL
from .test_view import look as look_at


@contextmanager
def watched(look: Callable[[], Look]) -> Iterator[Board]:
    board = Board()
    thread = threading.Thread(target=watch, args=(board, look, 0.01))
    thread.start()
    try:
        yield board
    finally:
        board.close()
        thread.join(SOON)
        assert not thread.is_alive()


def shown(board: Board, is_it: Callable[[Shown], bool]) -> Shown:
    """What is shown, once it is this."""
    found = [Shown()]

    def comes() -> bool:
        newer = board.newer(found[-1].number, 0.1)
        found.extend([newer] if newer else [])
        return newer is not None and is_it(newer)

    wait_until(comes)
    return found[-1]


def test_nothing_is_asked_while_nothing_reads() -> None:
    looks: list[int] = []

    def look() -> Look:
        looks.append(1)
        return look_at(*ALL)

    with watched(look) as board:
        assert board.newer(0, 0.2) is None
        assert not looks
        assert board.enter()
        wait_until(lambda: len(looks) > 2)


def test_the_picture_changes_only_with_its_form() -> None:
    now = [look_at(*ALL, flow=Flow(1.0))]
    with watched(lambda: now[0]) as board:
        assert board.enter()
        first = shown(board, lambda it: it.picture_number > 0 and it.look["texts"].get("edge-0-0") == "1.0/s")
        now[0] = look_at(*ALL, flow=Flow(2.0, is_strained=True))
        second = shown(board, lambda it: it.look["texts"].get("edge-0-0") == "2.0/s")
        assert second.picture_number == first.picture_number
        assert "edge-0" in second.look["strained"]
        now[0] = look_at(*THERE[:2])
        third = shown(board, lambda it: "2 connections missing" in it.look["summary"])
        assert third.picture_number > second.picture_number
        assert 'class="missing"' in third.picture


def test_what_goes_wrong_is_shown_and_looking_goes_on() -> None:
    fails = [True]

    def look() -> Look:
        if fails:
            raise TransportError("zeromq: no room")
        return look_at(*ALL)

    with watched(look) as board:
        assert board.enter()
        assert shown(board, lambda it: bool(it.look["troubles"])).look["troubles"] == ["zeromq: no room"]
        fails.clear()
        found = shown(board, lambda it: not it.look["troubles"])
        assert [each["name"] for each in found.look["components"]] == ["world", "hand", "eye"]
        fails.append(True)
        found = shown(board, lambda it: bool(it.look["troubles"]))
        assert len(found.look["components"]) == 3
