"""Records of flat structs: arrays of them instead of lists of objects.

A flat struct has nothing but numbers, bools and enumerators. `Struct.dtype` is the numpy dtype of its records: packed,
little-endian, enumerators as int32. `Records` converts what fits such a sequence, and checks what arrived.
"""

from __future__ import annotations

import operator
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache, partial
from itertools import chain, repeat
from typing import Any, TypeVar, overload

import numpy as np

from ..contract.types import Enumeration, Field, Primitive, Struct
from .arrays import as_array, read_only
from .values import as_bool, as_list, as_member, as_tuple

T = TypeVar("T")

_Array = np.ndarray[Any, np.dtype[Any]]
_Check = Callable[[_Array], bool]


def is_structured(value: Any) -> bool:
    """Whether this is an array of records, of any struct."""
    return isinstance(value, np.ndarray) and value.dtype.names is not None


class Records:
    """The records of one flat struct."""

    def __init__(self, kind: Struct) -> None:
        if kind.dtype is None:
            raise ValueError(f"{kind.name} is not a flat struct, so it has no records")
        self.kind, self.dtype = kind, kind.dtype
        self._sent = [(f.attribute, check) for f in kind.fields if (check := _enumerators(f))]
        self._received = self._sent + [(f.attribute, _is_bools) for f in kind.fields if f.type is Primitive.BOOL]
        self._numbers = [_numbers(f) for f in kind.fields]

    def taken(self, value: Any) -> _Array:
        """A contiguous array of `dtype` with these records; the same memory where that is possible.

        It accepts arrays with the same field names, in any order and layout, and lists of objects. No value is
        rounded to an integer or wrapped. Raises TypeError or ValueError, or OverflowError for a number out of range.
        """
        if isinstance(value, np.ndarray):
            array = value if value.dtype is self.dtype and type(value) is np.ndarray else self._alike(np.asarray(value))
            if array.ndim != 1 or array.strides[0] != self.dtype.itemsize:
                if not array.ndim:
                    raise TypeError("0 dimensions")
                array = np.ascontiguousarray(array).reshape(-1)
            if array.size:
                _check(array, self._sent)
            return array
        return self._collected(as_list(value))

    def checked(self, array: _Array) -> _Array:
        """A received array. Raises ValueError if a bool is neither 0 nor 1, or an enumerator is unknown."""
        if self._received and array.size:
            _check(array, self._received)
        return array

    def received(self, objects: list[Any]) -> _Array:
        """Received objects as a read-only array."""
        return read_only(self._collected(objects))

    def items(self, value: Any) -> Any:
        """The items of a sequence that is no list: an array for an array of records, otherwise a list."""
        return self.taken(value) if is_structured(value) else as_list(value)

    def listed(self, value: Any) -> list[Any]:
        """The items of a sequence that is no list, as a list of objects."""
        return self.objects(self.taken(value)) if is_structured(value) else as_list(value)

    def objects(self, array: _Array) -> list[Any]:
        """An object for each record; without a Python class, a tuple."""
        columns: list[Iterable[Any]] = []
        for field in self.kind.fields:
            numbers = array[field.attribute].tolist()
            made = field.type.python if isinstance(field.type, Enumeration) else None
            columns.append(map(made, numbers) if made else numbers)
        return list(map(self.kind.python, *columns) if self.kind.python else zip(*columns, strict=True))

    def _alike(self, value: _Array) -> _Array:
        return value.view(self.dtype) if value.dtype == self.dtype else self._gathered(value)

    def _gathered(self, value: _Array) -> _Array:
        """The records of an array of another layout, or of other types."""
        names, found = set(self.dtype.names or ()), set(value.dtype.names or ())
        if not found:
            raise TypeError(f"{value.dtype} has no fields")
        for name in sorted(names - found):
            raise TypeError(f"it has no field `{name}`")
        for name in sorted(found - names):
            raise TypeError(f"{self.kind.name.rpartition('::')[2]} has no field `{name}`")
        array = np.empty(value.shape, self.dtype)
        for name in names:
            if value.dtype[name].shape:
                raise TypeError(f"`{name}` is not one number")
            with _about(name):
                array[name] = as_array(value[name], self.dtype[name]).reshape(value.shape)
        return array

    def _collected(self, objects: list[Any]) -> _Array:
        """The records of objects with the attributes of the struct. Numbers are what `struct` takes."""
        array = np.empty(len(objects), self.dtype)
        if not objects:
            return array
        width = len(self.kind.fields)
        for place, (field, pack) in enumerate(zip(self.kind.fields, self._numbers, strict=True)):
            if self.kind.python is None:
                column = [as_tuple(each, width)[place] for each in objects]
            else:
                column = list(map(operator.attrgetter(field.attribute), objects))
            with _about(field.attribute):
                array[field.attribute] = pack(column)
        return array


