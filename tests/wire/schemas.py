"""What other programs make of a CDR payload by a schema of ours, as lists that can be compared."""

from __future__ import annotations

from typing import Any

import numpy as np
from mcap.records import Schema as McapSchema
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from robocomp_py.contract.interface import Operation
from robocomp_py.contract.types import (
    TIME,
    Dictionary,
    Enumeration,
    Field,
    Primitive,
    Sequence,
    Struct,
    Type,
)
from robocomp_py.wire.schema import Schema


def operation_of(message: Struct) -> Operation[Any]:
    """An operation that sends such messages."""
    return Operation("Any::Source", "told", message.fields)


def by_rosbags(schema: Schema, payload: bytes) -> list[Any]:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema.text, schema.name))
    return listed(store.deserialize_cdr(payload, schema.name))


def by_mcap_ros2(schema: Schema, payload: bytes) -> list[Any]:
    described = McapSchema(id=1, data=schema.text.encode(), encoding=schema.encoding, name=schema.name)
    decode = DecoderFactory().decoder_for("cdr", described)
    assert decode
    return listed(decode(payload))


def listed(value: Any) -> Any:
    """Objects as lists of their fields, in order."""
    names = [each for each in getattr(value, "__slots__", ()) or getattr(value, "__dataclass_fields__", ())]
    if names:
        values = [listed(getattr(value, each)) for each in names if each != "__msgtype__"]
        return [] if names[0] == "structure_needs_at_least_one_member" else values
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, bytes | bytearray):
        return list(value)
    if hasattr(value, "typecode") or isinstance(value, list | tuple):
        return [listed(each) for each in value]
    return value


def expected(fields: tuple[Field, ...], values: tuple[Any, ...]) -> list[Any]:
    """The same of our own values."""
    return [_ours(each.type, value) for each, value in zip(fields, values, strict=True)]


def _ours(kind: Type, value: Any) -> Any:
    match kind:
        case Primitive():
            return list(divmod(value, 10**9)) if kind is TIME else value
        case Enumeration():
            return int(value)
        case Struct(fields=fields):
            parts = value if isinstance(value, tuple) else [getattr(value, each.attribute) for each in fields]
            return expected(fields, tuple(parts))
        case Sequence(item):
            items = value.tolist() if isinstance(value, np.ndarray) else [_ours(item, each) for each in value]
            return [[each] for each in items] if isinstance(item, Sequence | Dictionary) else items
        case Dictionary(key, item):
            return [[_ours(key, name), _ours(item, each)] for name, each in value.items()]
