"""The front door of generated code: everything it imports from this package."""

from __future__ import annotations

from collections.abc import Sequence as _Sequence
from concurrent.futures import Future
from typing import Any

from ..contract.component import Component, Port
from ..contract.interface import Interface, Operation, Pattern, Verb
from ..contract.parameters import Parameter, ParameterKind, ParameterList, Parameters, ParameterSet
from ..contract.qos import Durability, History, Liveliness, QoS, Reliability
from ..contract.types import (
    BOOL,
    FLOAT32,
    FLOAT64,
    INT8,
    INT16,
    INT32,
    INT64,
    STRING,
    TIME,
    UINT8,
    UINT16,
    UINT32,
    UINT64,
    Dictionary,
    Enumeration,
    ExceptionType,
    Field,
    Sequence,
    Struct,
)
from ..errors import DeclaredError
from .ports import Proxy
from .worker import Worker

__all__ = [
    "BOOL",
    "FLOAT32",
    "FLOAT64",
    "INT8",
    "INT16",
    "INT32",
    "INT64",
    "STRING",
    "TIME",
    "UINT8",
    "UINT16",
    "UINT32",
    "UINT64",
    "Component",
    "DeclaredError",
    "Dictionary",
    "Durability",
    "Enumeration",
    "ExceptionType",
    "Field",
    "Future",
    "History",
    "Interface",
    "Liveliness",
    "Operation",
    "Parameter",
    "ParameterKind",
    "ParameterList",
    "ParameterSet",
    "Parameters",
    "Pattern",
    "Port",
    "Proxy",
    "QoS",
    "Reliability",
    "Sequence",
    "Struct",
    "Verb",
    "Worker",
    "main",
]


def main(worker_class: type[Worker[Any]], arguments: _Sequence[str] | None = None) -> int:
    """Run a component as a program; returns its exit code. See `robocomp_py.runtime.run.main`."""
    from .run import main as run  # it uses generated code itself, which imports this module

    return run(worker_class, arguments)