@lru_cache(maxsize=1024)
def records(kind: Struct) -> Records:
    """The `Records` of a flat struct, made once."""
    return Records(kind)


def dtype_of(kind: type[Any]) -> np.dtype[np.void]:
    """The numpy dtype of the records of a generated struct: `points = np.zeros(1000, dtype_of(TPoint))`.

    It is packed and little-endian, and has a field for each attribute. Enumerators are int32. Raises TypeError if the
    struct has other fields than numbers, bools and enumerators.
    """
    return _known(kind).dtype


def objects_of(array: np.ndarray[Any, np.dtype[Any]], kind: type[T]) -> Sequence[T]:
    """An array of records as a sequence of generated structs, for code that was written for lists.

    Each object is made when it is asked for, and is a copy: changing it does not change the array.
    """
    return _Objects(array, _known(kind))


def _known(kind: type[Any]) -> Records:
    contract = getattr(kind, "__contract__", None)
    if not isinstance(contract, Struct) or contract.dtype is None:
        raise TypeError(f"{kind.__name__} is not a generated struct of numbers, bools and enumerators only")
    return records(contract)


_CHUNK = 1024


class _Objects(Sequence[T]):
    def __init__(self, array: _Array, kind: Records) -> None:
        self._array, self._kind = array, kind

    def __len__(self) -> int:
        return len(self._array)

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[T]: ...
    def __getitem__(self, index: int | slice) -> T | Sequence[T]:
        if isinstance(index, slice):
            return _Objects(self._array[index], self._kind)
        (made,) = self._kind.objects(self._array[index].reshape(1))
        result: T = made
        return result

    def __iter__(self) -> Iterator[T]:
        starts = range(0, len(self), _CHUNK)
        return chain.from_iterable(self._kind.objects(self._array[at : at + _CHUNK]) for at in starts)


class _about:
    """Adds the name of this field to exceptions raised in it."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, exc: BaseException | None, trace: object) -> None:
        if isinstance(exc, Exception):
            raise ValueError(f"`{self._name}`: {exc}") from exc


def _check(array: _Array, checks: list[tuple[str, _Check]]) -> None:
    for name, is_right in checks:
        if not is_right(array[name]):
            raise ValueError(f"`{name}` has a value that its type does not have")


def _is_bools(column: _Array) -> bool:
    return bool(column.view(np.uint8).max() <= 1)


def _enumerators(field: Field) -> _Check | None:
    """A function that tells whether all numbers are enumerators."""
    if not isinstance(field.type, Enumeration):
        return None
    numbers = sorted({number for _, number in field.type.members})
    if numbers[-1] - numbers[0] < len(numbers):
        return partial(_is_between, numbers[0], numbers[-1])
    return partial(_is_among, np.array(numbers, np.int32))


def _is_between(low: int, high: int, column: _Array) -> bool:
    return bool(column.min() >= low and column.max() <= high)


def _is_among(numbers: _Array, column: _Array) -> bool:
    return bool(np.isin(column, numbers).all())


def _numbers(field: Field) -> Callable[[list[Any]], _Array]:
    """A function that makes an array of a field's values."""
    match field.type:
        case Enumeration(members=members):
            table = {number: number for _, number in members}
            return lambda column: _packed("i", list(map(as_member, column, repeat(table))))
        case Primitive.BOOL:
            return lambda column: _packed("?", list(map(as_bool, column)))
        case Primitive(letter=letter):
            return partial(_packed, letter)
    raise AssertionError("not flat")


def _packed(letter: str, column: list[Any]) -> _Array:
    return np.frombuffer(struct.pack(f"<{len(column)}{letter}", *column), f"<{letter}")
