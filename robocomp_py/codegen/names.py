"""Names of the models as names of Python. What has two names in a model has two in Python."""

from __future__ import annotations

import keyword
import re
from collections import Counter
from collections.abc import Collection
from typing import Any

from ..contract import naming
from ..contract import types as t
from ..contract.component import Port
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
"""What modules of types use for themselves."""

_MODULES = {
    *_CLASSES,
    *API,
    *("GenericWorker", "PARAMS", "Params", "SpecificWorker", "abstractmethod", "component", "genericworker"),
    *("Fake", "Fakes", "TypedDict", "fakes", "middleware", "params"),
}
"""What is in the generic part beside the modules of types, and what it uses for itself."""

_ARGUMENTS = {"self", "deadline"}
_METHODS = {"interface", "_ask", "_ask_async", "_send", "_loan", "_bound"}
_MEMBERS = {
    *("as_integer_ratio", "bit_count", "bit_length", "conjugate", "denominator", "from_bytes", "imag", "is_integer"),
    *("mro", "name", "numerator", "real", "to_bytes", "value", "ClassVar", "Enumeration"),
}
"""What every IntEnum has, in all versions of Python."""


def short(name: str) -> str:
    """`RoboCompLaser::TData` → `TData`."""
    return name.rpartition("::")[2]


def module_of(name: str) -> str:
    return name.rpartition("::")[0]


def class_name(name: str) -> str:
    """What a definition is called in its own module."""
    return _free(short(name), _CLASSES)


def module_name(name: str) -> str:
    """What the Python module of an IDSL module is called."""
    return _free(name, _MODULES)


def reference(name: str, here: str) -> str:
    """What a definition is called from a module; `here` is "" outside of all."""
    module = module_of(name)
    return class_name(name) if module == here else f"{module_name(module)}.{class_name(name)}"


def member_name(name: str) -> str:
    """An enumerator."""
    sunder = name.startswith("_") and name.endswith("_")  # those are the enum module's
    return f"{name}_" if sunder else _free(name, _MEMBERS)


def argument(field: t.Field) -> str:
    """A parameter of an operation."""
    return _free(field.name, _ARGUMENTS)


def method(operation: Operation[Any]) -> str:
    """An operation of a proxy."""
    return _free(operation.name, _METHODS)


def twin(operation: Operation[Any], interface: Interface) -> str:
    """An operation of a proxy that does not wait."""
    return _unlike(f"{operation.name}Async", {other.name for other in interface.operations})


def loan(operation: Operation[Any], interface: Interface) -> str:
    """The method of a proxy that gives a message to fill: `loanPushImage`."""
    name = f"loan{operation.name[:1].upper()}{operation.name[1:]}"
    return _unlike(name, {other.name for other in interface.operations})


def loan_arguments(operation: Operation[Any]) -> list[str]:
    """What the arrays of its message are called: by their own names or, where two are called so, by the way to them.

    If there is one parameter, a struct, that is the message, and the way to an array begins in it.
    """
    inside = len(operation.inputs) == 1 and isinstance(operation.inputs[0].type, t.Struct)
    paths = [[field.name for field in path[inside:]] for path, _ in t.arrays(operation.inputs)]
    own = Counter(path[-1] for path in paths)
    names: list[str] = []
    for path in paths:
        name = _free(path[-1] if own[path[-1]] == 1 else "_".join(path), _ARGUMENTS)
        while name in names:
            name += "_"
        names.append(name)
    return names


def message_class(operation: Operation[Any]) -> str:
    """What holds the parameters of an operation while they are filled."""
    return class_name(operation.request.name)


def operation_constant(operation: Operation[Any]) -> str:
    return naming.operation_constant(short(operation.interface), operation.name)


def interface_constant(interface: Interface) -> str:
    return naming.interface_constant(interface.short)


def proxy_class(port: Port) -> str:
    return naming.proxy_class(port.interface.short, port.verb)


def camel(name: str) -> str:
    """`left_motors` → `LeftMotors`."""
    return "".join(part[:1].upper() + part[1:] for part in re.split(r"[_\W]+", name))


def snake(name: str) -> str:
    """A name for a Python function or module."""
    return re.sub(r"\W+", "_", name).lower()


def self_dot(name: str) -> str:
    return f"self.{name}"


def _free(name: str, taken: Collection[str]) -> str:
    """A name that is neither a keyword nor taken: with an underscore behind if it is; and if it is but for underscores
    behind it, so that `list` and `list_` stay apart.
    """
    bare = name.rstrip("_")
    return f"{name}_" if keyword.iskeyword(bare) or bare in taken else name


def _unlike(name: str, others: Collection[str]) -> str:
    """The name, with underscores appended until it differs from all others."""
    while name in others:
        name += "_"
    return name
