"""A model is drawn by MuJoCo on OpenGL, without a screen.

OpenGL comes from EGL, or else from OSMesa; pip can install neither, so they are packages of the system.
"""

from __future__ import annotations

import importlib
import logging
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..errors import ConfigurationError
from ..innermodel.axes import Array
from ..innermodel.pictures import Pixels
from .noise import normal
from .unsafe import has_egl, has_osmesa

Depths = NDArray[np.float32]
"""Distances along z in m, rows from the top, shape (height, width). NaN: nothing is there."""

NEAREST = 0.01
"""What is nearer to a camera is not drawn, m."""
FARTHEST = 1000.0
"""What is farther from a camera is not drawn, m."""

_SLOPE = np.float32(FARTHEST * NEAREST / (FARTHEST - NEAREST))
_OFFSET = np.float32(NEAREST / (FARTHEST - NEAREST))
"""A distance is slope / (value in OpenGL + offset): OpenGL has 1 for the nearest and 0 for the farthest."""

_HIDDEN = 5
"""A group of geoms that MuJoCo does not draw."""

_EGL, _OSMESA = "egl", "osmesa"


@dataclass(frozen=True, slots=True)
class Disturbance:
    """The noise of a picture: factors on its depths."""

    seed: int
    camera: str
    ticks: int
    deviation: float


@dataclass(frozen=True, slots=True, eq=False)
class Order:
    """What is to be drawn of a model."""

    camera: int
    width: int
    height: int
    positions: Array
    """The vector of positions. The same array is the same state."""
    textures: Mapping[int, Pixels]
    """Those that have changed since the order before, by their numbers; of the size that they have in the model."""
    noise: Disturbance | None


class Easel:
    """A model that is drawn, and its context of OpenGL. One thread uses it."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Raises ConfigurationError if OpenGL cannot be used."""
        self._model, self._data = model, mujoco.MjData(model)
        self._positions: Array | None = None
        self._sheets: dict[tuple[int, int], tuple[Pixels, Depths]] = {}
        self._context = _opened(model.vis.global_.offwidth, model.vis.global_.offheight)
        with self._context.as_current():
            self._pen = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._pen)
            _drop_stencil(self._pen)
        self._pen.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        self._seen = mujoco.MjvScene(model=model, maxgeom=model.ngeom + 100)
        for flag in ("SHADOW", "REFLECTION", "SKYBOX", "FOG", "HAZE"):
            self._seen.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = False
        self._options, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED

    def draw(self, order: Order, colours: Pixels | None, depths: Depths | None) -> None:
        """Draw into arrays of the size of the order. What is None is not read from OpenGL, which takes time."""
        with self._context.as_current():
            self._draw(order, colours, depths)
        if order.noise and depths is not None:
            noise = order.noise
            normals = normal(noise.seed, noise.camera, "depth", noise.ticks, depths.size)
            factors = (1.0 + noise.deviation * normals).reshape(depths.shape)
            np.multiply(depths, factors, out=depths, casting="same_kind")

    def _draw(self, order: Order, colours: Pixels | None, depths: Depths | None) -> None:
        model = self._model
        if order.positions is not self._positions:
            self._data.qpos[:] = order.positions
            mujoco.mj_kinematics(model, self._data)
            mujoco.mj_camlight(model, self._data)
            self._positions = order.positions
        for number, pixels in order.textures.items():
            begin = model.tex_adr[number]
            model.tex_data[begin : begin + pixels.size] = pixels.ravel()
            mujoco.mjr_uploadTexture(model, self._pen, number)
        self._camera.fixedcamid = order.camera
        model.geom_group[:] = np.where(self._in_sight(order), 0, _HIDDEN)
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(model, self._data, self._options, None, self._camera, every, self._seen)
        where = mujoco.MjrRect(0, 0, order.width, order.height)
        mujoco.mjr_render(where, self._seen, self._pen)
        drawn, values = self._sheet(order.height, order.width)
        read = None if colours is None else drawn, None if depths is None else values
        mujoco.mjr_readPixels(*read, where, self._pen)
        if colours is not None:
            colours[:] = drawn[::-1]  # OpenGL begins with the lowest row
        if depths is not None:
            np.add(values[::-1], _OFFSET, out=depths)
            is_nothing = depths == _OFFSET
            np.divide(_SLOPE, depths, out=depths)
            np.copyto(depths, np.float32(np.nan), where=is_nothing)

    def _in_sight(self, order: Order) -> NDArray[np.bool_]:
        """Which geoms a camera may see, shape (number of geoms,): OpenGL would transform all the others for nothing.

        A geom is in sight if the sphere around it is not wholly beyond one of the sides of the picture.
        """
        model, data, camera = self._model, self._data, order.camera
        right, up, back = ((data.geom_xpos - data.cam_xpos[camera]) @ data.cam_xmat[camera].reshape(3, 3)).T
        reach = model.geom_rbound * 1.001 + 0.001
        steep = np.tan(np.radians(model.cam_fovy[camera]) / 2)
        wide = steep * order.width / order.height
        found: NDArray[np.bool_] = reach > back
        found &= np.abs(right) + wide * back < reach * np.hypot(1.0, wide)
        found &= np.abs(up) + steep * back < reach * np.hypot(1.0, steep)
        return found

    def _sheet(self, height: int, width: int) -> tuple[Pixels, Depths]:
        """What OpenGL writes to. It is used again: new memory would take time for each picture."""
        if (height, width) not in self._sheets:
            shape = height, width
            self._sheets[shape] = np.empty((*shape, 3), np.uint8), np.empty(shape, np.float32)
        return self._sheets[height, width]

    def close(self) -> None:
        """Free what OpenGL has."""
        with self._context.as_current():
            self._pen.free()
        self._context.free()


