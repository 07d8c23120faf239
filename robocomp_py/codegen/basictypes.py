"""The names of the basic types in other interface languages."""

from __future__ import annotations

from typing import NamedTuple

from ..contract.types import Primitive


class Spelling(NamedTuple):
    omg: str
    """In OMG IDL. An instant is a struct there: see `omgidl.plain`."""

    ros: str
    """In messages of ROS 2; a name with a slash is a message of another package."""


SPELLED = {
    Primitive.BOOL: Spelling("boolean", "bool"),
    Primitive.INT8: Spelling("int8", "int8"),
    Primitive.UINT8: Spelling("uint8", "uint8"),
    Primitive.INT16: Spelling("int16", "int16"),
    Primitive.UINT16: Spelling("uint16", "uint16"),
    Primitive.INT32: Spelling("int32", "int32"),
    Primitive.UINT32: Spelling("uint32", "uint32"),
    Primitive.INT64: Spelling("int64", "int64"),
    Primitive.UINT64: Spelling("uint64", "uint64"),
    Primitive.FLOAT32: Spelling("float", "float32"),
    Primitive.FLOAT64: Spelling("double", "float64"),
    Primitive.STRING: Spelling("string", "string"),
    Primitive.TIME: Spelling("robocomp::Time", "builtin_interfaces/Time"),
}
