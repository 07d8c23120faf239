"""Values of a component's own classes. Its IDSL may be older or newer than ours: fields are filled by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...contract.interface import Interface, Operation
from ...contract.types import Sequence, Struct, Type
from ...errors import ArgumentError


def operation(interface: Interface, name: str) -> Operation[Any]:
    return next(each for each in interface.operations if each.name == name)


def declared(interface: Interface, name: str, exception: str, text: str) -> Exception:
    """The exception of an operation that is called `exception` and holds a text; ArgumentError if it declares none."""
    for each in operation(interface, name).raises:
        if each.python is not None and each.name.rpartition("::")[2] == exception:
            made: Exception = each.python(text)
            return made
    return ArgumentError(text)


def filled(kind: Type, values: Mapping[str, Any]) -> Any:
    """A struct with those of the values whose fields it has; its other fields are as they are in a new one."""
    assert isinstance(kind, Struct)
    assert kind.python is not None
    return kind.python(**{each.attribute: values[each.name] for each in kind.fields if each.name in values})


def records(kind: Type, columns: Mapping[str, NDArray[Any]]) -> Any:
    """A sequence of structs from arrays of one length, by the names of the fields.

    It is an array of records, if the struct is flat: messages take it in place of objects, which take much longer.
    """
    assert isinstance(kind, Sequence)
    assert isinstance(kind.item, Struct)
    if kind.item.dtype is None:
        return rows(kind, columns)
    made = np.zeros(len(next(iter(columns.values()))), kind.item.dtype)
    for each in kind.item.fields:
        if each.name in columns:
            made[each.attribute] = columns[each.name]
    return made


def rows(kind: Type, columns: Mapping[str, NDArray[Any]]) -> Any:
    """The same as objects, unless the sequence is declared as `[records]`."""
    assert isinstance(kind, Sequence)
    assert isinstance(kind.item, Struct)
    if kind.dtype is not None:
        return records(kind, columns)
    known = [each for each in kind.item.fields if each.name in columns]
    lists = [columns[each.name].tolist() for each in known]
    if tuple(known) == kind.item.fields and kind.item.python is not None:
        return list(map(kind.item.python, *lists))  # a third of the time
    names = [each.name for each in known]
    return [filled(kind.item, dict(zip(names, numbers, strict=True))) for numbers in zip(*lists, strict=True)]
