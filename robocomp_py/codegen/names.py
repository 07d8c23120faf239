"""Python names for the names in models. Different names stay different."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection
from typing import Any

from ..contract import naming
from ..contract import types as t
from ..contract.component import Port, free_name
from ..contract.interface import Interface, Operation
from .imports import API, BUILTINS, TYPES

_CLASSES = {
    *TYPES,
    *BUILTINS,
    *(
        "AbstractContextManager",
        "ArrayLike",
        "ClassVar",
        "IntEnum",
        "NDArray",
        "TypeAlias",
        "annotations",
        "builtins",
        "dataclass",
        "field",
    ),
    *("np", "typing"),
}
"""Names that modules of types use themselves."""

_MODULES = {
    *_CLASSES,
    *API,
    *("GenericWorker", "PARAMS", "Params", "SpecificWorker", "abstractmethod", "component", "genericworker"),
    *("Fake", "Fakes", "Generator", "ServerGoal", "TypedDict", "fakes", "middleware", "params"),
}
"""Names of other modules in the generic part, and names that the generic part uses itself."""

_ARGUMENTS = {"self", "deadline"}
_METHODS = {"interface", "_ask", "_ask_async", "_send", "_loan", "_bound", "_begin", "_goals"}
_MEMBERS = {
    *("as_integer_ratio", "bit_count", "bit_length", "conjugate", "denominator", "from_bytes", "imag", "is_integer"),
    *("mro", "name", "numerator", "real", "to_bytes", "value", "ClassVar", "Enumeration"),
}
"""Attributes of IntEnum, in all versions of Python."""


def short(name: str) -> str:
    """`RoboCompLaser::TData` → `TData`."""
    return name.rpartition("::")[2]


def module_of(name: str) -> str:
    return name.rpartition("::")[0]


def class_name(name: str) -> str:
    """The name of a definition in its own module."""
    return free_name(short(name), _CLASSES)


def module_name(name: str) -> str:
    """The name of the Python module of an IDSL module."""
    return free_name(name, _MODULES)


def reference(name: str, here: str) -> str:
    """The name of a definition as seen from the module `here`; "" outside all modules."""
    module = module_of(name)
    return class_name(name) if module == here else f"{module_name(module)}.{class_name(name)}"


def member_name(name: str) -> str:
    """The name of an enumerator."""
    sunder = name.startswith("_") and name.endswith("_")  # reserved by the enum module
    return f"{name}_" if sunder else free_name(name, _MEMBERS)


def argument(field: t.Field) -> str:
    """The name of a parameter of an operation."""
    return free_name(field.name, _ARGUMENTS)


def method(operation: Operation[Any]) -> str:
    """The name of a proxy's method for an operation."""
    return free_name(operation.name, _METHODS)


def twin(operation: Operation[Any], interface: Interface) -> str:
    """The name of a proxy's asynchronous method for an operation."""
    return _unlike(f"{operation.name}Async", {other.name for other in interface.operations})


def loan(operation: Operation[Any], interface: Interface) -> str:
    """The name of a proxy's method that lends a message to fill: `loanPushImage`."""
    name = f"loan{operation.name[:1].upper()}{operation.name[1:]}"
    return _unlike(name, {other.name for other in interface.operations})


def loan_arguments(operation: Operation[Any]) -> list[str]:
    """The names of the arrays of a message. Where two arrays have the same name, their paths are used.

    If the only parameter is a struct, that struct is the message, and paths begin inside it.
    """
    inside = len(operation.inputs) == 1 and isinstance(operation.inputs[0].type, t.Struct)
    paths = [[field.name for field in path[inside:]] for path, _ in t.arrays(operation.inputs)]
    own = Counter(path[-1] for path in paths)
    names: list[str] = []
    for path in paths:
        name = free_name(path[-1] if own[path[-1]] == 1 else "_".join(path), _ARGUMENTS)
        while name in names:
            name += "_"
        names.append(name)
    return names


def message_class(operation: Operation[Any]) -> str:
    """The name of the class that holds the parameters of an operation while they are filled."""
    return class_name(operation.request.name)


def operation_constant(operation: Operation[Any]) -> str:
    return naming.operation_constant(short(operation.interface), operation.name)


def interface_constant(interface: Interface) -> str:
    return naming.interface_constant(interface.short)


def proxy_class(port: Port) -> str:
    return naming.proxy_class(port.interface.short, port.verb)


def handler_class(port: Port) -> str:
    """The name of the class that answers for one named instance."""
    return f"{port.interface.short}Handler"


def snake(name: str) -> str:
    """A name for a Python function or module."""
    return re.sub(r"\W+", "_", name).lower()


def self_dot(name: str) -> str:
    return f"self.{name}"


def _unlike(name: str, others: Collection[str]) -> str:
    """The name, with underscores appended until it differs from all others."""
    while name in others:
        name += "_"
    return name
