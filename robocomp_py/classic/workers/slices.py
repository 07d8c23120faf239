"""A component's types in the form of slice2py: our contracts with other Python classes.

    struct       a class with any attributes; positional and keyword arguments; zeros, "" and None for what is a list
    enumeration  its enumerators print as their names
    sequence     a class of lists, `TLaserData()`; what is received is a list, or `bytes` of bytes
    exception    an `Ice.UserException`

A contract of ours says which Python class stands for a struct, so every codec makes these classes itself, on every
middleware. Only what slice2py leaves None and our codecs do not is given to them as empty, by attributes of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields, make_dataclass, replace
from enum import IntEnum
from types import ModuleType
from typing import Any

import numpy as np

from ...contract import types as t
from ...contract.component import Component, Port
from ...contract.interface import Interface, Operation
from ...errors import DeclaredError
from ...wire.records import records
from .spellings import slice_name

Convert = Callable[[Any], Any]


@dataclass(frozen=True)
class _Field(t.Field):
    """A field for which codecs read another attribute than users."""

    read_by: str = field(default="", compare=False, repr=False)

    @property
    def attribute(self) -> str:
        return self.read_by


class Slices:
    """Mirrors one component's contracts. Equal types share a class; exceptions derive from `user_exception`, of Ice."""

    def __init__(self, package: str, user_exception: type[BaseException]) -> None:
        self._package, self._user_exception = package, user_exception
        self._structs: dict[str, t.Struct] = {}
        self._enumerations: dict[str, t.Enumeration] = {}
        self._exceptions: dict[str, t.ExceptionType] = {}
        self.classes: dict[str, type[Any]] = {}
        """The classes of structs, enumerations and exceptions, by qualified name."""

    def mirror(self, kind: t.Type) -> t.Type:
        match kind:
            case t.Struct():
                return self._struct(kind)
            case t.Enumeration():
                return self._enumeration(kind)
            case t.Sequence():
                return replace(kind, item=self.mirror(kind.item))
            case t.Dictionary():
                return replace(kind, key=self.mirror(kind.key), value=self.mirror(kind.value))
            case t.Primitive():
                return kind

    def interface(self, interface: Interface) -> Interface:
        return replace(interface, operations=tuple(map(self._operation, interface.operations)))

    def exception(self, kind: t.ExceptionType) -> t.ExceptionType:
        if kind.name not in self._exceptions:
            base = self.exception(kind.base) if kind.base else None
            made = replace(kind, base=base, fields=self._fields(kind.fields, "declared"))
            parent: tuple[type[Any], ...] = (DeclaredError, self._user_exception)
            if base:
                assert base.python is not None
                parent = (base.python,)
            own = [(slice_name(each.name), *_default(each)) for each in made.fields]
            namespace = {"__str__": _said, "ice_id": lambda self: f"::{kind.name}", **_reads(made.fields)}
            python = make_dataclass(_short(kind.name), own, bases=parent, namespace=namespace, eq=False, repr=False)
            python.__module__ = self._module(kind.name)
            made = replace(made, python=python)
            python.__contract__ = made  # type: ignore[attr-defined]  # what calls look for in an exception
            self._exceptions[kind.name] = made
            self.classes[kind.name] = python
        return self._exceptions[kind.name]

    def _operation(self, operation: Operation[Any]) -> Operation[Any]:
        return replace(
            operation,
            inputs=tuple(replace(each, type=self.mirror(each.type)) for each in operation.inputs),
            outputs=tuple(replace(each, type=self.mirror(each.type)) for each in operation.outputs),
            raises=tuple(map(self.exception, operation.raises)),
        )

    def _struct(self, kind: t.Struct) -> t.Struct:
        if kind.python is None:
            return replace(kind, fields=tuple(replace(each, type=self.mirror(each.type)) for each in kind.fields))
        if kind.name not in self._structs:
            made = replace(kind, fields=self._fields(kind.fields, "wire"))
            own = [(slice_name(each.name), *_default(each)) for each in made.fields]
            hashable = all(_is_hashable(each.type) for each in made.fields)
            python = make_dataclass(
                _short(kind.name), own, namespace=_reads(made.fields), order=True, unsafe_hash=hashable
            )
            python.__module__ = self._module(kind.name)
            self.classes[kind.name] = python
            self._structs[kind.name] = replace(made, python=_maker(python, made.fields))
        return self._structs[kind.name]

    def _fields(self, declared: Iterable[t.Field], how: str) -> tuple[t.Field, ...]:
        made: list[t.Field] = []
        for each in declared:
            kind = self.mirror(each.type)
            name = slice_name(each.name)
            read_by = name if _settled(kind) is None else f"_{how}_{each.name}"
            made.append(_Field(each.name, kind, each.default, each.doc, read_by=read_by))
        return tuple(made)

    def _enumeration(self, kind: t.Enumeration) -> t.Enumeration:
        if kind.name not in self._enumerations:
            members = [(slice_name(name), number) for name, number in kind.members]
            make: Any = _Enumerators  # called with names, it makes a class
            python = make(_short(kind.name), members, module=self._module(kind.name))
            for name, number in kind.members:
                python(number)._name_ = name  # as it prints; what Python could not call so has another attribute
            self.classes[kind.name] = python
            self._enumerations[kind.name] = replace(kind, python=python)
        return self._enumerations[kind.name]

    def _module(self, qualified: str) -> str:
        return f"{self._package}.{qualified.partition('::')[0]}"


