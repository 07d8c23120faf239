"""Many processes, each of which does one part and tells what it found. They end with this process."""

from __future__ import annotations

import contextlib
import multiprocessing
import resource
import signal
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from typing import Any, TypeAlias

from ..parties import PATIENCE

Control: TypeAlias = "Connection[Any, Any]"
"""The end of a member: `send` tells, `recv` waits for a word, and raises EOFError if it is to end."""

_forking = multiprocessing.get_context("forkserver")  # its processes have imported everything, and have no threads
_forking.set_forkserver_preload(["numpy", "zmq", "robocomp_py.runtime.ports", "benchmarks.scale.ends"])
_spawning = multiprocessing.get_context("spawn")


class Member:
    """A process that calls `act(control, *arguments)`; a `fresh` one shares no memory with others."""

    def __init__(self, act: Callable[..., None], *arguments: Any, fresh: bool = False) -> None:
        context: Any = _spawning if fresh else _forking
        self._control, theirs = context.Pipe()
        self._process = context.Process(target=_live, args=(act, arguments, theirs), name=act.__name__)
        self._process.start()
        theirs.close()

    def told(self, within: float = 3 * PATIENCE) -> Any:
        """What it tells next. Raises TimeoutError, and RuntimeError if it has ended."""
        if not self._control.poll(within):
            raise TimeoutError(f"a process told nothing within {within:g} s")
        try:
            return self._control.recv()
        except EOFError as exc:
            raise RuntimeError("a process ended; see above") from exc

    def say(self, word: Any) -> None:
        self._control.send(word)

    def dismiss(self) -> None:
        """It is to end."""
        self._control.close()

    def close(self) -> None:
        """Wait until it has ended."""
        self.dismiss()
        self._process.join(PATIENCE)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._process.close()


@contextlib.contextmanager
def together(*members: Member) -> Iterator[None]:
    """Closes these members at the end; all are told first."""
    try:
        yield
    finally:
        for each in members:
            each.dismiss()
        for each in members:
            each.close()


def _live(act: Callable[..., None], arguments: tuple[Any, ...], control: Control) -> None:
    """In the other process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    with contextlib.suppress(EOFError, BrokenPipeError):  # this member is to end
        act(control, *arguments)
