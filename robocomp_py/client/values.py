"""Python classes for the types that others announce.

A struct becomes a class with its fields as attributes, an enumeration an `IntEnum`, an exception a class that can be
caught. Equal types have one class per connection. Names come from outside and are used as data only: no class has a
method whose name a field could take, since fields with names of the form `__x__` are refused.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from enum import IntEnum
from typing import Any, ClassVar

import numpy as np

from ..contract.goal import NO_RESULT
from ..contract.interface import Operation
from ..contract.types import (
    Dictionary,
    Enumeration,
    ExceptionType,
    Field,
    Primitive,
    Struct,
    Type,
    python_name,
)
from ..contract.types import Sequence as SequenceType
from ..errors import DeclaredError, EncodeError
from ..spelling import unknown
from ..tools.network import NotUnderstood

_SHOWN = 100
"""Characters that the text of one field may have."""

_MODULE = __name__.rpartition(".")[0]
"""Of the classes, as Python shows them: `robocomp_py.client.Home.Light`."""


class Record:
    """A value of a struct. Its fields are attributes, and items by their names in IDSL: `scan["lambda"]`.

    It can be unpacked (`x, y = place`), changed, and compared with equal types.
    """

    __slots__ = ()
    __contract__: ClassVar[Struct]

    def __init__(self, *values: Any, **named: Any) -> None:
        """Fields by position or by name; those that are absent are zero or empty. Raises TypeError."""
        fields = self.__contract__.fields
        given = dict(zip((each.attribute for each in fields), values, strict=False))
        if len(values) > len(fields):
            raise TypeError(f"{type(self).__name__} has {len(fields)} fields, not {len(values)}")
        for name, value in named.items():
            attribute = python_name(name)
            if attribute in given:
                raise TypeError(f"{type(self).__name__}: `{name}` is given twice")
            if not any(attribute == each.attribute for each in fields):
                raise TypeError(_no_field(type(self), name))
            given[attribute] = value
        for each in fields:
            setattr(self, each.attribute, given[each.attribute] if each.attribute in given else empty(each.type))

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(_no_field(type(self), name))

    def __getitem__(self, name: str) -> Any:
        if not any(name == each.name for each in self.__contract__.fields):
            raise KeyError(_no_field(type(self), name))
        return getattr(self, python_name(name))

    def __iter__(self) -> Iterator[Any]:
        return (getattr(self, each.attribute) for each in self.__contract__.fields)

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(itertools.starmap(_are_equal, zip(self, other, strict=True)))

    __hash__ = None  # type: ignore[assignment]  # it can be changed

    def __repr__(self) -> str:
        parts = (f"{each.attribute}={_shortened(getattr(self, each.attribute))}" for each in self.__contract__.fields)
        return f"{type(self).__name__}({', '.join(parts)})"


def _no_field(kind: type[Record], name: str) -> str:
    return f"{kind.__name__}: {unknown('field', name, [each.name for each in kind.__contract__.fields])}"


def _shortened(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.size > 6:
        ends = ", ".join(map(str, value[:3].tolist()))
        return f"<{value.size} {value.dtype.name}: {ends}, …>"
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


def _are_equal(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    return bool(one == other)


def empty(kind: Type) -> Any:
    """The value of a field that is not set."""
    match kind:
        case Struct(python=python):
            return python() if python else tuple(empty(each.type) for each in kind.fields)
        case SequenceType():
            return [] if kind.dtype is None else np.empty(0, kind.dtype)
        case Dictionary():
            return {}
        case Enumeration(members=members, python=python):
            number = members[0][1] if members else 0
            return python(number) if python else number
        case Primitive():
            return kind.zero


class Types:
    """The classes of one connection."""

    def __init__(self) -> None:
        self._made: dict[Type, Any] = {}
        self._exceptions: dict[tuple[str, tuple[Field, ...]], ExceptionType] = {NO_RESULT_KEY: NO_RESULT}
        self._lock = threading.RLock()

    def operation(self, told: Operation[Any]) -> Operation[Any]:
        """The same operation, with classes for its types. Raises NotUnderstood."""
        with self._lock:
            return replace(
                told,
                inputs=self.fields(told.inputs),
                outputs=self.fields(told.outputs),
                raises=tuple(map(self._exception, told.raises)),
            )

    def fields(self, told: Sequence[Field]) -> tuple[Field, ...]:
        return tuple(replace(each, type=self._type(each.type)) for each in told)

    def _type(self, told: Type) -> Type:
        match told:
            case Primitive():
                return told
            case SequenceType():
                return replace(told, item=self._type(told.item))
            case Dictionary():
                return replace(told, key=self._type(told.key), value=self._type(told.value))
            case Struct() | Enumeration():
                if told not in self._made:
                    self._made[told] = self._struct(told) if isinstance(told, Struct) else _enumeration(told)
                made: Type = self._made[told]
                return made

    def _struct(self, told: Struct) -> Struct:
        return record(told.name, self.fields(told.fields))

    def _exception(self, told: ExceptionType) -> ExceptionType:
        key = told.name, told.fields
        if key not in self._exceptions:
            fields = self.fields(told.fields)
            _check(told.name, fields)
            made = replace(told, fields=fields, python=_exception_class(told.name, fields))
            made.python.__contract__ = made  # type: ignore[union-attr]
            self._exceptions[key] = made
        return self._exceptions[key]


NO_RESULT_KEY = NO_RESULT.name, NO_RESULT.fields


def record(name: str, fields: tuple[Field, ...]) -> Struct:
    """A struct with a class of its own. Raises NotUnderstood."""
    _check(name, fields)
    slots = tuple(each.attribute for each in fields)
    try:
        python: Any = type(
            _short(name), (Record,), {"__slots__": slots, "__module__": _MODULE, "__qualname__": _dotted(name)}
        )
    except (TypeError, ValueError) as exc:
        raise NotUnderstood(f"{name}: {exc}") from exc
    python.__contract__ = Struct(name, fields, python)
    made: Struct = python.__contract__
    return made


def record_of(operation: Operation[Any]) -> Any:
    """The class of what an operation returns, if it has several outputs."""
    outputs = operation.outputs
    return record(operation.response.name, outputs).python if len(outputs) > 1 else None


def _check(name: str, fields: Sequence[Field]) -> None:
    """Refuse names that cannot be attributes, or that mean something to Python."""
    seen: set[str] = set()
    for each in fields:
        attribute = each.attribute
        if not attribute.isidentifier() or attribute.startswith("__") or attribute in seen:
            raise NotUnderstood(f"{name} has a field {each.name!r}, which Python cannot have")
        seen.add(attribute)


def _short(name: str) -> str:
    return name.rpartition("::")[2]


def _dotted(name: str) -> str:
    return name.replace("::", ".")


def _enumeration(told: Enumeration) -> Enumeration:
    """With a class; without one, so that its values are numbers, if a member has a name that Python cannot have."""
    if any(name.startswith("__") for name, _ in told.members):
        return told
    try:
        short, members = _short(told.name), dict(told.members)
        # mypy wants names that it can read in the source; these are known only now.
        python: Any = IntEnum(short, members, module=_MODULE, qualname=_dotted(told.name))  # type: ignore[misc]
    except (TypeError, ValueError):
        return told
    return replace(told, python=python)


class _Thrown(DeclaredError):
    """Base of the exceptions that others announce."""

    __contract__: ClassVar[ExceptionType]

    def __init__(self, *values: Any) -> None:
        super().__init__(*values)
        for each, value in zip(self.__contract__.fields, values, strict=True):
            setattr(self, each.attribute, value)

    def __str__(self) -> str:
        values = {each.name: getattr(self, each.attribute) for each in self.__contract__.fields}
        if len(values) == 1:
            return str(*values.values())
        return ", ".join(f"{name}={value!r}" for name, value in values.items())


def _exception_class(name: str, fields: Sequence[Field]) -> type[_Thrown]:
    taken = {each.attribute for each in fields if hasattr(_Thrown, each.attribute)}
    if taken:  # `args` or `with_traceback`
        raise NotUnderstood(f"{name} has a field {taken.pop()!r}, which every exception in Python has")
    return type(_short(name), (_Thrown,), {"__module__": _MODULE, "__qualname__": _dotted(name)})


def fitted(kind: Type, given: Any, what: str) -> Any:
    """What a caller gives, as a codec takes it: objects for structs, and the names of enumerators, are converted.

    Everything else is passed on, and checked by the codec. Raises EncodeError.
    """
    match kind:
        case Struct(python=python) if python:
            return _struct_fitted(kind, given, what)
        case Enumeration(members=members) if isinstance(given, str):
            numbers = dict(members)
            if given not in numbers:
                raise EncodeError(f"{what}: {unknown('enumerator', given, numbers)}")
            return numbers[given] if kind.python is None else kind.python(numbers[given])
        case SequenceType(item) if kind.dtype is None and isinstance(given, list | tuple):
            return [fitted(item, each, f"{what}[{number}]") for number, each in enumerate(given)]
        case Dictionary(key, item) if isinstance(given, Mapping):
            return {fitted(key, k, f"a key of {what}"): fitted(item, v, f"{what}[{k!r}]") for k, v in given.items()}
    return given


def _struct_fitted(kind: Struct, given: Any, what: str) -> Any:
    """An object of the struct, from an object, a dictionary of its fields or a tuple of all of them."""
    fields = kind.fields
    names = [each.name for each in fields]
    if isinstance(given, Mapping):
        if wrong := [name for name in given if name not in names]:
            raise EncodeError(f"{what}: {unknown('field', str(wrong[0]), names)}")
        if absent := [name for name in names if name not in given]:
            raise EncodeError(f"{what}: lacks {', '.join(f'`{each}`' for each in absent)}")
        values = [given[name] for name in names]
    elif isinstance(given, tuple | list):
        if len(given) != len(fields):
            raise EncodeError(f"{what}: has {len(given)} values; its fields are {', '.join(names)}")
        values = list(given)
    else:
        return given
    made = (fitted(each.type, value, f"{what}.{each.name}") for each, value in zip(fields, values, strict=True))
    assert kind.python is not None
    return kind.python(*made)
