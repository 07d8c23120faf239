"""How calls and log records of components are written into a recording. Pure.

    /wander/GotoPoint/go/calls   robocomp_goto_point/msg/GotoPointGoCall: info, request[], response[]
    /rosout                      rcl_interfaces/msg/Log, as ROS 2 writes it

`request` and `response` have one item; `response` has none for commands and calls that failed. `info` names the caller,
over which middleware, when, for how long, and how it ended. The metadata of a channel of calls also has

    calls                  `query` or `command`
    called                 the contract of the operation that was called
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, ClassVar

from ...contract.interface import Operation, Pattern
from ...contract.types import FLOAT64, STRING, TIME, UINT8, UINT32, Field, Struct
from ...contract.types import Sequence as Items
from ...wire.cdr import Cdr
from ...wire.codec import Decoder, Encoder
from ...wire.schema import ENCODINGS, Schema
from .layout import Topic

INFO = Struct(
    "RoboCompIntrospection::CallInfo",
    (
        Field("caller", STRING),
        Field("middleware", STRING),
        Field("begun", TIME),
        Field("took", FLOAT64),
        Field("status", STRING),
        Field("error", STRING),
    ),
)
"""What is told of a call beside its messages; `took` is in s, and `status` one of those in Introspection.idsl."""

CALLS = "/calls"
"""What follows the name of a channel in the name of the topic of its calls."""

LOGS = "rosout"
"""The name of the topic of log records."""

_LOG = (
    Field("stamp", TIME),
    Field("level", UINT8),
    Field("name", STRING),
    Field("msg", STRING),
    Field("file", STRING),
    Field("function", STRING),
    Field("line", UINT32),
)
_LOGGED: Operation[None] = Operation("rcl_interfaces::Log", "logged", _LOG)

LEVELS = {"DEBUG": 10, "INFO": 20, "WARNING": 30, "ERROR": 40, "CRITICAL": 50}
"""Levels of ROS 2 by those of Python."""


def calls_of(operation: Operation[Any]) -> Operation[None]:
    """The operation whose messages are calls of another one."""
    return Operation(
        operation.interface,
        f"{operation.name}_call",
        (
            Field("info", INFO),
            Field("request", Items(Struct(operation.request.name, operation.inputs))),
            Field("response", Items(Struct(operation.response.name, operation.outputs))),
        ),
    )


def calls_topic(name: str, operation: Operation[Any], pattern: Pattern, owner: str, middleware: str) -> Calls:
    """The topic of the calls of a channel; `owner` serves it."""
    return Calls(f"{name}{CALLS}", calls_of(operation), owner, middleware, called=operation, calls=pattern)


@dataclass(frozen=True)
class Calls(Topic):
    """The calls of a query or a command."""

    called: Operation[Any] = field(kw_only=True)
    calls: Pattern = field(kw_only=True)

    @property
    def metadata(self) -> dict[str, str]:
        return {**super().metadata, "calls": str(self.calls), "called": self.called.text}


@dataclass(frozen=True)
class Logs(Topic):
    """The log records of all components."""

    _NAMED: ClassVar[Operation[None]] = Operation("rcl_interfaces::Log", "", _LOG)

    def schema(self, encoding: str) -> Schema:
        return ENCODINGS[encoding](self._NAMED)  # no operation, so that its name is that of ROS 2


def logs_topic() -> Logs:
    return Logs(LOGS, _LOGGED)


@lru_cache(maxsize=256)
def _encoder(message: Struct) -> Encoder:
    return Cdr().encoder(message)


@lru_cache(maxsize=256)
def _decoder(message: Struct) -> Decoder:
    return Cdr().decoder(message)


def info_octets(
    caller: str, middleware: str, begun: int, took: float, status: str, error: str
) -> bytes:  # in the order of `INFO`
    octets: bytes = _encoder(INFO)((caller, middleware, begun, took, status, error))
    return octets


def joined(operation: Operation[Any]) -> Callable[[Sequence[Any]], bytes]:
    """A function that makes a message of `calls_of(operation)` of the octets of its info, request and response.

    It may raise DecodeError and EncodeError. A response of no octets is none.
    """
    encode, info = _encoder(calls_of(operation).request), _decoder(INFO)
    request, response = _decoder(operation.request), _decoder(operation.response)

    def join(octets: Sequence[Any]) -> bytes:
        about, asked, answered = octets
        replies = [response(answered)] if len(answered) else []
        message: bytes = encode((info(about), [request(asked)], replies))
        return message

    return join


def log_octets(component: str, told: dict[str, Any]) -> bytes:
    """A message of `logs_topic` of a record as `Record` of Introspection.idsl has it. May raise EncodeError."""
    logger, trace = str(told["logger"]), str(told["trace"])
    own = component.rpartition("/")[2]
    name = component if logger in ("", own) else f"{component}.{logger}"
    text = f"{told['text']} (trace {trace})" if trace else told["text"]
    level = LEVELS.get(str(told["level"]).upper(), LEVELS["INFO"])
    line = max(0, int(told["line"]))
    octets: bytes = _encoder(_LOGGED.request)((told["at"], level, name, text, told["file"], "", line))
    return octets
