"""The imports of generated code, computed from the names that the code uses."""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import lru_cache

from ..contract.types import Primitive
from .layout import WIDTH
from .linting import TEXTS, excused, parsed

MARK = "# imports\n"
"""Placeholder for the imports in a template."""

STANDARD = {
    "abc": ("abstractmethod",),
    "collections.abc": ("Generator",),
    "contextlib": ("AbstractContextManager",),
    "dataclasses": ("dataclass", "field"),
    "enum": ("IntEnum",),
    "typing": ("ClassVar", "Literal", "TypeAlias", "TypedDict"),
}
NUMPY = {"numpy.typing": ("ArrayLike", "NDArray")}
TYPES = (
    *(kind.name for kind in Primitive),
    *("DeclaredError", "Dictionary", "Enumeration", "ExceptionType", "Field", "Future", "Interface", "Operation"),
    *("Pattern", "Proxy", "Sequence", "Struct", "dtype_of"),
)
"""Names of `runtime.api` that modules of types use."""

COMPONENT = (
    *("Component", "Durability", "History", "Liveliness", "Machine", "Parameter", "ParameterKind", "ParameterList"),
    *("Parameters", "ParameterSet", "PeriodicTimer", "Port", "QoS", "Reliability", "State", "StateMachine"),
    *("Transition", "Trigger", "Verb", "Worker"),
)
"""Further names of `runtime.api`, which modules of components use."""

API = (*TYPES, *COMPONENT)
OURS = {
    "robocomp_py.actions.api": ("ServerGoal",),
    "robocomp_py.runtime.api": API,
    "robocomp_py.runtime.instances": ("InstanceHandler", "NamedHandlers", "NamedProxies"),
    "robocomp_py.testing.fakes": ("Fake",),
}
BUILTINS = ("bool", "dict", "float", "int", "list", "str", "tuple")


def complete(text: str, siblings: Collection[str], package: str = ".", handlers: Sequence[str] = ()) -> str:
    """Replace the mark by the imports of libraries, and of the modules of a package that the text uses.

    `handlers` are the classes beside GenericWorker that the text may use.
    """
    used = used_names(text) - set(bound_names(text))
    return excused(text).replace(MARK, import_statements(used, siblings, package, handlers), 1)


def import_statements(
    used: Collection[str], siblings: Collection[str], package: str, handlers: Sequence[str] = ()
) -> str:
    """The imports of these names, ordered and laid out as formatters do."""
    standard = [f"import {name}" for name in ("builtins", "typing") if name in used]
    standard += _imports(STANDARD, used)
    libraries = ["import numpy as np"] if "np" in used else []
    libraries += _imports(NUMPY, used)
    libraries += ["from robocomp_py.actions import api as _actions"] if "_actions" in used else []
    libraries += _imports(OURS, used)
    own = [
        *_imports({package: tuple(siblings)}, used),
        *_imports({".generic.genericworker": ("GenericWorker", *handlers)}, used),
        *_imports({".params": ("PARAMS", "Params")}, used),
    ]
    return "\n".join("\n".join(group) + "\n" for group in (standard, libraries, own) if group)


def import_from(source: str, names: Sequence[str]) -> str:
    """An import on one line, or with one name per line if it would be too long."""
    ordered = sorted(names, key=_order)
    line = f"from {source} import {', '.join(ordered)}"
    if len(line) <= WIDTH:
        return line
    return f"from {source} import (\n" + "".join(f"    {name},\n" for name in ordered) + ")"


@lru_cache(TEXTS)
def used_names(text: str) -> frozenset[str]:
    """The names that a text uses from the scope of its module."""
    return frozenset(_used(parsed(text)))


@lru_cache(TEXTS)
def bound_names(text: str) -> tuple[str, ...]:
    """The names that a text binds in the scope of its module, in order."""
    found: list[str] = []
    for node in parsed(text).body:
        match node:
            case ast.Import(names=aliases) | ast.ImportFrom(names=aliases):
                found += [alias.asname or alias.name for alias in aliases]
            case ast.ClassDef(name=name) | ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                found.append(name)
            case ast.Assign(targets=targets):
                found += [target.id for target in targets if isinstance(target, ast.Name)]
            case ast.AnnAssign(target=ast.Name(id=name)):
                found.append(name)
            case _:
                pass
    return tuple(found)


def _used(node: ast.AST) -> Iterator[str]:
    match node:
        case ast.Name(id=name, ctx=ast.Load()):
            yield name
        case ast.FunctionDef(args=arguments, body=body, decorator_list=decorators, returns=returned):
            yield from (name for each in (arguments, returned, *decorators) if each for name in _used(each))
            own = {each.arg for each in (*arguments.args, *arguments.kwonlyargs)}
            yield from (name for each in body for name in _used(each) if name not in own)
        case _:
            for child in ast.iter_child_nodes(node):
                yield from _used(child)


def _imports(table: Mapping[str, tuple[str, ...]], used: Collection[str]) -> Iterator[str]:
    """An import of what is used from each module of a table."""
    for source, names in table.items():
        wanted = [name for name in names if name in used]
        if wanted:
            yield import_from(source, wanted)


def _order(name: str) -> tuple[int, list[str | int]]:
    """A sort key with the order of isort: CONSTANTS, Classes, functions; numbers in names by their value."""
    rank = 0 if name.isupper() and len(name) > 1 else 1 if name[:1].isupper() else 2
    return rank, [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name.lower())]
