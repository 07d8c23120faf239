"""Runs a party: its near end in this process, its far end in another one, with a record of received messages.

The other process ends on request, and whenever this process is gone. It ignores Ctrl-C, which a terminal sends to
both, because only this process closes things.
"""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import signal
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any

from .parties import INT, PATIENCE, Array, Far, Near, Party, Place
from .process import folder

MOST = 100_000
"""Messages that a record holds."""

_spawn = multiprocessing.get_context("spawn")  # threads of these libraries do not survive a fork


class Record:
    """When messages were sent and received, in memory that two processes share. Times are `time.monotonic_ns`:

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
        numbers[2 * count + 1], numbers[2 * count + 2] = INT.unpack_from(data.data)[0], now
        numbers[0] = count + 1  # last: after this, a reader may read the others

    def clear(self) -> None:
        """Between two rounds, when nothing is on its way."""
        self._numbers[0] = 0

    def times(self) -> list[tuple[int, int]]:
        """Of each message, in the order of arrival: when it was sent, and when it was heard."""
        count = self.count
        flat = list(self._numbers[1 : 1 + 2 * count])
        return list(zip(flat[::2], flat[1::2], strict=True))


class Pair:
    """Both ends of a party. The far one starts at once, so that several may start together; `with` waits until it
    is ready, makes the near one, and closes both."""

    near: Near

    def __init__(self, party: Party, place: Place) -> None:
        self.record = Record()
        self._party, self._place = party, place
        self._undo = contextlib.ExitStack()
        self._process = _Process(party, place, self.record) if party.apart else None
        if self._process:
            self._undo.callback(self._process.close)

    def __enter__(self) -> Pair:
        try:
            if self._process:
                self._process.wait()
            else:
                self._undo.callback(self._party.far(self._place, self.record.hear).close)
            self.near = self._party.near(self._place)
            self._undo.callback(self.near.close)
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def far_pid(self) -> int:
        """The process of the far end."""
        return self._process.pid if self._process else os.getpid()

    def close(self) -> None:
        """Idempotent, also before `with`."""
        self._undo.close()


@contextlib.contextmanager
def place(depth: int = 10) -> Iterator[Place]:
    """A run-time folder, and a DDS domain, of our own."""
    before = os.environ.get("ROBOCOMP_RUNTIME_DIR")
    with folder() as path:
        os.environ["ROBOCOMP_RUNTIME_DIR"] = path
        try:
            yield Place(path, 100 + 2 * (os.getpid() % 60), depth)
        finally:
            if before is None:
                del os.environ["ROBOCOMP_RUNTIME_DIR"]
            else:
                os.environ["ROBOCOMP_RUNTIME_DIR"] = before


class _Process:
    """The process of a far end."""

    def __init__(self, party: Party, place: Place, record: Record) -> None:
        self._control, theirs = _spawn.Pipe()
        self._process = _spawn.Process(target=_live, args=(party.far, place, record.shared, theirs), name="far end")
        self._process.start()
        theirs.close()

    @property
    def pid(self) -> int:
        pid = self._process.pid
        assert pid  # it was started when this was made
        return pid

    def wait(self) -> None:
        """Until it is ready."""
        if not self._control.poll(3 * PATIENCE):
            raise TimeoutError(f"the other process was not ready within {3 * PATIENCE:g} s")
        try:
            self._control.recv()
        except EOFError as exc:
            raise RuntimeError("the other process ended; see above") from exc

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
