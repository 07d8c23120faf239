"""CameraSimple, CameraRGBDSimple and RGBD: what cameras of a scene see; and Display, which they see.

Pictures are those of the moment at which they are asked for, or published. See `studio` about when they are drawn.
"""

from __future__ import annotations

import functools
import inspect
import logging
import operator
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...contract.component import Port
from ...contract.interface import Interface
from ...contract.types import Struct, Type, arrays
from ...errors import Closed, RobocompError, TransportError
from ...innermodel.pictures import Pixels
from ...innermodel.tree import Node
from ...runtime.instances import InstanceHandler
from ...runtime.ports import has_subscribers
from ..drawing import Depths
from ..looks import picture_of
from ..remote import DrawingLost
from ..render import Renderer, View
from .bases import state
from .motors import states
from .offers import carried_by
from .studio import Part, Shot, Studio
from .values import declared, filled, operation, records

if TYPE_CHECKING:
    from ..world import World

log = logging.getLogger("robocomp.sim")

Points = np.ndarray[Any, np.dtype[np.float32]]


@dataclass(frozen=True)
class Camera:
    """A camera of a component, and what carries it."""

    world: World
    studio: Studio
    node: Node
    number: int
    """Of the cameras of the scene."""
    now: Callable[[], int]
    """The clock of the component, ns."""
    period: Callable[[], float]
    """Between two publications, s."""

    def shot(self, parts: Part) -> Shot:
        """What it sees now. Handlers may run meanwhile."""
        return self.studio.shot(self.world.view(), self.node.id, self.time, parts)

    @property
    def carriers(self) -> tuple[str, list[str]]:
        """The base and the joints whose states come with a picture; "" for no base."""
        return carried_by(self.world.tree, self.node.id)

    @property
    def time(self) -> int:
        """Now, ms."""
        return self.now() // 1_000_000

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of its pictures."""
        lens = self.world.lens(self.node.id)
        return round(lens.height), round(lens.width)

    def about(self, time: int) -> dict[str, Any]:
        """The fields of a message that are known without a picture."""
        height, width = self.size
        focal = round(self.world.lens(self.node.id).focal)
        return {
            "cameraID": self.number,
            "width": width,
            "height": height,
            "focalx": focal,
            "focaly": focal,
            "alivetime": time,
            "period": self.period() * 1000,
        }

    def image(self, kind: Type, colours: Pixels, time: int) -> Any:
        """A TImage, of either of the modules that have one."""
        return filled(kind, self.about(time) | {"depth": 3, "image": colours.reshape(-1)})

    def depth(self, kind: Type, depths: Depths, time: int) -> Any:
        """A TDepth."""
        return filled(kind, self.about(time) | {"depthFactor": 1.0, "depth": depths.reshape(-1).view(np.uint8)})

    def points(self, depths: Depths) -> Points:
        """What each pixel shows, x to the right, y up, z ahead; m, shape (pixels, 3)."""
        height, width = self.size
        focal = np.float32(self.world.lens(self.node.id).focal)
        made = np.empty((height, width, 3), np.float32)
        made[..., 0] = (np.arange(width, dtype=np.float32) + (0.5 - width / 2)) / focal * depths
        made[..., 1] = ((height / 2 - 0.5) - np.arange(height, dtype=np.float32))[:, None] / focal * depths
        made[..., 2] = depths
        return made.reshape(-1, 3)


class _CameraHandler(InstanceHandler):
    def __init__(self, camera: Camera, interface: Interface) -> None:
        self._camera, self._interface = camera, interface

    def _shot(self, name: str, parts: Part) -> Shot:
        """Raises the declared exception of an operation if there is no picture."""
        try:
            return self._camera.shot(parts)
        except (RobocompError, TimeoutError) as exc:
            raise declared(self._interface, name, "HardwareFailedException", str(exc)) from exc

    def _kinds(self, name: str) -> list[Type]:
        return [each.type for each in operation(self._interface, name).outputs]


class CameraSimpleHandler(_CameraHandler):
    def getImage(self) -> Any:
        """The colours of now."""
        shot, (kind,) = self._shot("getImage", Part.COLOURS), self._kinds("getImage")
        return self._camera.image(kind, shot.picture.colours, shot.time)


class CameraRGBDSimpleHandler(_CameraHandler):
    """The argument `camera` has no effect: an instance has one camera."""

    def getImage(self, camera: str) -> Any:
        """The colours of now."""
        shot, (kind,) = self._shot("getImage", Part.COLOURS), self._kinds("getImage")
        return self._camera.image(kind, shot.picture.colours, shot.time)

    def getDepth(self, camera: str) -> Any:
        """The distances of now, m."""
        shot, (kind,) = self._shot("getDepth", Part.DEPTHS), self._kinds("getDepth")
        return self._camera.depth(kind, shot.picture.depths, shot.time)

    def getPoints(self, camera: str) -> Any:
        """The points of now, m."""
        shot, (kind,) = self._shot("getPoints", Part.DEPTHS), self._kinds("getPoints")
        return self._points(kind, shot)

    def getAll(self, camera: str) -> Any:
        """Colours, distances and points of now."""
        shot, (kind,) = self._shot("getAll", Part.COLOURS | Part.DEPTHS), self._kinds("getAll")
        assert isinstance(kind, Struct)
        made: dict[str, Callable[[Type], Any]] = {
            "image": lambda each: self._camera.image(each, shot.picture.colours, shot.time),
            "depth": lambda each: self._camera.depth(each, shot.picture.depths, shot.time),
            "points": lambda each: self._points(each, shot),
        }
        return filled(kind, {each.name: made[each.name](each.type) for each in kind.fields if each.name in made})

    def _points(self, kind: Type, shot: Shot) -> Any:
        assert isinstance(kind, Struct)
        (points,) = (each.type for each in kind.fields if each.name == "points")
        x, y, z = self._camera.points(shot.picture.depths).T
        values = {"points": records(points, {"x": x, "y": y, "z": z})}
        return filled(kind, values | self._camera.about(shot.time))


_COLOURED, _DEEP = {"rgbMatrix", "color"}, {"distanceMatrix", "depth", "points", "pointStream"}
"""The results of operations of RGBD that need colours, and those that need distances."""


class RGBDHandler(_CameraHandler):
    """Distances and points in mm. Both lenses are the same, so registration changes nothing."""

    def __init__(self, camera: Camera, interface: Interface) -> None:
        super().__init__(camera, interface)
        self._registration: Any = None

    def getRGBDParams(self) -> Any:
        """What the file tells of the camera."""
        (kind,) = self._kinds("getRGBDParams")
        assert isinstance(kind, Struct)
        height, width = self._camera.size
        period, (base, joints) = self._camera.period(), self._camera.carriers
        lens = {
            "focal": round(self._camera.world.lens(self._camera.node.id).focal),
            "width": width,
            "height": height,
            "size": width * height,
            "FPS": round(1 / period) if period else 0,
        }
        values = {each.name: filled(each.type, lens) for each in kind.fields if each.name in ("color", "depth")}
        return filled(
            kind,
            values
            | {
                "timerPeriod": round(period * 1000),
                "talkToBase": bool(base),
                "talkToJointMotor": bool(joints),
                "driver": "simulated",
                "device": self._camera.node.id,
            },
        )

    def setRegistration(self, value: Any) -> None:
        """Keep it for `getRegistration`."""
        self._registration = value

    def getRegistration(self) -> Any:
        """What was set last; DepthInColor before that."""
        if self._registration is None:
            kind: Any = operation(self._interface, "getRegistration").outputs[0].type
            return getattr(kind.python, "DepthInColor", next(iter(kind.python)))
        return self._registration

    def getData(self) -> Any:
        """Colours as bytes, and distances."""
        return self._answer("getData")

    def getDepthInIR(self) -> Any:
        """Distances."""
        return self._answer("getDepthInIR")

    def getImage(self) -> Any:
        """Colours, distances and points."""
        return self._answer("getImage")

    def getDepth(self) -> Any:
        """Distances."""
        return self._answer("getDepth")

    def getRGB(self) -> Any:
        """Colours."""
        return self._answer("getRGB")

    def getXYZ(self) -> Any:
        """Points."""
        return self._answer("getXYZ")

    def getXYZByteStream(self) -> Any:
        """Points as bytes."""
        return self._answer("getXYZByteStream")

    def _answer(self, name: str) -> tuple[Any, ...]:
        """The results of an operation, by their names."""
        outputs = operation(self._interface, name).outputs
        carried = {each.name: self._carried(each.name, each.type) for each in outputs}
        is_coloured, is_deep = (any(each.name in names for each in outputs) for names in (_COLOURED, _DEEP))
        parts = (Part.COLOURS if is_coloured else Part(0)) | (Part.DEPTHS if is_deep else Part(0))
        colours, depths = self._shot(name, parts).picture
        red, green, blue = colours.reshape(-1, 3).T
        made: dict[str, Callable[[Type], Any]] = {
            "rgbMatrix": lambda kind: colours.reshape(-1),
            "distanceMatrix": lambda kind: depths.reshape(-1) * np.float32(1000),
            "depth": lambda kind: depths.reshape(-1) * np.float32(1000),
            "color": lambda kind: records(kind, {"red": red, "green": green, "blue": blue}),
            "points": lambda kind: records(kind, dict(zip("xyzw", self._points(depths).T, strict=True))),
            "pointStream": lambda kind: self._points(depths).reshape(-1).view(np.uint8),
        }
        return tuple(made[each.name](each.type) if each.name in made else carried[each.name] for each in outputs)

    def _points(self, depths: Depths) -> Points:
        points = self._camera.points(depths) * np.float32(1000)
        return np.concatenate((points, np.ones((len(points), 1), np.float32)), axis=1)

    def _carried(self, name: str, kind: Type) -> Any:
        """The states of what carries the camera."""
        base, joints = self._camera.carriers
        if name == "hState":
            return states(self._camera.world, joints, kind)
        if name == "bState":
            return filled(kind, state(self._camera.world, base) if base else {})
        return None


class DisplayHandler(InstanceHandler):
    def __init__(self, world: World, display: str, folder: Path, interface: Interface) -> None:
        """Files are looked for in `folder`."""
        self._world, self._display, self._folder, self._interface = world, display, folder, interface

    def setImage(self, img: Any) -> None:
        """Show a picture of 1 (grey), 3 or 4 bytes a pixel; the fourth has no effect."""
        pixels = np.asarray(img.Img, dtype=np.uint8)
        if not (img.width > 0 and img.height > 0 and img.depth in (1, 3, 4)):
            self._refuse("setImage", f"{img.width} x {img.height} pixels of {img.depth} bytes: it is 1, 3 or 4 bytes")
        if pixels.size != img.width * img.height * img.depth:
            wanted = f"{img.width} x {img.height} pixels of {img.depth} bytes"
            self._refuse("setImage", f"a picture of {wanted} has {pixels.size} bytes")
        pixels = pixels.reshape(img.height, img.width, img.depth)
        self._show("setImage", np.repeat(pixels, 3, axis=2) if img.depth == 1 else pixels[..., :3])

    def setImageFromFile(self, pathImg: str) -> None:
        """Show the picture of a file on the machine of this component."""
        pixels = picture_of(self._folder / pathImg)
        if pixels is None:
            self._refuse("setImageFromFile", f"{pathImg}: there is no picture that can be read")
        else:
            self._show("setImageFromFile", pixels)

    def _show(self, name: str, pixels: Pixels) -> None:
        try:
            self._world.show(self._display, pixels)
        except ValueError as exc:
            self._refuse(name, str(exc))

    def _refuse(self, name: str, text: str) -> None:
        raise declared(self._interface, name, "HardwareFailedException", text)


class CameraPublication:
    """Publishes what a camera sees, on each of its topics that is heard.

    A picture is drawn once. If no other topic and no client needs it, it is drawn into the memory that is sent. A
    picture is left out while the one before it is drawn.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._topics: dict[str, _Topic] = {}
        """By the port."""
        self._drawing: Future[None] | None = None

    def add(self, port: Port, proxy: Any) -> None:
        self._topics[port.name] = _Topic(self._camera, port, proxy)

    def remove(self, port: Port) -> bool:
        """Publish there no longer. Returns whether no topic is left."""
        self._topics.pop(port.name, None)
        return not self._topics

    def __call__(self) -> None:
        """Publish what it sees now, unless the picture before is still being drawn."""
        heard = [each for each in self._topics.values() if each.is_heard]
        if heard and (self._drawing is None or self._drawing.done()):
            camera = self._camera
            kept = camera.studio.wanted(camera.node.id)
            if len(heard) > 1:
                kept |= functools.reduce(operator.or_, (each.parts for each in heard))
            canvas = _Canvas(camera, camera.world.view(), camera.time, kept)
            self._drawing = camera.studio.do(partial(_publish, heard, canvas))


