"""Pictures of a scene, with the depth of every pixel, drawn by MuJoCo on OpenGL.

No screen is needed. OpenGL comes from EGL, or else from OSMesa; pip can install neither, so they are packages of the
system.
"""

from __future__ import annotations

import importlib
import logging
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Any, NamedTuple, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..errors import ConfigurationError
from ..innermodel.axes import Array
from ..innermodel.pictures import Pixels
from ..innermodel.read import InnerModelError
from ..spelling import unknown
from .build import Scene, build
from .looks import FARTHEST, NEAREST, lens_of
from .noise import normal
from .unsafe import has_egl, has_osmesa

Depths = NDArray[np.float32]
"""Distances along z in m, rows from the top, shape (height, width). NaN: nothing is there."""

_SLOPE = np.float32(FARTHEST * NEAREST / (FARTHEST - NEAREST))
_OFFSET = np.float32(NEAREST / (FARTHEST - NEAREST))
"""A distance is slope / (value in OpenGL + offset): OpenGL has 1 for the nearest and 0 for the farthest."""

_EGL, _OSMESA = "egl", "osmesa"


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


class Renderer:
    """Draws views of a world. One thread uses it at a time.

    OpenGL starts with the first picture. The model that is drawn is made anew when the structure of the world, or the
    size of what a display shows, has changed.
    """

    def __init__(self) -> None:
        self._stage: _Stage | None = None

    def picture(self, view: View, camera: str, colours: Pixels | None = None, depths: Depths | None = None) -> Picture:
        """What a camera sees, and how far it is. Written to the given arrays, or to new ones.

        Raises InnerModelError if there is no such camera, and ConfigurationError if OpenGL cannot be used.
        """
        if self._stage is None or not self._stage.fits(view):
            self.close()
            self._stage = _Stage(view)
        made = self._stage.picture(view, camera, colours, depths)
        deviation = view.noise.get(camera, 0.0)
        if deviation:
            factors = 1.0 + deviation * normal(view.seed, camera, "depth", view.ticks, made.depths.size)
            np.multiply(made.depths, factors.reshape(made.depths.shape), out=made.depths, casting="same_kind")
        return made

    def close(self) -> None:
        """Free what OpenGL has. Idempotent; a later picture begins anew."""
        if self._stage:
            self._stage.close()
            self._stage = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _Stage:
    """A model that is drawn, and its context of OpenGL."""

    def __init__(self, view: View) -> None:
        self._scene = view.scene
        # The world has no meshes that are missing, or leaves them out.
        self._drawn = build(view.scene.tree, 0.005, without_meshes=True, shown=view.shown)
        model = self._drawn.model
        self._data = mujoco.MjData(model)
        self._view: View | None = None
        self._shown = dict(view.shown)
        self._lenses = {name: lens_of(view.scene.tree.node(name)) for name in self._drawn.cameras}
        self._context = _opened(model.vis.global_.offwidth, model.vis.global_.offheight)
        with self._context.as_current():
            self._pen = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._pen)
        self._pen.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        self._seen = mujoco.MjvScene(model=model, maxgeom=model.ngeom + 100)
        for flag in ("SHADOW", "REFLECTION", "SKYBOX", "FOG", "HAZE"):
            self._seen.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = False
        self._options, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED

    def fits(self, view: View) -> bool:
        """Whether it can draw a view."""
        sizes, drawn = ({name: pixels.shape for name, pixels in each.items()} for each in (view.shown, self._shown))
        return view.scene is self._scene and sizes == drawn

    def picture(self, view: View, camera: str, colours: Pixels | None, depths: Depths | None) -> Picture:
        if camera not in self._drawn.cameras:
            raise InnerModelError(unknown("camera", camera, self._drawn.cameras))
        with self._context.as_current():
            return self._drawn_by(view, camera, colours, depths)

    def _drawn_by(self, view: View, camera: str, colours: Pixels | None, depths: Depths | None) -> Picture:
        self._follow(view)
        self._camera.fixedcamid = self._drawn.cameras[camera]
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._drawn.model, self._data, self._options, None, self._camera, every, self._seen)
        width, height = round(self._lenses[camera].width), round(self._lenses[camera].height)
        where = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(where, self._seen, self._pen)
        drawn, values = np.empty((height, width, 3), np.uint8), np.empty((height, width), np.float32)
        mujoco.mjr_readPixels(drawn, values, where, self._pen)
        if colours is None:
            colours = np.empty_like(drawn)
        if depths is None:
            depths = np.empty_like(values)
        colours[:] = drawn[::-1]  # OpenGL begins with the lowest row
        values = values[::-1]
        np.divide(_SLOPE, values + _OFFSET, out=depths)
        depths[values == 0.0] = np.nan
        return Picture(colours, depths)

    def _follow(self, view: View) -> None:
        """Move all to where it is in a view."""
        if view is self._view:
            return
        model = self._drawn.model
        self._data.qpos[:] = view.positions
        mujoco.mj_kinematics(model, self._data)
        mujoco.mj_camlight(model, self._data)
        for name, pixels in view.shown.items():
            if self._shown[name] is not pixels:
                number = self._drawn.displays[name]
                begin = model.tex_adr[number]
                model.tex_data[begin : begin + pixels.size] = pixels.ravel()
                mujoco.mjr_uploadTexture(model, self._pen, number)
                self._shown[name] = pixels
        self._view = view

    def close(self) -> None:
        with self._context.as_current():
            self._pen.free()
        self._context.free()


def chosen(wanted: str, egl: Callable[[], bool], osmesa: Callable[[], bool]) -> str:
    """The library that provides OpenGL, by the name that MuJoCo has for it: `egl` or `osmesa`.

    `wanted` is the value of MUJOCO_GL. Raises ConfigurationError if there is none.
    """
    if wanted.lower() in (_EGL, _OSMESA):
        return wanted.lower()
    if egl():
        return _EGL
    if osmesa():
        return _OSMESA
    raise ConfigurationError(
        "cameras need OpenGL, which this machine does not have: install the package libegl1, or libosmesa6 "
        "(on Debian and Ubuntu: apt-get install libegl1). Everything else of a scene works without it"
    )


def _opened(width: int, height: int) -> Any:
    """A new context of OpenGL."""
    name = chosen(os.environ.get("MUJOCO_GL", ""), has_egl, has_osmesa)
    logging.getLogger("OpenGL").setLevel(logging.WARNING)  # it tells which accelerator it does not have
    os.environ["MUJOCO_GL"] = name  # libmujoco reads it when it looks for the functions of OpenGL
    try:
        context = importlib.import_module(f"mujoco.{name}").GLContext
    except ImportError as exc:
        if exc.name and exc.name.partition(".")[0] == "OpenGL":
            raise ConfigurationError(f"cameras need PyOpenGL: pip install 'robocomp-py[sim]' ({exc})") from exc
        raise _refused(name, exc) from exc
    except Exception as exc:  # PyOpenGL raises what its loading happens to raise
        raise _refused(name, exc) from exc
    try:
        return context(width, height)
    except (ImportError, RuntimeError) as exc:
        raise _refused(name, exc) from exc


def _refused(name: str, error: Exception) -> ConfigurationError:
    package = "libegl1" if name == _EGL else "libosmesa6"
    return ConfigurationError(
        f"cameras need OpenGL, and {name} of this machine does not give it: is the package {package} installed? "
        f"MUJOCO_GL=egl and MUJOCO_GL=osmesa choose between the two. ({error})"
    )
