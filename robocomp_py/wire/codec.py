"""What a codec is, and what all of them share.

A codec compiles, once per message type, a function that encodes and one that decodes; at run time
nothing looks at types any more. A message's Python form is the tuple of its fields.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import is_dataclass
from typing import Any, Protocol

import numpy as np

from ..contract.types import (
    BOOL,
    FLOAT32,
    FLOAT32_MAX,
    FLOATS,
    INTEGERS,
    STRING,
    TIME,
    Dictionary,
    Enumeration,
    Primitive,
    Sequence,
    Struct,
    Type,
    integer_range,
    walk,
)
from ..errors import DecodeError, EncodeError

Payload = Any
"""What a codec makes of a message: buffers on every wire, the value itself in-process."""

Encoder = Callable[[tuple[Any, ...]], Payload]
Decoder = Callable[[Payload], tuple[Any, ...]]

MAX_BYTES = 256 * 1024 * 1024
"""A message of more bytes is refused by both sides."""

TIME_MIN, TIME_MAX = -(2**31) * 10**9, 2**31 * 10**9 - 1
"""The instants that fit: ROS 2's range, int32 seconds around 1970."""


class Codec(Protocol):
    """Values to payloads and back. Knows types, never transports."""

    @property
    def name(self) -> str: ...

    def encoder(self, message: Struct) -> Encoder:
        """A function from the message's fields to a payload. It raises EncodeError, naming the field."""
        ...

    def decoder(self, message: Struct, *, prefix: bool = False) -> Decoder:
        """A function from a payload to the message's fields. It raises DecodeError, whatever is wrong.

        With `prefix`, whatever follows the last field is ignored.
        """
        ...


