"""Where the pictures of a component are drawn."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple, TypeVar

from ...threads import fulfil
from ..remote import Remote
from ..render import Picture, Renderer, View

T = TypeVar("T")

LONGEST = 60.0
"""How long a picture is waited for, s."""


class Shot(NamedTuple):
    """A picture, and when it was taken."""

    picture: Picture
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

    def do(self, job: Callable[[Renderer], T]) -> Future[T]:
        """Let a job draw, after those before it."""
        if self._pool:
            return self._pool.submit(job, self._renderer)
        done: Future[T] = Future()
        fulfil(done, lambda: job(self._renderer))
        return done

    def shot(self, view: View, camera: str, time: int) -> Shot:
        """The picture of a view. It is read-only, and drawn once, however often it is asked for.

        While the caller waits, handlers may run.
        """
        before = self._latest.get(camera)
        if before and before[0].is_like(view):
            return before[1]
        drawing = self.do(lambda renderer: renderer.picture(view, camera))
        with self._suspended():
            picture = drawing.result(LONGEST)
        for array in picture:
            array.flags.writeable = False
        self._latest[camera] = view, Shot(picture, time)
        return self._latest[camera][1]

    def close(self) -> None:
        """Wait for what is being drawn, and free OpenGL."""
        if self._pool:
            self._pool.shutdown(wait=True)
        if not self._is_lent:
            self._renderer.close()