class _Enumerators(IntEnum):
    """Base of enumerations."""

    def __str__(self) -> str:
        return self.name

    @classmethod
    def valueOf(cls, number: int) -> _Enumerators | None:
        """The enumerator of a number, or None, as in slice2py."""
        return cls._value2member_map_.get(number)  # type: ignore[return-value]


def _short(qualified: str) -> str:
    return slice_name(qualified.rpartition("::")[2])


def _said(exception: Any) -> str:
    values = {each.name: getattr(exception, each.name) for each in fields(exception)}
    if len(values) == 1:
        return str(*values.values())
    return ", ".join(f"{name}={value!r}" for name, value in values.items())


def _is_hashable(kind: t.Type) -> bool:
    """Whether Slice allows this type as the key of a dictionary."""
    match kind:
        case t.Struct(fields=inner):
            return bool(inner) and all(_is_hashable(each.type) for each in inner)
        case t.Primitive():
            return kind not in t.FLOATS
        case t.Enumeration():
            return True
        case t.Sequence() | t.Dictionary():
            return False


def _default(of: t.Field) -> tuple[Any, Any]:
    """The annotation and default of a field; None where slice2py has None."""
    kind = of.type
    if of.default is not None:
        if isinstance(kind, t.Enumeration):
            assert kind.python is not None
            return Any, getattr(kind.python, slice_name(of.default))
        return Any, of.default
    match kind:
        case t.Struct(python=python):
            return Any, field(default_factory=python or tuple)
        case t.Enumeration(members=members, python=python):
            return Any, python(members[0][1]) if python else members[0][1]
        case t.Sequence() | t.Dictionary():
            return Any, None
        case t.Primitive():
            return Any, kind.zero


def _reads(of: Iterable[t.Field]) -> dict[str, Any]:
    """Properties for codecs, which convert None and values that only need to be true."""
    found: dict[str, Any] = {}
    for each in of:
        settle = _settled(each.type)
        if settle:
            found[each.attribute] = property(_reading(slice_name(each.name), settle))
    return found


def _reading(name: str, settle: Convert) -> Convert:
    def read(value: Any) -> Any:
        return settle(getattr(value, name))

    return read


def _maker(python: type[Any], of: tuple[t.Field, ...]) -> type[Any]:
    """What codecs call to make a received struct: the class itself, unless some of it arrives as an array."""
    converts = [(number, received(each.type)) for number, each in enumerate(of)]
    needed = [(number, convert) for number, convert in converts if convert]
    if not needed:
        return python

    def make(cls: type[Any], *values: Any) -> Any:
        if not values:
            return python()
        given = list(values)
        for number, convert in needed:
            given[number] = convert(given[number])
        return python(*given)

    # `make` gives no instance of this class, so that its constructor is not called
    return type(python.__name__, (), {"__new__": make, "__module__": python.__module__})


# -- conversion of values ----------------------------------------------------------------


def _settled(kind: t.Type) -> Convert | None:
    """Converts values that Ice accepts for a type, but we do not; None if there are none."""
    match kind:
        case t.Sequence():
            return _list
        case t.Dictionary():
            return _dict
        case t.Primitive.BOOL:
            return bool
        case t.Primitive.STRING:
            return _text
        case t.Primitive() | t.Enumeration() | t.Struct():
            return None


