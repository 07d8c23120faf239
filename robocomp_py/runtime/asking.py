"""Whether a component asks for its callers, by the names in its code."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from types import CodeType, FunctionType
from typing import Any

_NAME = "caller"
_OURS = "robocomp_py"
_LIBRARIES = {_OURS, *sys.stdlib_module_names}

_GENERATED = "generic"
"""The package of generated code in that of a component."""


def reads_caller(kind: type[Any]) -> bool:
    """Whether the code of a class has the name `caller`, or that of its module, or of its component's package.

    Only modules that are imported are looked into.
    """
    own = [each for each in kind.__mro__ if each.__module__.partition(".")[0] not in _LIBRARIES]
    names = {each.__module__ for each in own}
    components = [package for name in names if f"{(package := name.rpartition('.')[0])}.{_GENERATED}" in sys.modules]
    for name in list(sys.modules):
        for package in components:
            if _is_within(name, package) and not _is_within(name, f"{package}.{_GENERATED}"):
                names.add(name)
    modules = [module for name in names if (module := sys.modules.get(name))]
    things = [*own, *(thing for module in modules for thing in list(vars(module).values()))]
    defined = (thing for thing in things if getattr(thing, "__module__", "") in names)
    return any(_has_name(code) for thing in defined for code in _codes(thing))


def _is_within(module: str, package: str) -> bool:
    return module == package or module.startswith(f"{package}.")


def _codes(thing: object) -> Iterator[CodeType]:
    """The code of a function, or of all methods of a class."""
    if isinstance(thing, type):
        if not _is_within(thing.__module__, _OURS):
            for each in vars(thing).values():
                if not isinstance(each, type):
                    yield from _codes(each)
    elif isinstance(thing, FunctionType):
        yield thing.__code__
        yield from _codes(getattr(thing, "__wrapped__", None))
    elif isinstance(thing, property):
        yield from (code for each in (thing.fget, thing.fset) for code in _codes(each))
    elif isinstance(thing, staticmethod | classmethod):
        yield from _codes(thing.__func__)
    elif wrapped := getattr(thing, "func", None):
        yield from _codes(wrapped)


def _has_name(code: CodeType) -> bool:
    inner = (each for each in code.co_consts if isinstance(each, CodeType))
    return _NAME in code.co_names or _NAME in code.co_consts or any(map(_has_name, inner))
