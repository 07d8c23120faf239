"""Pictures of a scene, with the depth of every pixel. No screen is needed.

with Renderer() as renderer:
    colours, depths = renderer.picture(world.view(), "eye")
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import mujoco
import numpy as np

from ..closing import Closing
from ..innermodel.axes import Array
from ..innermodel.camera import Lens
from ..innermodel.pictures import Pixels
from ..innermodel.read import InnerModelError
from ..spelling import unknown
from .build import Scene, build
from .drawing import Depths, Disturbance, Easel, Order
from .looks import lens_of


class Picture(NamedTuple):
    colours: Pixels
    depths: Depths


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The state of a world, as far as pictures depend on it. It does not change when the world goes on."""

    scene: Scene
    positions: Array
    """The vector of positions of the scene."""
    seed: int
    ticks: int
    noise: Mapping[str, float]
    """Standard deviations of factors on depths, by camera."""
    shown: Mapping[str, Pixels]
    """What displays show, by their ids."""

    def is_like(self, other: View) -> bool:
        """Whether the pictures of both are the same."""
        return (
            self.scene is other.scene
            and (self.seed, self.ticks, self.noise) == (other.seed, other.ticks, other.noise)
            and np.array_equal(self.positions, other.positions)
            and self.shown.keys() == other.shown.keys()
            and all(pixels is other.shown[name] for name, pixels in self.shown.items())
        )


class Artist(Protocol):
    """Draws a model, wherever it does so."""

    def load(self, model: mujoco.MjModel) -> None:
        """Draw this model from now on. Raises ConfigurationError if OpenGL cannot be used."""

    def draw(self, order: Order, colours: Pixels | None, depths: Depths | None) -> None:
        """Draw into arrays of the size of the order. What is None is left out, which takes less time."""

    def close(self) -> None:
        """Free what OpenGL has. Idempotent; `load` begins anew."""


class Renderer(Closing):
    """Draws views of a world. One thread uses it at a time.

    OpenGL starts with the first picture. The model that is drawn is made anew when the structure of the world, or the
    size of what a display shows, has changed.
    """

    def __init__(self, artist: Artist | None = None) -> None:
        """By default, the thread that asks for a picture draws it; see `remote.Remote` about a process that does."""
        self._artist = artist or _Here()
        self._stage: _Stage | None = None

    def picture(self, view: View, camera: str, colours: Pixels | None = None, depths: Depths | None = None) -> Picture:
        """What a camera sees, and how far it is. Written to the given arrays, or to new ones.

        Raises InnerModelError if there is no such camera, ConfigurationError if OpenGL cannot be used, and what the
        artist raises.
        """
        shape = self.shape(view, camera)
        if colours is None:
            colours = np.empty((*shape, 3), np.uint8)
        if depths is None:
            depths = np.empty(shape, np.float32)
        self.draw(view, camera, colours, depths)
        return Picture(colours, depths)

    def draw(self, view: View, camera: str, colours: Pixels | None, depths: Depths | None) -> None:
        """Write what a camera sees to arrays. What is None is left out, which takes less time.

        Raises what `picture` raises.
        """
        order = self._staged(view).order(view, camera)
        try:
            self._artist.draw(order, colours, depths)
        except BaseException:  # Ctrl-C, too: what it has drawn so far, and of which textures, is not known
            self.close()
            raise

    def shape(self, view: View, camera: str) -> tuple[int, int]:
        """Height and width of what a camera sees. Raises what `picture` raises."""
        lens = self._staged(view).lens(camera)
        return round(lens.height), round(lens.width)

    def _staged(self, view: View) -> _Stage:
        """The stage of a view, which the artist draws."""
        stage = self._stage
        if stage is None or not stage.fits(view):
            self._stage = None
            stage = _Stage(view)
            self._artist.load(stage.model)
            self._stage = stage
        return stage

    def close(self) -> None:
        """Free what OpenGL has. Idempotent; a later picture begins anew."""
        self._stage = None
        self._artist.close()


class _Here:
    """The artist that draws in the thread that asks."""

    def __init__(self) -> None:
        self._easel: Easel | None = None

    def load(self, model: mujoco.MjModel) -> None:
        self.close()
        self._easel = Easel(model)

    def draw(self, order: Order, colours: Pixels | None, depths: Depths | None) -> None:
        assert self._easel
        self._easel.draw(order, colours, depths)

    def close(self) -> None:
        if self._easel:
            self._easel.close()
            self._easel = None


class _Stage:
    """The model that is drawn of a scene, and what its displays showed last."""

    def __init__(self, view: View) -> None:
        self._scene = view.scene
        # The world has no meshes that are missing, or leaves them out.
        self._drawn = build(view.scene.tree, 0.005, without_meshes=True, shown=view.shown)
        self._shown = dict(view.shown)
        self._lenses = {name: lens_of(view.scene.tree.node(name)) for name in self._drawn.cameras}

    @property
    def model(self) -> mujoco.MjModel:
        return self._drawn.model

    def fits(self, view: View) -> bool:
        """Whether it has what a view has, and displays of that size."""
        sizes, drawn = ({name: pixels.shape for name, pixels in each.items()} for each in (view.shown, self._shown))
        return view.scene is self._scene and sizes == drawn

    def lens(self, camera: str) -> Lens:
        """Raises InnerModelError if there is no such camera."""
        if camera not in self._drawn.cameras:
            raise InnerModelError(unknown("camera", camera, self._drawn.cameras))
        return self._lenses[camera]

    def order(self, view: View, camera: str) -> Order:
        """What is to be drawn for a view that fits. It counts as drawn."""
        lens, deviation = self.lens(camera), view.noise.get(camera, 0.0)
        changed = {name: pixels for name, pixels in view.shown.items() if pixels is not self._shown[name]}
        self._shown |= changed
        return Order(
            self._drawn.cameras[camera],
            round(lens.width),
            round(lens.height),
            view.positions,
            {self._drawn.displays[name]: pixels for name, pixels in changed.items()},
            Disturbance(view.seed, camera, view.ticks, deviation) if deviation else None,
        )