def chosen(wanted: str, egl: Callable[[], bool], osmesa: Callable[[], bool]) -> str:
    """The library that provides OpenGL, by the name that MuJoCo has for it: `egl` or `osmesa`.

    `wanted` is the value of MUJOCO_GL. Raises ConfigurationError if neither library is installed.
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


def _drop_stencil(pen: mujoco.MjrContext) -> None:
    """Give the buffer that is drawn into depths of 32 bits without a stencil, which only reflections need.

    MuJoCo makes one with a stencil, of 8 bytes a pixel, and clears only the depths of it. OpenGL in software then
    takes up to a quarter more time for a picture. The context of the buffer is current, and the buffer is bound.
    """
    gl = importlib.import_module("OpenGL.raw.GL.VERSION.GL_3_0")  # `OpenGL.GL` takes 0.2 s to import
    if not gl.glGetRenderbufferParameteriv:
        return
    kind, buffer, frame = np.zeros(1, np.int32), gl.GL_RENDERBUFFER, gl.GL_FRAMEBUFFER
    gl.glBindRenderbuffer(buffer, pen.offDepthStencil)
    gl.glGetRenderbufferParameteriv(buffer, gl.GL_RENDERBUFFER_INTERNAL_FORMAT, kind)
    if kind[0] == gl.GL_DEPTH32F_STENCIL8:  # else this OpenGL has no depths of 32 bits
        gl.glRenderbufferStorage(buffer, gl.GL_DEPTH_COMPONENT32F, pen.offWidth, pen.offHeight)
        gl.glFramebufferRenderbuffer(frame, gl.GL_DEPTH_STENCIL_ATTACHMENT, buffer, 0)
        gl.glFramebufferRenderbuffer(frame, gl.GL_DEPTH_ATTACHMENT, buffer, pen.offDepthStencil)


def _refused(name: str, error: Exception) -> ConfigurationError:
    package = "libegl1" if name == _EGL else "libosmesa6"
    return ConfigurationError(
        f"cameras need OpenGL, and {name} of this machine does not give it: is the package {package} installed? "
        f"MUJOCO_GL=egl and MUJOCO_GL=osmesa choose between the two. ({error})"
    )
