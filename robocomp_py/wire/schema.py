"""Schemas by which other programs read our CDR messages: `ros2msg`, and `omgidl` as Foxglove reads it.

Both describe the same octets. They are made of an operation, which may have been read from its announced text.

                    ros2msg                                  omgidl
    message         robocomp_laser_pub/msg/LaserPubPush…     RoboCompLaserPub::LaserPubPush…
    names           as `rcgen --to rosmsg` makes them        those of the IDSL
    enumeration     int32                                    int32
    time            builtin_interfaces/Time                  builtin_interfaces::Time
    dictionary      an array of {key, value}                 a sequence of {key, value}
    nested array    an array of {items}                      a sequence of {items}
    no fields       one octet

An announced text has no names for sequences and dictionaries, so those of `rcgen` for them are not known here: entries
are called after their key and value. Names that would clash get a number.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any, NamedTuple, Protocol

from ..contract.interface import Operation
from ..contract.rosnames import camel, field_name, package_of
from ..contract.types import UINT8, Dictionary, Enumeration, Field, Primitive, Sequence, Struct, Type


class Schema(NamedTuple):
    name: str
    """Of the message: `robocomp_laser_pub/msg/LaserPubPushLaserData`."""
    encoding: str
    """`ros2msg` or `omgidl`."""
    text: str


def ros2msg(operation: Operation[Any]) -> Schema:
    """The schema of what an operation sends: its request or publication."""
    written = _Written(_Ros2())
    name = written.named(_message(operation))
    main, *others = reversed(written.texts.items())
    parts = [main[1], *(f"{_LINE}\nMSG: {other}\n{text}" for other, text in others)]
    package, _, own = name.partition("/")
    return Schema(f"{package}/msg/{own}", "ros2msg", "".join(parts))


def omgidl(operation: Operation[Any]) -> Schema:
    """The same as OMG IDL, without lines of a preprocessor."""
    written = _Written(_Omg())
    name = written.named(_message(operation))
    return Schema(name, "omgidl", "\n".join(written.texts.values()))


ENCODINGS = {"ros2msg": ros2msg, "omgidl": omgidl}
"""By their names."""

_LINE = "=" * 80
_NOTHING = Field("structure_needs_at_least_one_member", UINT8)
_DEFAULT_MODULE = "robocomp"


def _message(operation: Operation[Any]) -> Struct:
    return Struct(operation.request.name.removesuffix("Request"), operation.inputs)


class _Language(Protocol):
    time: str

    def type_name(self, module: str, short: str) -> str: ...

    def field_name(self, name: str) -> str: ...

    def primitive(self, kind: Primitive) -> str: ...

    def array(self, item: str) -> str: ...

    def definition(self, name: str, fields: Iterable[tuple[str, str, str]]) -> str:
        """A struct; each field has a type, a name and a comment, which may be empty."""
        ...

    @property
    def time_fields(self) -> tuple[tuple[str, str, str], ...]: ...


class _Written:
    """The definitions of all types that are used, each after those that it uses."""

    def __init__(self, language: _Language) -> None:
        self._language = language
        self._names: dict[tuple[str, Type], str] = {}
        """By what they are made for, and its type."""
        self._taken = {language.time.lower()}
        self._home = _DEFAULT_MODULE
        self.texts: dict[str, str] = {}

    def named(self, message: Struct) -> str:
        self._home = message.name.rpartition("::")[0] or _DEFAULT_MODULE
        return self._struct(("", message), message.name, message.fields)

    def _struct(self, kind: tuple[str, Type], name: str, fields: Iterable[Field]) -> str:
        if kind not in self._names:
            module, _, short = name.rpartition("::")
            made = self._language.type_name(module or _DEFAULT_MODULE, short)
            self._names[kind] = _unlike(made, self._taken)
            taken: set[str] = set()
            lines = [
                (self._spelled(each.type), _unlike(self._language.field_name(each.name), taken), _about(each.type))
                for each in tuple(fields) or (_NOTHING,)
            ]
            self.texts[self._names[kind]] = self._language.definition(self._names[kind], lines)
        return self._names[kind]

    def _spelled(self, kind: Type) -> str:
        match kind:
            case Primitive.TIME:
                if self._language.time not in self.texts:
                    time = self._language.definition(self._language.time, self._language.time_fields)
                    self.texts[self._language.time] = time
                return self._language.time
            case Primitive():
                return self._language.primitive(kind)
            case Enumeration():
                return self._language.primitive(Primitive.INT32)
            case Struct(name=name, fields=fields):
                return self._struct(("", kind), name, fields)
            case Sequence(Sequence() | Dictionary() as item):
                wrapper = self._struct(("items", item), f"{self._home}::{_word(item)}", (Field("items", item),))
                return self._language.array(wrapper)
            case Sequence(item):
                return self._language.array(self._spelled(item))
            case Dictionary(key, value):
                name = f"{self._home}::{_word(key)}To{_word(value)}Entry"
                entry = self._struct(("entry", kind), name, (Field("key", key), Field("value", value)))
                return self._language.array(entry)


_LONGEST = 60
"""Characters of a name that is made of types."""


def _word(kind: Type) -> str:
    match kind:
        case Primitive():
            return camel(kind.value)
        case Struct(name=name) | Enumeration(name=name):
            return camel(name.rpartition("::")[2])
        case Sequence(item):
            return f"{_word(item)}Sequence"[-_LONGEST:]
        case Dictionary(key, value):
            return f"{_word(key)}To{_word(value)}Entry"[-_LONGEST:]


def _about(kind: Type) -> str:
    """The members of an enumeration that a field holds as a number."""
    match kind:
        case Enumeration(members=members):
            return ", ".join(f"{name} = {number}" for name, number in members)
        case Sequence(item):
            return _about(item)
        case _:
            return ""


def _unlike(name: str, taken: set[str]) -> str:
    """The name, with a number if it is taken; from then on it is. Case does not make names different."""
    found, number = name, 1
    while found.lower() in taken:
        number += 1
        found = f"{name}{number}"
    taken.add(found.lower())
    return found


class _Ros2:
    time = "builtin_interfaces/Time"
    time_fields = (("int32", "sec", ""), ("uint32", "nanosec", ""))

    def type_name(self, module: str, short: str) -> str:
        package, own = package_of(re.sub(r"\W+", "_", module)), camel(short)
        return f"{_begun(package, 'p_')}/{_begun(own, 'T')}"

    def field_name(self, name: str) -> str:
        return _begun(field_name(name.replace("-", "_")), "f_")

    def primitive(self, kind: Primitive) -> str:
        return kind.value

    def array(self, item: str) -> str:
        return f"{item}[]"

    def definition(self, name: str, fields: Iterable[tuple[str, str, str]]) -> str:
        return "".join(f"{kind} {field}{f'  # {about}' if about else ''}\n" for kind, field, about in fields)


def _begun(name: str, letter: str) -> str:
    """The name, with a letter in front if it has none there."""
    return name if name[:1].isalpha() else f"{letter}{name}"


class _Omg:
    time = "builtin_interfaces::Time"
    time_fields = (("int32", "sec", ""), ("uint32", "nanosec", ""))

    def type_name(self, module: str, short: str) -> str:
        return "::".join(map(self.field_name, (*module.split("::"), short)))

    def field_name(self, name: str) -> str:
        name = name.replace("-", "_")
        return f"{name}_" if name.lower() in _IDL_WORDS else name

    def primitive(self, kind: Primitive) -> str:
        return _IDL_TYPES.get(kind, kind.value)

    def array(self, item: str) -> str:
        return f"sequence<{item}>"

    def definition(self, name: str, fields: Iterable[tuple[str, str, str]]) -> str:
        *modules, own = name.split("::")
        before = "".join(f"module {each} {{ " for each in modules)
        lines = "".join(f"    {kind} {field};{f'  // {about}' if about else ''}\n" for kind, field, about in fields)
        return f"{before}struct {own} {{\n{lines}}};{' };' * len(modules)}\n"


_IDL_TYPES = {Primitive.BOOL: "boolean", Primitive.FLOAT32: "float", Primitive.FLOAT64: "double"}

_IDL_WORDS = frozenset(
    re.findall(
        r"\w+",
        """
    abstract any attribute bitfield bitmask bitset boolean case char component connector const consumes context
    custom default double emits enum eventtype exception factory false finder fixed float getraises home import in
    inout int16 int32 int64 int8 interface local long manages map mirrorport module multiple native object octet
    oneway out port porttype primarykey private provides public publishes raises readonly sequence setraises short
    string struct supports switch true truncatable typedef typeid typename typeprefix uint16 uint32 uint64 uint8
    union unsigned uses valuebase valuetype void wchar wstring
    """,
    )
)
"""Words of OMG IDL, which would need an underscore in front that Foxglove takes for a part of the name."""
