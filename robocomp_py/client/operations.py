"""Operations of a running network: queries and commands that are called, topics that are heard and published."""

from __future__ import annotations

import html
import inspect
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from ..contract.interface import Operation, Pattern
from ..contract.qos import DEFAULT_QOS, QoS
from ..contract.types import Field, walk
from ..errors import ContractMismatch, RobocompError, Timeout, Unreachable
from ..runtime.calls import Call
from ..threads import fulfil
from ..tools import far
from ..tools.idsl import declared
from ..tools.network import Channel
from ..tools.publishing import publish
from ..transports import base
from ..transports.base import Caller, Outlet, Transport
from .arguments import arguments, example
from .channels import transport_channel
from .elsewhere import FarAsking
from .values import record_of

if TYPE_CHECKING:
    from .hearing import Hearing, Listening
    from .session import Session


class Described:
    """Base of what is called with the inputs of an operation, by position or by name."""

    def __init__(self, session: Session, channel: Channel) -> None:
        self._session, self._channel = session, channel
        self.__doc__ = "\n".join(self._taught())

    @cached_property
    def _operation(self) -> Operation[Any]:
        """With Python classes. Raises NotUnderstood."""
        return self._session.types.operation(self._channel.operation)

    @property
    def _inputs(self) -> Sequence[Field]:
        return self._operation.inputs

    @property
    def types(self) -> dict[str, Any]:
        """The classes of its structs and enumerations by their names, to make arguments: `types["Place"](x=1.0)`."""
        kinds = walk(*(each.type for each in (*self._operation.inputs, *self._operation.outputs)))
        return {each.name.rpartition("::")[2]: each.python for each in kinds if each.python}

    @property
    def __signature__(self) -> inspect.Signature:
        """For `help` and for notebooks. Names that are no words of Python are left out."""
        kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
        return inspect.Signature([inspect.Parameter(each.attribute, kind) for each in self._inputs])

    def _renew(self) -> bool:
        """Whether another program, with another contract or over another middleware, now provides the channel."""
        now = self._session.census().channels.get(self._channel.name)
        if now is None or _provided(now) == _provided(self._channel):
            return False
        self._channel = now
        for each in ("_operation", "_asking", "_sending", "_hearing", "_addressed"):
            self.__dict__.pop(each, None)
        return True

    if not TYPE_CHECKING:  # mypy is to complain about unknown attributes

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_"):  # notebooks ask for many of these
                raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
            what, *_, use = self._taught()
            raise AttributeError(f"{what}, which has no `{name}`; {use}")

    @property
    def _title(self) -> str:
        """What messages call it."""
        return self._channel.name

    def __repr__(self) -> str:
        return "\n".join(self._taught())

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(repr(self))}</pre>"

    def _taught(self) -> Iterator[str]:
        """What it is, and how it is used."""
        pattern = self._channel.pattern
        yield f"{self._channel.name}: {'topic' if pattern is Pattern.PUBLISH else pattern}"
        yield from (f"  {line}" for line in declared(self._channel.operation))
        yield f"use: {self._use()}"

    def _use(self) -> str:
        return f"…{self._operation.name}({self._example()})"

    def _example(self) -> str:
        return example(self._inputs)

    def _arguments(self, values: Sequence[Any], named: Mapping[str, Any]) -> tuple[Any, ...]:
        return arguments(self._title, self._inputs, values, named, also=("deadline",))

    def _deadline(self, named: dict[str, Any]) -> float:
        """Takes `deadline` out of the arguments, unless the operation itself has one."""
        if "deadline" in named and not any(each.name == "deadline" for each in self._inputs):
            limit = float(named.pop("deadline"))
            if not limit > 0:
                raise ValueError(f"{self._title}: deadline={limit} must be a positive number of seconds")
            return limit
        return self._session.timeout


def _provided(channel: Channel) -> tuple[Any, ...]:
    ways = channel.each_way() if channel.pattern is Pattern.PUBLISH else [channel]
    return tuple((each.via, each.middlewares[0], next(iter(each.texts))) for each in ways)


class Query(Described):
    """A query: called like a function, it returns the result. `deadline=` limits one call, in seconds.

    It raises the exceptions that it declares, and what calls of components raise; TypeError for wrong arguments.
    """

    def __call__(self, *values: Any, **named: Any) -> Any:
        limit = self._deadline(named)
        try:
            return self._asking.ask(self._arguments(values, named), limit)
        except (Unreachable, ContractMismatch):  # it was not executed
            if not self._renew():
                raise
        return self._asking.ask(self._arguments(values, named), limit)

    @cached_property
    def _asking(self) -> Asking | FarAsking:
        return asking(self._session, self._channel, self._operation)


def asking(session: Session, channel: Channel, operation: Operation[Any]) -> Asking | FarAsking:
    """A query that is connected to its server, on whatever host that is."""
    return FarAsking(channel, operation) if channel.via else Asking(session, channel, operation)


