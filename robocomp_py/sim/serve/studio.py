"""Where the pictures of a component are drawn."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from enum import Flag, auto
from typing import NamedTuple, TypeVar

import numpy as np

from ...innermodel.pictures import Pixels
from ...threads import fulfil
from ..drawing import Depths
from ..remote import Remote
from ..render import Picture, Renderer, View

T = TypeVar("T")

LONGEST = 60.0
"""How long a picture is waited for, s."""

_KEPT = 8
"""How many publications after a call are kept for the next call. To keep one takes a tenth of the time of drawing."""


class Part(Flag):
    """The parts of a picture. Each takes time to draw."""

    COLOURS = auto()
    DEPTHS = auto()


class Shot(NamedTuple):
    """A picture, and when it was taken."""

    picture: Picture
    """Read-only. An array is empty if it was not asked for."""
    parts: Part
    time: int
    """ms on the clock of the component."""


class Studio:
    """Draws pictures. Both OpenGL and the thread start with the first one.

    By the clock of the machine, a thread of its own draws while the scene goes on. By any other clock, a picture is
    drawn at once by the thread that asks for it, so that it belongs to the same time in every run.
    """

    def __init__(
        self,
        suspended: Callable[[], AbstractContextManager[None]] | None,
        *,
        in_process: bool,
        remote: Remote | None = None,
    ) -> None:
        """`suspended` lets handlers run during a wait; None: pictures are drawn at once.

        With `in_process`, a process of its own draws, which a thread waits for: that of `remote`, which stays open when
        this is closed, or a new one.
        """
        self._is_lent = in_process and remote is not None
        self._renderer = Renderer((remote or Remote()) if in_process else None)
        self._suspended = suspended or nullcontext
        self._pool = ThreadPoolExecutor(1, "cameras") if suspended else None
        self._latest: dict[str, tuple[View, Shot]] = {}
        """By camera."""
        self._asked: dict[str, Part] = {}
        """By camera: the parts that calls have asked for, so that a client that asks in turn has one picture."""
        self._keeps: dict[str, int] = {}
        """By camera: how many of the next publications are kept for calls."""

    def do(self, job: Callable[[Renderer], T]) -> Future[T]:
        """Let a job draw, after those before it."""
        if self._pool:
            return self._pool.submit(job, self._renderer)
        done: Future[T] = Future()
        fulfil(done, lambda: job(self._renderer))
        return done

    def shot(self, view: View, camera: str, time: int, parts: Part) -> Shot:
        """The picture of a view. It is drawn once, however often it is asked for or published.

        While the caller waits, handlers may run.
        """
        self._keeps[camera] = _KEPT
        self._asked[camera] = wanted = parts | self._asked.get(camera, parts)
        if known := self._known(view, camera, parts):
            return known
        drawing = self.do(lambda renderer: self._drawn(renderer, view, camera, time, wanted))
        with self._suspended():
            return drawing.result(LONGEST)

    def wanted(self, camera: str) -> Part:
        """The parts that a call may ask for of the picture that is about to be published."""
        left = self._keeps.get(camera, 0)
        if not left:
            return Part(0)
        self._keeps[camera] = left - 1
        return self._asked[camera]

    def fill(
        self,
        renderer: Renderer,
        view: View,
        camera: str,
        time: int,
        *,
        colours: Pixels | None,
        depths: Depths | None,
        kept: Part,
    ) -> None:
        """Write the picture of a view to arrays, in the thread that draws. The parts in `kept` are kept for others."""
        parts = _parts(colours, depths)
        shot = self._known(view, camera, parts)
        if shot is None and kept:
            shot = self._drawn(renderer, view, camera, time, parts | kept)
        if shot is None:
            renderer.draw(view, camera, colours, depths)
            return
        if colours is not None:
            colours[:] = shot.picture.colours
        if depths is not None:
            depths[:] = shot.picture.depths

    def _known(self, view: View, camera: str, parts: Part) -> Shot | None:
        """The last picture, if it is that of a view and has all these parts."""
        before, shot = self._latest.get(camera, (None, None))
        return shot if before and shot and parts in shot.parts and before.is_like(view) else None

    def _drawn(self, renderer: Renderer, view: View, camera: str, time: int, parts: Part) -> Shot:
        """Draw the picture of a view, in the thread that draws, unless that happened while the caller waited."""
        if known := self._known(view, camera, parts):
            return known
        height, width = renderer.shape(view, camera)
        colours = np.empty((height, width, 3) if Part.COLOURS in parts else (0, 0, 3), np.uint8)
        depths = np.empty((height, width) if Part.DEPTHS in parts else (0, 0), np.float32)
        renderer.draw(view, camera, colours if colours.size else None, depths if depths.size else None)
        colours.flags.writeable = depths.flags.writeable = False
        shot = Shot(Picture(colours, depths), parts, time)
        self._latest[camera] = view, shot
        return shot

    def close(self) -> None:
        """Wait for what is being drawn, and free OpenGL."""
        if self._pool:
            self._pool.shutdown(wait=True)
        if not self._is_lent:
            self._renderer.close()


def _parts(colours: Pixels | None, depths: Depths | None) -> Part:
    return (Part(0) if colours is None else Part.COLOURS) | (Part(0) if depths is None else Part.DEPTHS)
