"""Operations on top of payloads: arguments, results, declared exceptions.

Pure: no threads, no sockets, no clock. Outcomes are the same over every transport, because they are made here.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import Any, Generic, NoReturn, TypeVar

from ..contract.interface import Operation, Pattern
from ..contract.types import LINEAGE, STRING, ExceptionType, Field, Struct, thrown
from ..errors import (
    ArgumentError,
    Busy,
    Closed,
    ConfigurationError,
    ContractMismatch,
    DeclaredError,
    EncodeError,
    RemoteFailure,
    Timeout,
    Unreachable,
)
from ..transports.base import Reply, Status, TypeRef, answered
from ..transports.sparing import Repeats
from ..wire.codec import Codec, Decoder, Encoder, Payload
from .tally import NoteFailure
from .trace import times_more, user_trace, way_of

log = logging.getLogger("robocomp.worker")

R = TypeVar("R")

_FAILURE = Struct("Failure", (Field("type", STRING), Field("message", STRING), Field("traceback", STRING)))
_THROWN = thrown()

_OK = Status.OK
"""A global name is found in a fifth of the time that a member of an enumeration takes."""


def type_of(operation: Operation[Any], pattern: Pattern) -> TypeRef:
    """The message types of an operation, as a transport sees them."""
    response = operation.response if pattern is Pattern.QUERY else None
    return TypeRef(operation.request.name, operation.fingerprint, operation.text, operation.request, response)


class Outcome(Exception):
    """Raised by a handler to end the call with this reply. Fakes use it to simulate the outcomes of a transport."""

    def __init__(self, reply: Reply) -> None:
        super().__init__(reply.status)
        self.reply = reply


class Call(Generic[R]):
    """The client side of one operation over one codec. What is sent one way has no result."""

    def __init__(self, operation: Operation[R], codec: Codec, *, one_way: bool = False) -> None:
        self.operation = operation
        # No snapshot: a request is sent before its caller continues and can change the arguments. Replies may go later.
        self.encode: Callable[[tuple[Any, ...]], Payload] = codec.encoder(operation.request, snapshot=False)
        self.codec = codec
        self._decode = _no_result if one_way else codec.decoder(operation.response)
        self._outputs = len(operation.outputs)

    def result(self, reply: Reply) -> R:
        """The return value of the operation, as Python code expects it. Raises the exception that the reply holds."""
        return self.value(reply.payload) if reply.status is _OK else self._raise(reply)

    def value(self, payload: Payload) -> R:
        """The return value in the payload of a reply that is OK."""
        values = self._decode(payload)
        value: Any = values if self._outputs > 1 else values[0] if self._outputs else None
        return value  # type: ignore[no-any-return]  # the wire's value is checked against the contract, not by mypy

    def _raise(self, reply: Reply) -> NoReturn:
        name = self.operation.called
        match reply.status:
            case Status.THROWN:
                raise self._thrown(name, reply.payload)
            case Status.FAILED:
                kind, reason, trace = ("", "no reason given", "")
                if reply.payload:  # empty if the service itself failed
                    kind, reason, trace = _decoder(self.codec, _FAILURE)(reply.payload)
                raise RemoteFailure(name, kind, reason, trace)
            case Status.EXPIRED:
                raise Timeout(f"{name}: the deadline passed before the server could execute the call")
            case Status.BUSY:
                raise Busy(f"{name}: too many calls are waiting at the server")
            case Status.REFUSED:
                raise Unreachable(f"{name}: its server left")
            case Status.MISMATCH:
                raise ContractMismatch(f"{name}: the server was generated from another definition of the operation")
            case Status.OK:
                raise AssertionError("not an error")

    def _thrown(self, name: str, payload: Payload) -> DeclaredError | RemoteFailure:
        (lineage,) = _decoder(self.codec, _THROWN)(payload)
        known = {each.name: each for declared in self.operation.raises for each in _family(declared)}
        for thrown_as in lineage.split(LINEAGE):
            if thrown_as in known:
                kind = known[thrown_as]
                _, *fields = _decoder(self.codec, thrown(kind))(payload)
                assert kind.python is not None
                exception: DeclaredError = kind.python(*fields)
                return exception
        return RemoteFailure(name, lineage.split(LINEAGE)[0], "the operation does not declare this exception")


class Handler:
    """The server side of one operation over one codec: decodes, calls the worker's method, encodes the reply."""

    def __init__(
        self,
        operation: Operation[Any],
        codec: Codec,
        method: Callable[..., Any],
        note: NoteFailure | None = None,
    ) -> None:
        """`note` gets each exception that is logged as an error, also those too frequent to be logged."""
        self.operation, self.method = operation, method
        self._codec, self._note = codec, note
        self._outputs = len(operation.outputs)
        self._declared = tuple(each.python for each in operation.raises if each.python)
        self._repeats = Repeats()

    @cached_property
    def decode(self) -> Decoder:
        return self._codec.decoder(self.operation.request)

    @cached_property
    def _encode(self) -> Encoder:
        return self._codec.encoder(self.operation.response)

    def compile(self) -> None:
        """Compile the codec now, so that the first message takes no longer than later ones."""
        _ = self.decode, self._encode

    def answer(self, arguments: tuple[Any, ...]) -> Reply:
        """Call the method and encode its result. Never raises: every outcome becomes a Reply."""
        try:
            value = self.method(*arguments)
        except self._declared as exc:
            return self._thrown(exc)
        except Outcome as exc:
            return exc.reply
        except Closed:
            return Reply(Status.REFUSED)  # the component is stopping: the handler used a link that is closed
        except (Exception, SystemExit) as exc:
            self.log_failure(exc)
            return self.failed(exc)
        try:
            values = (value,) if self._outputs == 1 else self._values(value)
            return answered((_OK, self._encode(values)))
        except EncodeError as exc:
            log.error("%s returned a value that its interface does not allow: %s", self.method.__qualname__, exc)
            self._note_failure(exc)
            return self.failed(exc)

    def take(self, arguments: tuple[Any, ...]) -> bool:
        """Call the method for a one-way message, and return whether it raised nothing. Never raises."""
        try:
            self.method(*arguments)
        except Closed:
            return False
        except (Exception, SystemExit) as exc:
            self.log_failure(exc)
            return False
        return True

    def log_failure(self, exc: BaseException) -> None:
        """Log an exception of the method. Repeated exceptions from the same lines are logged less and less often."""
        is_callers = isinstance(exc, (ArgumentError, ConfigurationError))
        if not is_callers:
            self._note_failure(exc)
        untold = self._repeats.untold(way_of(exc))
        if untold is None:
            return
        more = times_more(untold)
        if isinstance(exc, SystemExit):
            log.error("%s called sys.exit(): call self.stop() to stop the component%s", self.method.__qualname__, more)
        elif is_callers:
            log.warning("%s refused: %s%s", self.method.__qualname__, exc, more)
        else:
            kind = type(exc).__name__
            log.error("%s raised %s\n%s%s", self.method.__qualname__, kind, user_trace(exc), more)

    def _note_failure(self, exc: BaseException) -> None:
        if self._note:
            self._note(self.method.__qualname__, exc)

    def failed(self, exc: BaseException) -> Reply:
        values = (type(exc).__name__, str(exc), user_trace(exc))
        safe = tuple(text.encode(errors="backslashreplace").decode() for text in values)
        return Reply(Status.FAILED, _encoder(self._codec, _FAILURE)(safe))

    def _values(self, value: Any) -> tuple[Any, ...]:
        """The return value as a tuple, for operations with no output or several."""
        if self._outputs == 0:
            if value is not None:
                raise EncodeError(f"{self.method.__qualname__} must return None, not {type(value).__name__}")
            return ()
        if not isinstance(value, tuple) or len(value) != self._outputs:
            names = ", ".join(field.name for field in self.operation.outputs)
            raise EncodeError(f"{self.method.__qualname__} must return a tuple ({names}), not {type(value).__name__}")
        return value

    def _thrown(self, exc: BaseException) -> Reply:
        kind = next(kind for kind in map(_contract_of, type(exc).__mro__) if kind)
        try:
            fields = tuple(getattr(exc, field.attribute) for field in kind.all_fields)
            payload = _encoder(self._codec, thrown(kind))((LINEAGE.join(kind.lineage), *fields))
        except (AttributeError, EncodeError) as wrong:  # a derived class may not set every field
            log.error("%s raised %s with wrong fields: %s", self.method.__qualname__, type(exc).__name__, wrong)
            self._note_failure(wrong)
            return self.failed(wrong)
        return Reply(Status.THROWN, payload)


# Codecs of failures are compiled when first used and cached, since some calls fail every time.


def _no_result(_: Payload) -> NoReturn:
    raise TypeError("what is sent one way has no result")


@lru_cache(maxsize=1024)
def _encoder(codec: Codec, message: Struct) -> Encoder:
    return codec.encoder(message)


@lru_cache(maxsize=1024)
def _decoder(codec: Codec, message: Struct) -> Decoder:
    """A decoder that ignores trailing bytes: the exception may be of a derived type with more fields."""
    return codec.decoder(message, prefix=True)


def _family(declared: ExceptionType) -> list[ExceptionType]:
    """A declared exception and all exceptions derived from it that this process knows."""
    family = [declared]
    for derived in declared.python.__subclasses__() if declared.python else ():
        known = _contract_of(derived)
        if known:
            family += _family(known)
    return family


def _contract_of(exception: type) -> ExceptionType | None:
    """The contract type of a generated exception class; None for any other class, subclasses of these included."""
    contract = exception.__dict__.get("__contract__")
    return contract if isinstance(contract, ExceptionType) else None