class Asking:
    """A query that is connected to its server."""

    def __init__(self, session: Session, channel: Channel, operation: Operation[Any]) -> None:
        self._transport = session.transport(channel)
        self._call: Call[Any] = Call(operation, self._transport.codec)
        path = transport_channel(channel, operation)
        self._caller: Caller = session.opened(lambda: self._transport.caller(path), lambda made: made.close())
        self._outputs = record_of(operation)

    def ask(self, arguments: tuple[Any, ...], deadline: float | None) -> Any:
        limit = DEADLINE if deadline is None else deadline
        payload = self._call.encode(arguments)
        self._caller.wait_peer(limit)
        return self._result(self._caller.ask(payload, limit))

    def ask_async(self, arguments: tuple[Any, ...], deadline: float | None) -> Future[Any]:
        answer: Future[Any] = Future()
        made = self._caller.call(self._call.encode(arguments), DEADLINE if deadline is None else deadline)
        made.add_done_callback(lambda reply: fulfil(answer, lambda: self._result(reply.result(0))))
        return answer

    def _result(self, reply: base.Reply) -> Any:
        value = self._call.result(reply)
        return self._outputs(*value) if self._outputs else value


DEADLINE = 5.0
"""Seconds for an answer, where the caller does not set them."""


class Command(Described):
    """A command: called like a function, it returns when it is sent."""

    def __call__(self, *values: Any, **named: Any) -> None:
        limit = self._deadline(named)
        try:
            self._send(self._arguments(values, named), limit)
        except (Unreachable, ContractMismatch):  # it was not sent
            if not self._renew():
                raise
            self._send(self._arguments(values, named), limit)

    def _send(self, arguments: tuple[Any, ...], limit: float) -> None:
        if self._channel.via:
            far.asked(self._channel, arguments, limit)
            return
        outlet, call = self._sending
        payload = call.encode(arguments)
        outlet.wait_peer(limit)
        outlet.send(payload, limit)

    @cached_property
    def _sending(self) -> tuple[Outlet, Call[Any]]:
        return _sending(self._session, self._channel, self._operation, DEFAULT_QOS)


class Topic(Described):
    """A topic. `latest()` is its newest message; iterate over it to get all of them.

    A message of one field is that field; one of several fields has them as its attributes.
    """

    def __call__(self, *values: Any, **named: Any) -> None:
        raise TypeError(f"{self._channel.name} is a topic: it is heard by .latest() or `for`, and sent by .publish(…)")

    def latest(self, timeout: float | None = None, *, newer_than: float | None = None) -> Any:
        """The newest message. The first call subscribes, and waits for a message; Timeout if none comes in time.

        `newer_than` is how many seconds ago it may have arrived at most; with 0, this waits for the next one.
        """
        limit = self._session.timeout if timeout is None else timeout
        try:
            return self._heard().latest(limit, newer_than)
        except Timeout:
            self._renew()  # for the next call
            raise

    def listen(self, timeout: float | None = None, *, depth: int | None = None) -> Listening:
        """All messages from now on, as an iterator. At most `depth` wait (100), then the oldest ones are dropped.

        It ends when the connection is closed, and raises Timeout if no message comes for `timeout` seconds. Raises
        ValueError for a negative `timeout`.
        """
        return self._heard().listen(timeout, depth)

    def __iter__(self) -> Listening:
        return self.listen()

    def publish(self, *values: Any, **named: Any) -> None:
        """Publish a message under the name of this topic. The first call waits until its subscribers are connected.

        Raises Refused with the keys of an operator.
        """
        limit = self._deadline(named)
        arguments = self._arguments(values, named)
        self._session.check_publishing(self._addressed)
        if any(way.via for way in self._addressed.ways):
            try:
                publish(self._session.access, self._addressed, arguments, limit, keep=True)
            except RobocompError:
                del self._addressed
                raise
            return
        outlet, call = self._sending
        payload = call.encode(arguments)
        if not self._is_met:
            outlet.wait_peer(limit)
            self._is_met = base.wait_connected(outlet, limit)
        outlet.send(payload, limit)

    def plot(self, *fields: str, seconds: float = 5.0, axes: Any = None) -> Any:
        """Draw fields of its messages over the next `seconds`; returns matplotlib's axes.

        A field is a path, such as `battery.percentage` or `points[0].x`. Of a struct, and without a field, all numbers
        outside of sequences are drawn. An array, such as `points[*].x`, is drawn as it is in the newest message. Raises
        ConfigurationError without matplotlib (`pip install 'robocomp-py[plot]'`).
        """
        from .plotting import plot

        first = self._inputs[0].name if len(self._inputs) == 1 else ""
        return plot(self._channel.name, first, self.listen, fields, seconds, axes)

    _is_met = False

    @cached_property
    def _addressed(self) -> Channel:
        """The topic with the subscribers that there were at the first publication."""
        return self._session.census().channels.get(self._channel.name, self._channel)

    @cached_property
    def _sending(self) -> tuple[Outlet, Call[Any]]:
        return _sending(self._session, self._channel, self._operation, self._channel.qos)

    def _heard(self) -> Hearing:
        """The subscription; a further one if its host was lost since."""
        if self._hearing.error:
            del self._hearing
        return self._hearing

    @cached_property
    def _hearing(self) -> Hearing:
        from .hearing import Hearing

        return Hearing(self._session, self._channel)

    def _use(self) -> str:
        return f"….latest() · for message in …: · .plot(…) · .publish({self._example()})"


def _sending(session: Session, channel: Channel, operation: Operation[Any], qos: QoS) -> tuple[Outlet, Call[Any]]:
    transport: Transport = session.transport(channel)
    path = transport_channel(channel, operation, qos)
    outlet = session.opened(partial(transport.outlet, path), lambda made: made.close())
    return outlet, Call(operation, transport.codec)
