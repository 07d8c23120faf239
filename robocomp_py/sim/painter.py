"""The process that draws for `remote`: lines of JSON come on its standard input, and go to its standard output.

line                                                          does
{"size": n, "load": m}                                        draws the model in the first m bytes of the memory
{"size": n, "camera": …, "width": …, "height": …, "parts": …, "positions": …, "textures": […], "noise": …}
                                                              draws: the memory has place for depths and colours, then
                                                              positions and textures; `parts` tells whether colours, and
                                                              whether depths are wanted

Each is answered by {"error": ""}, or by what is wrong with this machine. The process ends when its input does, or when
another process has become its parent: then its own has been killed.
"""

from __future__ import annotations

import json
import mmap
import os
import select
import signal
import sys
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from ..errors import ConfigurationError
from .drawing import Disturbance, Easel, Order

_EVERY = 1000
"""Milliseconds between two checks whether the parent is still there."""


def main(memory: int) -> None:
    """Draw until the parent has ended. `memory` is a descriptor."""
    for number in (signal.SIGINT, signal.SIGTERM):  # they are meant for the parent, which ends this one
        signal.signal(number, signal.SIG_IGN)
    answers = os.dup(1)
    os.dup2(2, 1)  # drivers may print
    easel: Easel | None = None
    mapped, size = None, 0
    for line in _lines(os.getppid()):
        message = json.loads(line)
        if mapped is None or size != message["size"]:
            size = message["size"]
            mapped = mmap.mmap(memory, size)
        error = ""
        try:
            if "load" in message:
                if easel:
                    easel.close()
                easel = None
                easel = Easel(_model(mapped, message["load"]))
            elif easel:
                _draw(easel, mapped, message)
        except ConfigurationError as exc:
            error = str(exc)
        os.write(answers, json.dumps({"error": error}).encode() + b"\n")
    if easel:
        easel.close()


def _lines(parent: int) -> Iterator[bytes]:
    found = b""
    poll = select.poll()
    poll.register(0, select.POLLIN)
    while os.getppid() == parent:
        if not poll.poll(_EVERY):
            continue
        part = os.read(0, 65536)
        if not part:
            return
        *lines, found = (found + part).split(b"\n")
        yield from lines


def _model(mapped: mmap.mmap, size: int) -> mujoco.MjModel:
    return mujoco.MjModel.from_binary_path("scene.mjb", {"scene.mjb": mapped[:size]})


def _draw(easel: Easel, mapped: mmap.mmap, message: dict[str, Any]) -> None:
    shape = message["height"], message["width"]
    pixels = shape[0] * shape[1]
    begin = 7 * pixels
    positions = np.frombuffer(mapped[begin : begin + 8 * message["positions"]])
    begin += positions.nbytes
    textures = {}
    for number, *size in message["textures"]:
        end = begin + size[0] * size[1] * size[2]
        textures[number] = np.frombuffer(mapped[begin:end], np.uint8).reshape(size)
        begin = end
    noise = Disturbance(*message["noise"]) if message["noise"] else None
    depths = np.frombuffer(mapped, np.float32, pixels).reshape(shape)
    colours = np.frombuffer(mapped, np.uint8, 3 * pixels, 4 * pixels).reshape(*shape, 3)
    parts = (part if wanted else None for part, wanted in zip((colours, depths), message["parts"], strict=True))
    easel.draw(Order(message["camera"], *shape[::-1], positions, textures, noise), *parts)


if __name__ == "__main__":
    main(int(sys.argv[1]))
