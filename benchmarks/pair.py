"""A party at work: its near end here, its far end in another process, and a record of what that one heard.

The other process ends when it is told to, and when this one has gone, however that happened. It
ignores Ctrl-C, which a terminal sends to both: closing is in one place.
"""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import signal
import struct
import tempfile
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any

from .parties import PATIENCE, Array, Far, Near, Party, Place

MOST = 100_000
"""Messages that a record holds."""

_spawn = multiprocessing.get_context("spawn")  # threads of these libraries do not survive a fork
_INT = struct.Struct("=q")


class Record:
    """When messages were sent and heard, in memory that two processes share. Times are `time.monotonic_ns`:

    on Linux one clock for all processes of a host, so that they may be subtracted.
    """

    def __init__(self, shared: Any = None) -> None:
        self.shared = shared if shared is not None else _spawn.RawArray(ctypes.c_int64, 1 + 2 * MOST)
        self._numbers: memoryview[int] = memoryview(self.shared).cast("B").cast("q")

    @property
    def count(self) -> int:
        return self._numbers[0]

    def hear(self, data: Array) -> None:
        now, numbers = time.monotonic_ns(), self._numbers
        count = numbers[0]
        numbers[2 * count + 1], numbers[2 * count + 2] = _INT.unpack_from(data.data)[0], now
        numbers[0] = count + 1  # at last: whoever sees it may read the others

    def clear(self) -> None:
        """Between two rounds, when nothing is on its way."""
        self._numbers[0] = 0

    def times(self) -> list[tuple[int, int]]:
        """Of each message, in the order of arrival: when it was sent, and when it was heard."""
        count = self.count
        flat = list(self._numbers[1 : 1 + 2 * count])
        return list(zip(flat[::2], flat[1::2], strict=True))


def stamp(data: Array) -> None:
    """Write into a message when it is sent."""
    _INT.pack_into(data.data, 0, time.monotonic_ns())


class Pair:
    """Both ends of a party; `with` closes them."""

    def __init__(self, party: Party, place: Place) -> None:
        self.record = Record()
        with contextlib.ExitStack() as undo:
            far: _Process | Far
            far = _Process(party, place, self.record) if party.apart else party.far(place, self.record.hear)
            undo.callback(far.close)
            self.near: Near = party.near(place)
            undo.callback(self.near.close)
            self._undo = undo.pop_all()

    def __enter__(self) -> Pair:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._undo.close()


@contextlib.contextmanager
def place(depth: int = 10) -> Iterator[Place]:
    """A run-time folder, and a DDS domain, of our own."""
    before = os.environ.get("ROBOCOMP_RUNTIME_DIR")
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as folder:  # short: socket paths have 107 bytes
        os.environ["ROBOCOMP_RUNTIME_DIR"] = folder
        try:
            yield Place(folder, 100 + 2 * (os.getpid() % 60), depth)
        finally:
            if before is None:
                del os.environ["ROBOCOMP_RUNTIME_DIR"]
            else:
                os.environ["ROBOCOMP_RUNTIME_DIR"] = before


class _Process:
    """The process of a far end, which is ready."""

    def __init__(self, party: Party, place: Place, record: Record) -> None:
        self._control, theirs = _spawn.Pipe()
        self._process = _spawn.Process(target=_live, args=(party.far, place, record.shared, theirs), name="far end")
        self._process.start()
        theirs.close()
        try:
            if not self._control.poll(3 * PATIENCE):
                raise TimeoutError(f"the other process was not ready within {3 * PATIENCE:g} s")
            self._control.recv()
        except BaseException as exc:
            self.close()
            if isinstance(exc, EOFError):
                raise RuntimeError("the other process ended; see above") from exc
            raise

    def close(self) -> None:
        self._control.close()  # which it notices
        self._process.join(PATIENCE)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._process.close()


def _live(far: Any, place: Place, shared: Any, control: Connection[Any, Any]) -> None:
    """In the other process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end: Far = far(place, Record(shared).hear)
    try:
        control.send("ready")
        control.recv()
    except (EOFError, OSError):
        pass
    finally:
        end.close()
