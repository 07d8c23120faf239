"""All names that generated code imports from this package, but those of named instances: see `instances`."""

from __future__ import annotations

from concurrent.futures import Future

from ..contract.component import Component, PeriodicTimer, Port
from ..contract.interface import Interface, Operation, Pattern, Verb
from ..contract.parameters import Parameter, ParameterKind, ParameterList, Parameters, ParameterSet
from ..contract.qos import Durability, History, Liveliness, QoS, Reliability
from ..contract.statemachine import State, StateMachine, Transition
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
from ..wire.records import dtype_of, objects_of
from .ports import Proxy
from .statemachine import Machine, Trigger
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
    "Machine",
    "Operation",
    "Parameter",
    "ParameterKind",
    "ParameterList",
    "ParameterSet",
    "Parameters",
    "Pattern",
    "PeriodicTimer",
    "Port",
    "Proxy",
    "QoS",
    "Reliability",
    "Sequence",
    "State",
    "StateMachine",
    "Struct",
    "Transition",
    "Trigger",
    "Verb",
    "Worker",
    "dtype_of",
    "objects_of",
]
