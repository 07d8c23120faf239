"""Shows look after look on the board of a monitor, while anything reads it."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable

from ...errors import RobocompError
from ...garbage import no_collection
from ...graph.netsvg import draw
from ..lookout import Look
from .server import Board
from .view import connections, form, picture, told

MANY = 100
"""From this number of components on, looks are at least 2 s apart."""

_IDLE_S = 0.5


def watch(board: Board, look: Callable[[], Look], every_s: float) -> None:
    """Until the board is closed. Errors are shown on it, and looking goes on."""
    drawn: Hashable = None
    last: dict[str, object] = {}
    while not board.is_closed:
        if not board.wait_reader(_IDLE_S):
            continue
        begun, pause_s = time.monotonic(), every_s
        try:
            found = look()
            with no_collection():
                arrows = connections(found)
                graph = picture(found, arrows)
                now = form(graph)
                last = told(found, graph, arrows)
                if drawn is None:
                    board.show(last)  # a large picture takes longer than the tables
                board.show(last, None if now == drawn else draw(graph))
            drawn = now
            pause_s = max(every_s, 2.0) if len(found.drift.instances) >= MANY else every_s
        except RobocompError as exc:
            board.show({**_NOTHING, **last, "troubles": [str(exc)]})
        board.rest(begun + pause_s - time.monotonic())


_NOTHING = {
    "name": "rc monitor",
    "at": 0,
    "summary": "",
    "texts": {},
    "strained": [],
    "components": [],
    "connections": [],
}
