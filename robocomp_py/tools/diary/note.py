"""Writes the diary of a component while it runs.

Methods of the worker and operations of its proxies are replaced by ones that note their calls. So a component without
a diary pays nothing. An event is written while its thread is inside the monitor, so their order is that of the turns.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import itertools
import logging
import os
import platform
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from ...contract.interface import Operation, Pattern
from ...runtime.ports import Proxy
from ...runtime.settings import Settings
from ...runtime.worker import Worker
from ...version import __version__
from . import coding
from .chance import here, observed_clocks, seeded
from .events import NO_DATA, DiaryWriter

log = logging.getLogger("robocomp.diary")

_NO_TURN = 0

_open: list[Note] = []
"""The diaries of this process."""


class Note:
    """The diary of one component; see `runtime.diary.Diary`."""

    def __init__(self, path: str, settings: Settings) -> None:
        """Raises RecordingError and ConfigurationError."""
        self._writer = DiaryWriter(Path(path))
        self._settings = settings
        self._seed = secrets.randbits(32)
        self._turns, self._later = itertools.count(1), itertools.count(1)
        self._told: set[str] = set()
        self._end = contextlib.ExitStack()
        self._end.enter_context(observed_clocks())
        self._end.enter_context(seeded(self._seed))
        _open.append(self)

    def note_worker(self, worker: Worker[Any]) -> None:
        component = worker.component
        worker._seed = (self._seed, *self._settings.instance.encode())
        document = self._settings.document
        self._writer.write(
            "start",
            _NO_TURN,
            component=component.name,
            instance=self._settings.instance,
            configuration=document.data if document else {},
            seed=self._seed,
            hash_seed=os.environ.get("PYTHONHASHSEED", ""),
            left_out=coding.left_out(component, reads_caller=worker.reads_caller),
            versions={"python": platform.python_version(), "robocomp_py": __version__},
        )
        for each in _open if len(_open) > 1 else ():
            each.leave_out("`random` and `numpy.random`, which several components of one process share")
        methods: dict[str, Any] = {}
        for name in coding.hooks(component):
            methods[name] = self._turn(name, getattr(worker, name))
        for name, operation in coding.handlers(component).items():
            methods[name] = self._turn(name, getattr(worker, name), operation)
        for name in coding.WATCHING:
            methods[name] = self._turn(name, getattr(worker, name), taken=lambda arguments: {"values": list(arguments)})
        methods[coding.PARAMS] = self._turn(coding.PARAMS, worker.paramsChanged, taken=_changes(worker))
        methods |= {"_sleep": self._sleeping(worker._sleep), "_after": self._asking(worker._after)}
        methods |= {"now": self._reading("now", worker.now), "_state": self._reading("state", worker._state)}
        vars(worker).update(methods)

    def note_proxies(self, worker: Worker[Any]) -> None:
        bound: dict[str, dict[str, Any]] = {}
        for port, operation, pattern, name in coding.outs(worker.component):
            proxy = getattr(worker, port.attribute)
            if isinstance(proxy, Proxy) and operation.name in proxy._bound:
                kind = _Query if pattern is Pattern.QUERY else _Send
                noted = kind(self, name, operation, proxy._bound[operation.name])
                bound.setdefault(port.attribute, {})[operation.name] = noted
        for attribute, operations in bound.items():
            proxy = getattr(worker, attribute)
            proxy._bound = {**proxy._bound, **operations}

    def close(self) -> None:
        if self in _open:
            _open.remove(self)
        self._end.close()
        self._writer.close()
        if self._writer.error:
            log.error("%s", self._writer.error)
        else:
            log.info("diary: %s", self._writer.path)

    def write(self, kind: str, turn: int, call: str = "", data: bytes | None = NO_DATA, **more: Any) -> None:
        if turn == _NO_TURN:
            self.leave_out("threads of its own")
        else:
            self._writer.write(kind, turn, call, data, **more)

    def leave_out(self, what: str) -> None:
        """Something cannot be run again."""
        if what not in self._told:
            self._told.add(what)
            self._writer.write("left out", _NO_TURN, what=what)

    # What calls the code.

    def _turn(
        self,
        name: str,
        method: Callable[..., Any],
        operation: Operation[Any] | None = None,
        taken: Callable[[tuple[Any, ...]], dict[str, Any]] | None = None,
    ) -> Callable[..., Any]:
        """A method that notes its calls: those by messages of an operation, or those whose arguments `taken` tells."""
        write, turns = self._writer.write, self._turns
        request = coding.encoder(operation.request) if operation else None
        result = coding.result_of(operation) if operation else None

        @functools.wraps(method)
        def run(*arguments: Any) -> Any:
            if here.read is not None:  # the component calls a method of its own
                return method(*arguments)
            turn = next(turns)
            if taken is not None:
                write("turn", turn, name, **taken(arguments))
            else:
                write("turn", turn, name, request(arguments) if request else NO_DATA)
            here.read = _Reading(self, turn)
            try:
                value = method(*arguments)
            except BaseException as exc:
                here.read = None
                write("end", turn, error=coding.error_of(exc))
                raise
            finally:
                here.read = None
            write("end", turn, "", result(value) if result else NO_DATA)
            return value

        return run

    def read(self, turn: int, what: str, original: Callable[[], Any]) -> Any:
        value = original()
        self.write("read", turn, what=what, value=value)
        return value

    def _reading(self, what: str, original: Callable[[], Any]) -> Callable[[], Any]:
        def read() -> Any:
            return original() if here.read is None else here.read(what, original)

        return read

    def _sleeping(self, sleep: Callable[[float], bool]) -> Callable[[float], bool]:
        def slept(seconds: float) -> bool:
            turn = turn_here()
            self.write("wait", turn, what="sleep", value=seconds)
            with outside():
                value = sleep(seconds)
            self.write("back", turn, value=value)
            return value

        return slept

    def _asking(self, after: Callable[..., Any]) -> Callable[..., Any]:
        def asked(seconds: float, function: Callable[[], object]) -> Any:
            number = next(self._later)
            handle = after(seconds, self._turn(f"after {number}", function))
            self.write("after", turn_here(), number=number, value=seconds)
            return handle

        return asked


class _Reading:
    """Set while code of a component runs on this thread."""

    __slots__ = ("_note", "turn")

    def __init__(self, note: Note, turn: int) -> None:
        self._note, self.turn = note, turn

    def __call__(self, what: str, original: Callable[[], Any]) -> Any:
        return self._note.read(self.turn, what, original)


def turn_here() -> int:
    """The turn that this thread runs; 0 if none."""
    return here.read.turn if isinstance(here.read, _Reading) else _NO_TURN


@contextlib.contextmanager
def outside() -> Iterator[None]:
    """The framework runs on this thread, in the middle of a turn."""
    before, here.read = here.read, None
    try:
        yield
    finally:
        here.read = before


def _changes(worker: Worker[Any]) -> Callable[[tuple[Any, ...]], dict[str, Any]]:
    return lambda arguments: {"values": [sorted(arguments[0])], "params": dataclasses.asdict(worker.params)}


# What the code calls.


class _Out:
    """An operation of a proxy. What is not noted is passed on."""

    def __init__(self, note: Note, name: str, operation: Operation[Any], inner: Any) -> None:
        self._note, self._name, self._operation, self._inner = note, name, operation, inner
        self._request, self._result = coding.request_of(operation), coding.result_of(operation)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


class _Send(_Out):
    def send(self, arguments: tuple[Any, ...], *more: Any, **named: Any) -> None:
        before, data = here.read, self._request(arguments)
        turn = before.turn if isinstance(before, _Reading) else _NO_TURN
        here.read = None  # the framework runs, in the middle of a turn
        try:
            self._inner.send(arguments, *more, **named)
        except BaseException as exc:
            self._note.write("out", turn, self._name, data, error=coding.error_of(exc))
            raise
        finally:
            here.read = before
        self._note.write("out", turn, self._name, data)


class _Query(_Out):
    def ask(self, arguments: tuple[Any, ...], deadline: float | None) -> Any:
        before = here.read
        turn = before.turn if isinstance(before, _Reading) else _NO_TURN
        self._note.write("out", turn, self._name, self._request(arguments))
        here.read = None  # the framework runs, in the middle of a turn
        try:
            value = self._inner.ask(arguments, deadline)
        except BaseException as exc:
            self._note.write("back", turn, error=coding.error_of(exc, self._operation))
            raise
        finally:
            here.read = before
        self._note.write("back", turn, "", self._result(value))
        return value

    def ask_async(self, arguments: tuple[Any, ...], deadline: float | None) -> Any:
        self._note.leave_out("asynchronous calls")
        with outside():
            return self._inner.ask_async(arguments, deadline)