class Program:
    """Python source in the making, and the objects it refers to."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._names: dict[str, Any] = {}
        self._known: dict[int, str] = {}
        self._depth = 0
        self._count = 0

    def line(self, text: str) -> None:
        self._lines.append("    " * self._depth + text)

    def indent(self) -> None:
        self._depth += 1

    def dedent(self) -> None:
        self._depth -= 1

    def fresh(self, stem: str = "v") -> str:
        """A variable name not used before."""
        self._count += 1
        return f"{stem}{self._count}"

    def name(self, thing: Any, stem: str = "g") -> str:
        """The global name by which the program knows this object."""
        key = id(thing)
        if key not in self._known:
            self._known[key] = self.fresh(f"_{stem}")
            self._names[self._known[key]] = thing
        return self._known[key]

    def compile(self, function: str) -> Callable[..., Any]:
        source = "\n".join(self._lines)
        scope: dict[str, Any] = dict(self._names)
        exec(
            compile(source, f"<robocomp_py codec: {function}>", "exec"), scope
        )  # text from contracts, identifiers only
        compiled: Callable[..., Any] = scope[function]
        return compiled


def structs_in(message: Struct) -> list[Struct]:
    """The structs inside a message, each once, those used before those that use them."""
    return [kind for kind in walk(*(f.type for f in message.fields)) if isinstance(kind, Struct)]


def guard_encoder(message: Struct, encode: Encoder) -> Encoder:
    """An encoder whose failures say which field holds what instead of what."""

    def checked(values: tuple[Any, ...]) -> Payload:
        try:
            return encode(values)
        except EncodeError:
            raise
        except Exception as exc:  # whatever the compiled code met; the reason is found by looking again, slowly
            raise EncodeError(explain(message, values) or f"{message.name}: {exc}") from exc

    return checked


def guard_decoder(message: Struct, decode: Decoder) -> Decoder:
    """A decoder that raises DecodeError, whatever the bytes held."""

    def checked(payload: Payload) -> tuple[Any, ...]:
        try:
            return decode(payload)
        except DecodeError:
            raise
        except Exception as exc:  # hostile bytes may raise anything; they must never raise anything else
            raise DecodeError(f"not a {message.name}: {type(exc).__name__}: {exc}") from exc

    return checked


def explain(message: Struct, values: Any) -> str | None:
    """The first field whose value does not fit its type, in words; None if all do."""
    if not isinstance(values, tuple) or len(values) != len(message.fields):
        return f"{message.name}: expected {len(message.fields)} values, got {_show(values)}"
    for field, value in zip(message.fields, values, strict=True):
        wrong = _explain(field.type, value, field.name)
        if wrong:
            return f"{message.name}: {wrong}"
    return None


def _explain(kind: Type, value: Any, at: str) -> str | None:
    match kind:
        case Struct(name=name, fields=fields, python=python):
            if any(not hasattr(value, f.attribute) for f in fields):
                expected = python.__name__ if python and is_dataclass(python) else name
                return f"{at} must be a {expected}, not {_show(value)}"
            inner = ((f.type, getattr(value, f.attribute), f"{at}.{f.name}") for f in fields)
            return next(filter(None, (_explain(*each) for each in inner)), None)
        case Sequence(item):
            if kind.dtype is not None:
                return _explain_array(kind.dtype, value, at)
            if isinstance(value, str | bytes | Mapping) or not hasattr(value, "__iter__"):
                return f"{at} must be a list, not {_show(value)}"
            items = ((item, v, f"{at}[{n}]") for n, v in enumerate(value))
            return next(filter(None, (_explain(*each) for each in items)), None)
        case Dictionary(key, item):
            if not isinstance(value, Mapping):
                return f"{at} must be a dict, not {_show(value)}"
            for k, v in value.items():
                wrong = _explain(key, k, f"key {k!r} of {at}") or _explain(item, v, f"{at}[{k!r}]")
                if wrong:
                    return wrong
            return None
        case Enumeration(name=name, members=members):
            good = isinstance(value, int) and int(value) in {number for _, number in members}
            return None if good else f"{at} must be a {name.rpartition('::')[2]}, not {_show(value)}"
        case Primitive():
            return None if _fits(kind, value) else f"{at} must be {_ARTICLES[kind]}, not {_show(value)}"


def _fits(kind: Primitive, value: Any) -> bool:
    if kind is BOOL:
        return isinstance(value, bool | np.bool_)
    if kind is STRING:
        return isinstance(value, str) and _encodable(value)
    if kind in FLOATS:
        number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        return number and (kind is not FLOAT32 or not (FLOAT32_MAX < abs(float(value)) < float("inf")))
    low, high = (TIME_MIN, TIME_MAX) if kind is TIME else integer_range(kind)
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and low <= int(value) <= high


def _encodable(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _explain_array(dtype: np.dtype[Any], value: Any, at: str) -> str | None:
    try:
        as_array(value, dtype)
    except (TypeError, ValueError, OverflowError) as exc:
        return f"{at} must be an array of {dtype.name}: {exc}"
    return None


_ARTICLES = {
    BOOL: "a bool",
    STRING: "a str that encodes to UTF-8",
    TIME: "an int, nanoseconds since 1970",
    **{kind: f"a float ({kind})" for kind in FLOATS},
    **{kind: f"an int from {integer_range(kind)[0]} to {integer_range(kind)[1]}" for kind in INTEGERS},
}


def _show(value: Any) -> str:
    text = repr(value)
    return f"{type(value).__name__} {text if len(text) <= 60 else text[:57] + '...'}"


def as_array(value: Any, dtype: np.dtype[Any]) -> np.ndarray[Any, np.dtype[Any]]:
    """A contiguous one-dimensional array of that dtype, from an array, list, bytes or buffer.

    Arrays of more dimensions are flattened in C order. Nothing is rounded or wrapped: a value
    that does not fit raises OverflowError, one of another kind TypeError.
    """
    if isinstance(value, np.ndarray) and value.dtype == dtype:
        return np.ascontiguousarray(value, dtype).reshape(-1)
    if isinstance(value, bytes | bytearray):
        if dtype.itemsize != 1 or dtype.kind == "b":
            raise TypeError(f"{type(value).__name__} is for sequences of bytes")
        return np.frombuffer(value, dtype)
    return _converted(value, dtype)


def _converted(value: Any, dtype: np.dtype[Any]) -> np.ndarray[Any, np.dtype[Any]]:
    if isinstance(value, str | Mapping):
        raise TypeError(f"{type(value).__name__} is not a sequence of numbers")
    given = np.asarray(value if hasattr(value, "__len__") or hasattr(value, "__array__") else list(value))
    if given.size == 0:
        return np.empty(0, dtype)
    if dtype.kind == "b" and given.dtype.kind != "b":
        raise TypeError(f"{given.dtype} is not bool")
    if dtype.kind in "iu":
        if given.dtype.kind not in "iu":
            raise TypeError(f"{given.dtype} is not an integer type")
        low, high = np.iinfo(dtype).min, np.iinfo(dtype).max
        if int(given.min()) < low or int(given.max()) > high:
            raise OverflowError(f"values from {given.min()} to {given.max()} exceed {low} to {high}")
    if dtype.kind == "f":
        if given.dtype.kind not in "iuf":
            raise TypeError(f"{given.dtype} is not a numeric type")
        with np.errstate(over="raise"):
            try:
                return np.ascontiguousarray(given, dtype).reshape(-1)
            except FloatingPointError as exc:
                raise OverflowError(f"values exceed {dtype}") from exc
    return np.ascontiguousarray(given, dtype).reshape(-1)


def view_of(data: Any, dtype: np.dtype[Any], count: int, offset: int) -> np.ndarray[Any, Any]:
    """A read-only array over received bytes, without a copy; it keeps the bytes alive.

    Raises ValueError if there are not so many, or if a bool is neither 0 nor 1.
    """
    if not count:
        return read_only(np.empty(0, dtype))
    if dtype.kind == "b" and np.frombuffer(data, np.uint8, count, offset).max() > 1:
        raise ValueError("a bool is neither 0 nor 1")
    return read_only(np.frombuffer(data, dtype, count, offset))


def read_only(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    array.flags.writeable = False
    return array
