"""Queries of other hosts, through their scouts."""

from __future__ import annotations

import threading
from concurrent.futures import Future
from functools import partial
from typing import Any

from ..contract.interface import Operation
from ..contract.types import Field
from ..errors import DeclaredError, RobocompError
from ..threads import NO_THREAD, fulfil, start_thread
from ..tools import far
from ..tools.network import Channel
from ..tools.thrown import ThrownError
from .values import fitted, record_of


class FarAsking:
    """A query of another host. It is used as `operations.Asking`."""

    def __init__(self, channel: Channel, operation: Operation[Any]) -> None:
        self._channel, self._operation = channel, operation
        self._outputs = record_of(operation)

    def ask(self, arguments: tuple[Any, ...], deadline: float) -> Any:
        try:
            outputs = far.asked(self._channel, arguments, deadline)
        except ThrownError as exc:
            raise self._declared(exc) from None
        values = _fitted(self._operation.outputs, outputs)
        return self._outputs(*values) if self._outputs else values[0] if values else None

    def ask_async(self, arguments: tuple[Any, ...], deadline: float) -> Future[Any]:
        answer: Future[Any] = Future()
        name = self._channel.name
        job = answer, partial(self.ask, arguments, deadline)
        if not start_thread(threading.Thread(target=fulfil, args=job, name=f"call of {name}")):
            raise RobocompError(f"{name}: {NO_THREAD}")
        return answer

    def _declared(self, thrown: ThrownError) -> DeclaredError:
        """The exception of the class that `except` clauses name."""
        kind = next(each for each in self._operation.raises if each.name == thrown.kind.name)
        made: Any = kind.python
        error: DeclaredError = made(*_fitted(kind.fields, thrown.values[: len(kind.fields)]))
        return error


def _fitted(fields: tuple[Field, ...], values: Any) -> tuple[Any, ...]:
    return tuple(fitted(each.type, value, each.name) for each, value in zip(fields, values, strict=True))
