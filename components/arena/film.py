"""A film of what happened in a scene, as an animated GIF."""

from __future__ import annotations

from collections import deque
from pathlib import Path

from robocomp_py.sim.render import Renderer, View
from robocomp_py.sim.world import World

EVERY_S = 0.5
"""Simulated time between two pictures."""

SHOWN_S = 0.08
"""How long a picture is shown."""

MOST = 200
"""Pictures of a film: of a longer run, it shows the end."""


class Film:
    """Moments of a scene. They are small; pictures are drawn only at the end."""

    def __init__(self) -> None:
        self._views: deque[View] = deque(maxlen=MOST)
        self._next_s = 0.0

    def note(self, world: World) -> None:
        """Keep the present moment, if the next picture is due."""
        if world.time >= self._next_s:
            self._views.append(world.view())
            self._next_s = world.time + EVERY_S

    def draw(self, camera: str, path: Path) -> None:
        """Write what a camera has seen. Raises ConfigurationError without OpenGL."""
        from PIL import Image

        with Renderer() as renderer:
            pictures = [
                Image.fromarray(renderer.picture(view, camera).colours)
                for view in self._views
            ]
        palette = pictures[0].quantize(64)
        first, *others = (
            each.quantize(palette=palette, dither=Image.Dither.NONE)
            for each in pictures
        )
        first.save(
            path,
            save_all=True,
            append_images=others,
            duration=round(SHOWN_S * 1000),
            loop=0,
        )