def _list(value: Any) -> Any:
    return () if value is None else value


def _dict(value: Any) -> Any:
    return {} if value is None else value


def _text(value: Any) -> Any:
    return "" if value is None else value


def _same(value: Any) -> Any:
    return value


def settling(of: Iterable[t.Field]) -> tuple[Convert, ...]:
    """Converters for arguments or results from user code."""
    return tuple(_settled(each.type) or _same for each in of)


def receiving(of: Iterable[t.Field]) -> tuple[Convert, ...] | None:
    """Converters for arguments or results to user code; None if none is needed."""
    converts = tuple(received(each.type) for each in of)
    return tuple(each or _same for each in converts) if any(converts) else None


def received(kind: t.Type) -> Convert | None:
    """Converts a decoded value to slice2py's type; None if they are the same."""
    match kind:
        case t.Sequence(t.Primitive.UINT8):
            return _octets
        case t.Sequence(t.Struct() as item, records=True):
            return records(item).objects
        case t.Sequence() if kind.dtype is not None:
            return _numbers
        case t.Sequence(item):
            each = received(item)
            return _each(each) if each else None
        case t.Dictionary(value=item):
            each = received(item)
            return _values(each) if each else None
        case t.Struct() | t.Enumeration() | t.Primitive():
            return None


def _octets(value: Any) -> bytes:
    return np.asarray(value).tobytes()


def _numbers(value: Any) -> list[Any]:
    made: list[Any] = np.asarray(value).tolist()
    return made


def _each(convert: Convert) -> Convert:
    return lambda value: [convert(item) for item in value]


def _values(convert: Convert) -> Convert:
    return lambda value: {key: convert(item) for key, item in value.items()}


# -- the modules -------------------------------------------------------------------------


def _list_class(name: str, module: str) -> type[Any]:
    """RoboComp makes a class of lists for each sequence. What is put into one is checked when it is sent."""
    return type(name, (list,), {"__module__": module})


def module_of(generated: ModuleType, slices: Slices, package: str) -> ModuleType:
    """The module for `import RoboCompLaser`, as slice2py makes it."""
    name = generated.__name__.rpartition(".")[2]
    made = ModuleType(f"{package}.{name}")
    aliases = [alias for alias, kind in getattr(generated, "__annotations__", {}).items() if kind == "TypeAlias"]
    for attribute, value in vars(generated).items():
        contract = getattr(value, "__contract__", None) if isinstance(value, type) else None
        match contract:
            case t.Struct() | t.Enumeration() if value.__module__ == generated.__name__:
                slices.mirror(contract)
            case t.ExceptionType() if value.__module__ == generated.__name__:
                slices.exception(contract)
            case _ if attribute in aliases:
                origin = dict if getattr(value, "__origin__", list) is dict else list
                made_class = dict if origin is dict else _list_class(attribute, made.__name__)
                setattr(made, attribute, made_class)
                continue
            case _ if isinstance(value, Interface):
                short = value.short
                setattr(made, short, type(short, (), {"__doc__": "Base of servants; without effect here."}))
                setattr(made, f"{short}Prx", type(f"{short}Prx", (_Prx,), {"__module__": made.__name__}))
                continue
            case _ if type(value) in (bool, int, float, str) and not attribute.startswith("_"):
                setattr(made, attribute, value)
                continue
            case _:
                continue
        setattr(made, _short(contract.name), slices.classes[contract.name])
    return made


class _Prx:
    """The type of a proxy. Casts return their argument, which is a proxy already."""

    @staticmethod
    def checkedCast(proxy: Any, *rest: Any) -> Any:
        return proxy

    @staticmethod
    def uncheckedCast(proxy: Any, *rest: Any) -> Any:
        return proxy


def component_of(component: Component, slices: Slices, proxies: Callable[[Interface, Port], type[Any]]) -> Component:
    """The component with mirrored classes, and proxies that behave like Ice's."""
    known: dict[str, Interface] = {}
    made = []
    for port in component.ports:
        interface = known.setdefault(port.interface.name, slices.interface(port.interface))
        proxy = proxies(interface, port) if port.verb.has_proxy else None
        made.append(replace(port, interface=interface, proxy=proxy))
    return replace(component, ports=tuple(made), machine=None)
