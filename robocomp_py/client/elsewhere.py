"""Queries and topics of other hosts, through their scouts."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import AbstractContextManager
from functools import partial
from typing import Any

from ..contract.interface import Operation
from ..contract.types import Field
from ..errors import DeclaredError, RobocompError
from ..threads import NO_THREAD, fulfil, start_thread
from ..tools import far
from ..tools.network import Channel
from ..tools.thrown import ThrownError
from ..wire import json
from .values import fitted, record_of

Taker = Callable[..., object]


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


def hearing(channel: Channel, operation: Operation[Any], take: Taker) -> AbstractContextManager[Any]:
    """While entered, `take` gets the inputs of each message of a topic of another host. Messages may be lost."""
    assert channel.via

    def heard(_: str, message: far.Message) -> None:
        try:
            values = json.taken(channel.operation.inputs, message.message, channel.name)
        except json.Unfit:
            return  # it was too long to be sent
        take(*_fitted(operation.inputs, values))

    return far.Far(heard, lambda number: None).following(channel.via, [channel])


def _fitted(fields: tuple[Field, ...], values: Any) -> tuple[Any, ...]:
    return tuple(fitted(each.type, value, each.name) for each, value in zip(fields, values, strict=True))
