"""Pictures that a process of its own draws: a driver that crashes takes no component with it.

The process is started with the first picture. Both have memory without a name, which ends with them: the model goes
through it once, then each order and its picture. Messages are lines of JSON; see `painter` for the other end.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import mmap
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ..errors import ConfigurationError, RobocompError
from ..innermodel.pictures import Pixels
from .drawing import Depths, Order

_MOST_LOST, _WITHIN = 5, 60.0
"""Processes that may be lost within some seconds. Then none is started until the time is over."""


class DrawingLost(RobocompError):
    """The process that draws pictures has ended, or does not answer. A later picture starts it again."""


@dataclass
class _Started:
    """A process that draws, and the memory that it has in common with this one."""

    process: subprocess.Popen[bytes]
    memory: int
    size: int = 0
    mapped: mmap.mmap | None = None
    model: bytes = b""
    """A hash of the model that it draws; nothing if it has none, or draws it with other textures."""

    def reserve(self, size: int) -> mmap.mmap:
        """Memory of at least some bytes. Arrays that are made of it have to be gone when it is reserved again."""
        if self.mapped is None or self.size < size:
            self.mapped = None
            os.ftruncate(self.memory, size)
            self.size, self.mapped = size, mmap.mmap(self.memory, size)
        return self.mapped

    def release(self) -> None:
        """Give the memory back to the system."""
        self.mapped = None
        os.ftruncate(self.memory, 0)


class Remote:
    """An artist, see `render.Artist`, that lets a process draw."""

    def __init__(self, patience: float = 30.0) -> None:
        """`patience` is how long an answer is awaited, s."""
        self._patience = patience
        self._started: _Started | None = None
        self._lost: deque[float] = deque(maxlen=_MOST_LOST)
        """When processes were lost, s."""

    def load(self, model: mujoco.MjModel) -> None:
        """Raises ConfigurationError if OpenGL cannot be used, and DrawingLost."""
        started = self._started = self._started or self._start()
        buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, buffer)
        saved = buffer.tobytes()
        digest = hashlib.sha256(saved).digest()
        if digest == started.model:
            return
        started.model = b""
        started.reserve(len(saved))[: len(saved)] = saved
        self._ask(started, {"load": len(saved)})
        started.model = digest
        started.release()

    def draw(self, order: Order, colours: Pixels | None, depths: Depths | None) -> None:
        """Raises DrawingLost."""
        started = self._started
        assert started
        if order.textures:
            started.model = b""
        textures = [[number, *pixels.shape] for number, pixels in order.textures.items()]
        sent = [order.positions.tobytes(), *(pixels.tobytes() for pixels in order.textures.values())]
        pixels = order.width * order.height
        memory = started.reserve(7 * pixels + sum(map(len, sent)))
        begin = 7 * pixels
        for each in sent:
            memory[begin : begin + len(each)] = each
            begin += len(each)
        noise = order.noise
        self._ask(
            started,
            {
                "camera": order.camera,
                "width": order.width,
                "height": order.height,
                "parts": [colours is not None, depths is not None],
                "positions": len(order.positions),
                "textures": textures,
                "noise": [noise.seed, noise.camera, noise.ticks, noise.deviation] if noise else None,
            },
        )
        if depths is not None:
            depths[:] = np.frombuffer(memory, np.float32, pixels).reshape(depths.shape)
        if colours is not None:
            colours[:] = np.frombuffer(memory, np.uint8, 3 * pixels, 4 * pixels).reshape(colours.shape)

    def close(self) -> None:
        """End the process. Idempotent."""
        started, self._started = self._started, None
        if started:
            _end(started, self._patience)

    def _start(self) -> _Started:
        now = time.monotonic()
        if len(self._lost) == _MOST_LOST and now - self._lost[0] < _WITHIN:
            text = f"the process that draws pictures has ended {_MOST_LOST} times within {_WITHIN:g} s"
            raise DrawingLost(f"{text}: it is started again later")
        memory = _memory()
        command = (sys.executable, "-P", "-m", "robocomp_py.sim.painter", str(memory))
        try:
            pipe = subprocess.PIPE
            process = subprocess.Popen(command, stdin=pipe, stdout=pipe, pass_fds=(memory,))
        except OSError as exc:
            os.close(memory)
            raise self._gone(f"cannot be started: {exc}") from exc
        return _Started(process, memory)

    def _ask(self, started: _Started, message: dict[str, Any]) -> None:
        assert started.process.stdin
        line = json.dumps({"size": started.size, **message}).encode() + b"\n"
        answer: bytes | None = b""
        with contextlib.suppress(BrokenPipeError):  # then there is no answer, which is told below
            started.process.stdin.write(line)
            started.process.stdin.flush()
            answer = _line(started.process, self._patience)
        if not answer:
            self._started = None
            raise self._gone(_end(started, 0.0 if answer is None else self._patience))
        if error := json.loads(answer)["error"]:
            raise ConfigurationError(error)

    def _gone(self, why: str) -> DrawingLost:
        self._lost.append(time.monotonic())
        return DrawingLost(f"the process that draws pictures {why}; the next picture starts it again")


def _memory() -> int:
    """A descriptor of memory without a name: it is gone when no process has it any more."""
    if sys.platform == "linux":
        return os.memfd_create("robocomp-pictures")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


def _line(process: subprocess.Popen[bytes], patience: float) -> bytes | None:
    """The next line that a process writes; nothing if it ends, and None if it does not answer in time."""
    assert process.stdout
    found, end = b"", time.monotonic() + patience
    poll = select.poll()
    poll.register(process.stdout, select.POLLIN)
    while not found.endswith(b"\n"):
        if not poll.poll(max(0.0, end - time.monotonic()) * 1000):
            return None
        part = os.read(process.stdout.fileno(), 65536)
        if not part:
            return b""
        found += part
    return found


def _end(started: _Started, patience: float) -> str:
    """End a process, which does so by itself if it still listens; returns what has happened to it."""
    process = started.process
    assert process.stdin
    assert process.stdout
    with contextlib.suppress(BrokenPipeError):
        process.stdin.close()
    try:
        code = process.wait(patience)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        code = None
    process.stdout.close()
    os.close(started.memory)
    if code is None:
        return "did not answer, and was ended"
    return f"was ended by {signal.Signals(-code).name}" if code < 0 else f"has ended with exit code {code}"