def _publish(heard: Sequence[_Topic], canvas: _Canvas, renderer: Renderer) -> None:
    for each in heard:
        each.publish(canvas, renderer)


@dataclass(frozen=True)
class _Canvas:
    """A picture of a camera at a moment, which topics share."""

    camera: Camera
    view: View
    time: int
    """ms."""
    kept: Part
    """The parts that further topics, or calls, may need."""

    def fill(self, renderer: Renderer, colours: Pixels | None, depths: Depths | None) -> None:
        """Write the picture to arrays; what is None is left out."""
        camera = self.camera
        given = (renderer, self.view, camera.node.id, self.time)
        camera.studio.fill(*given, colours=colours, depths=depths, kept=self.kept)


class _Topic:
    """A topic on which pictures of a camera are published."""

    def __init__(self, camera: Camera, port: Port, proxy: Any) -> None:
        self._camera, self._proxy = camera, proxy
        (published,) = port.interface.operations
        self._inputs = published.inputs
        self._loan = getattr(proxy, f"loan{published.name[0].upper()}{published.name[1:]}")
        fields = [path[-1].name for path, _ in arrays(self._inputs)]
        self._arrays = list(zip(inspect.signature(self._loan).parameters, fields, strict=False))
        """The arguments of the loan, and the names of the fields that they are the shapes of."""
        self.parts = Part.COLOURS | Part.DEPTHS if "depth" in fields else Part.COLOURS
        """The parts that are published."""
        self._is_broken = False
        self._told = ""
        """Why the last picture was not published; "" if it was."""

    @property
    def is_heard(self) -> bool:
        return not self._is_broken and has_subscribers(self._proxy)

    def publish(self, canvas: _Canvas, renderer: Renderer) -> None:
        camera = self._camera.node.id
        try:
            height, width = self._camera.size
            shapes = {"image": (height, width, 3), "depth": (height, width * 4)}
            with self._loan(**{each: shapes.get(name, 0) for each, name in self._arrays}) as message:
                found = self._fill(message, self._camera.about(canvas.time) | {"depthFactor": 1.0})
                depths = found.get("depth")
                canvas.fill(renderer, found.get("image"), None if depths is None else depths.view(np.float32))
            self._told = ""
        except Closed:
            self._is_broken = True
        except (TransportError, DrawingLost) as exc:
            if str(exc) != self._told:
                log.warning("a picture of `%s` was not published: %s", camera, exc)
            self._told = str(exc)
        except RobocompError as exc:
            self._is_broken = True
            log.error("`%s` publishes no pictures: %s", camera, exc)
        except Exception:
            self._is_broken = True
            log.exception("`%s` publishes no pictures", camera)

    def _fill(self, message: Any, values: Mapping[str, Any]) -> dict[str, Pixels]:
        """Write what is known without a picture; return the arrays for the rest, by the names of their fields."""
        found = {}
        for each in self._inputs:
            struct = message if len(self._inputs) == 1 else getattr(message, each.attribute)
            assert isinstance(each.type, Struct)
            for field in each.type.fields:
                before = getattr(struct, field.attribute)
                if isinstance(before, np.ndarray):
                    found[field.name] = before
                elif field.name in values:
                    setattr(struct, field.attribute, values[field.name])
                elif field.name == "depth":
                    setattr(struct, field.attribute, 3)  # bytes of a pixel
        return found
