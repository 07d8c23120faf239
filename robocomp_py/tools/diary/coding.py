"""Values of a component as the octets of a diary, and back. Pure."""

from __future__ import annotations

import base64
import builtins
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any

from ... import errors
from ...contract.component import Component, Port
from ...contract.interface import Operation, Pattern
from ...contract.types import ExceptionType, Struct, thrown
from ...errors import DeclaredError, EncodeError, RemoteFailure
from ...runtime.worker import HOOKS
from ...wire.cdr import Cdr
from ...wire.codec import Decoder, Encoder

_CODEC = Cdr()

PARAMS, WATCHING = "paramsChanged", ("on_deadline_missed", "on_liveliness_lost")
"""Hooks with arguments."""


@lru_cache(maxsize=1024)
def encoder(message: Struct) -> Encoder:
    return _CODEC.encoder(message)


@lru_cache(maxsize=1024)
def decoder(message: Struct) -> Decoder:
    return _CODEC.decoder(message)


def encoded(message: Struct, values: tuple[Any, ...]) -> bytes:
    """Raises EncodeError."""
    data: bytes = encoder(message)(values)
    return data


def decoded(message: Struct, data: Any) -> tuple[Any, ...]:
    """Raises ValueError."""
    if not isinstance(data, bytes):
        raise ValueError("there is no data")
    return decoder(message)(data)


def handlers(component: Component) -> dict[str, Operation[Any]]:
    """The methods that messages call, one at a time."""
    return {port.handler(operation.name): operation for port, operation in component.handlers() if not port.concurrent}


def hooks(component: Component) -> list[str]:
    """The methods that the framework calls without arguments."""
    machine = component.machine.methods() if component.machine else ()
    return [*HOOKS, *(each.method for each in component.timers), *machine]


def outs(component: Component) -> Iterator[tuple[Port, Operation[Any], Pattern, str]]:
    """What the component calls and publishes, each with its name in a diary: `laser.getLaserData`."""
    for port in component.ports:
        if port.verb.has_proxy and port.attribute:
            for operation, pattern in port.interface.under(port.verb):
                yield port, operation, pattern, f"{port.attribute.removesuffix('_proxy')}.{operation.name}"


def left_out(component: Component, *, reads_caller: bool) -> list[str]:
    """What of a component cannot be run again, for people."""
    found = [f"handlers of {each.label}, which is concurrent" for each in component.ports if each.concurrent]
    if component.has_actions:
        found.append("actions")
    if component.named:
        found.append("named instances")
    if reads_caller:
        found.append("`self.caller`")
    return found


def request_of(operation: Operation[Any]) -> Callable[[tuple[Any, ...]], bytes | None]:
    """A function from the arguments of a call to their octets; None if they do not fit: then the proxy raises, too."""
    encode = encoder(operation.request)

    def request(arguments: tuple[Any, ...]) -> bytes | None:
        try:
            data: bytes = encode(arguments)
        except EncodeError:
            return None
        return data

    return request


def result_of(operation: Operation[Any]) -> Callable[[Any], bytes | None]:
    """A function from what a handler or a call returns to its octets; None if the value does not fit."""
    outputs, encode = len(operation.outputs), encoder(operation.response)

    def result(value: Any) -> bytes | None:
        try:
            data: bytes = encode((value,) if outputs == 1 else () if outputs == 0 else value)
        except (EncodeError, TypeError):
            return None
        return data

    return result


def value_of(operation: Operation[Any], text: Any) -> Any:
    """What a call returns. Raises ValueError."""
    values = decoded(operation.response, text)
    return values if len(values) > 1 else values[0] if values else None


def error_of(exc: BaseException, operation: Operation[Any] | None = None) -> dict[str, Any]:
    """An exception as JSON; `data` is CDR in base64, since this is a part of the line."""
    told: dict[str, Any] = {"kind": type(exc).__name__, "text": str(exc)}
    kind = _declared(operation).get(told["kind"]) if operation else None
    if kind and isinstance(exc, DeclaredError):
        data = encoded(_fields(kind), tuple(getattr(exc, each.attribute) for each in kind.all_fields))
        told["data"] = base64.b64encode(data).decode("ascii")
    elif isinstance(exc, RemoteFailure):
        told["remote"] = [exc.operation, exc.kind, exc.reason, exc.trace]
    return told


def exception_of(told: dict[str, Any], operation: Operation[Any]) -> Exception:
    """An exception that a call has raised. Raises ValueError."""
    name, text = told["kind"], told["text"]
    if "data" in told:
        kind = _declared(operation)[name]
        assert kind.python is not None
        made: Exception = kind.python(*decoded(_fields(kind), base64.b64decode(told["data"], validate=True)))
        return made
    if "remote" in told:
        return RemoteFailure(*map(str, told["remote"]))
    found = getattr(errors, name, None) or getattr(builtins, name, None)
    if isinstance(found, type) and issubclass(found, Exception):
        return found(text)
    return RuntimeError(f"{name}: {text}")


def _declared(operation: Operation[Any]) -> dict[str, ExceptionType]:
    found = {}
    waiting = [each for each in operation.raises if each.python]
    while waiting:
        kind = waiting.pop()
        assert kind.python is not None
        found[kind.python.__name__] = kind
        below = (each.__dict__.get("__contract__") for each in kind.python.__subclasses__())
        waiting += [each for each in below if isinstance(each, ExceptionType)]
    return found


def _fields(kind: ExceptionType) -> Struct:
    return Struct(kind.name, thrown(kind).fields[1:])
