"""Exports IDSL to the `.msg` and `.srv` files of ROS 2: a package for each module, which colcon builds.

    module RoboCompLaser      package robocomp_laser
    struct, exception         msg/Name.msg; an exception includes the fields of its bases
    enum                      int32, and msg/Name.msg with its constants
    sequence                  an array; inside another one, msg/Name.msg with a single field `items`
    dictionary                an array of msg/NameEntry.msg, each with a key and a value
    time                      builtin_interfaces/Time
    const                     msg/Constants.msg
    query                     srv/InterfaceOperation.srv
    publication, command      msg/InterfaceOperation.msg
    without a pattern         both

Types are CamelCase, fields lower_snake_case, constants UPPER_SNAKE_CASE, as ROS demands.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any

from ..contract import types as t
from ..contract.interface import Action, Interface, Operation, Pattern
from ..contract.module import Constant, Module
from ..contract.rosnames import camel, field_name, package_of, snake
from ..dsl.diagnostics import Report
from ..dsl.idsl import model as m
from ..dsl.source import Name, Span
from ..printable import spaced
from .basictypes import SPELLED
from .exporting import Files, heading
from .generate import Artifact
from .names import module_of, short

WIDTH = 100


def to_rosmsg(files: Files, report: Report) -> tuple[Artifact, ...]:
    """A package for each module; reports what ROS cannot express."""
    packages = [_Package(module, files, report) for module in files.contracts]
    for package in packages:
        package.fill()
    _check_packages(packages, files, report)
    return tuple(artifact for package in packages if package.texts for artifact in package.artifacts())


def _check_packages(packages: Iterable[_Package], files: Files, report: Report) -> None:
    places = {file.module.text: file.module for file in files.all}
    seen: dict[str, Name] = {}
    for package in packages:
        at = places[package.module.name]
        first = seen.setdefault(package.name, at)
        if first is not at:
            message = f"`{first}` and `{at}` would both become the package {package.name}"
            report.error("not-in-rosmsg", message, at.span, "rename one of them", ("first here", first.span))


@dataclass
class _Package:
    module: Module
    files: Files
    report: Report
    texts: dict[str, str] = field(default_factory=dict)
    """Its files, by path: `msg/TData.msg`."""
    uses: set[str] = field(default_factory=set)
    """The packages that it depends on."""
    _origins: dict[str, Name] = field(default_factory=dict)
    """The definition that each file comes from."""
    _wrappers: set[str] = field(default_factory=set)

    @property
    def name(self) -> str:
        return package_of(self.module.name)

    def fill(self) -> None:
        constants = [each for each in self.module.definitions if isinstance(each, Constant)]
        feedback = {action.feedback for each in self._interfaces for action in each.actions}
        for each in self.module.definitions:
            if not isinstance(each, t.Sequence | Constant | Interface) and each not in feedback:
                self._definition(each, self._syntax(each.name).name)
        if constants:
            lines = list(self._constants(constants))
            self._add("msg/Constants.msg", lines, self._syntax(constants[0].name).name)
        for each in self._interfaces:
            for operation in each.operations:
                self._operation(each, operation)
            for action in each.actions:
                self._action(each, action)

    @property
    def _interfaces(self) -> list[Interface]:
        return [each for each in self.module.definitions if isinstance(each, Interface)]

    def artifacts(self) -> Iterator[Artifact]:
        about = heading(", ".join(self.module.files))
        others = sorted(self.uses)
        texts = {path: f"# {about}\n{text}" for path, text in sorted(self.texts.items())}
        texts["CMakeLists.txt"] = _cmake(self.name, sorted(self.texts), others, about)
        texts["package.xml"] = _package_xml(self.name, self.module.name, others, about)
        for path, text in texts.items():
            yield Artifact(PurePosixPath(self.name) / path, text)

    # Definitions of the module.

    def _definition(self, kind: t.Struct | t.Enumeration | t.Dictionary | t.ExceptionType, at: Name) -> None:
        name = short(kind.name)
        match kind:
            case t.Enumeration(doc=doc):
                self._add(f"msg/{self._type_name(at)}.msg", [*_comment(doc), *self._members(kind)], at)
            case t.Dictionary():
                self._entry(kind, at)
            case t.Struct(fields=fields, doc=doc):
                lines = self._fields(fields, self._field_names(name), at, f"of `{name}`")
                self._add(f"msg/{self._type_name(at)}.msg", [*_comment(doc), *lines], at)
            case t.ExceptionType(all_fields=fields, doc=doc):
                names = self._field_names(name)
                lines = self._fields(fields, names, at, f"of `{name}`")
                about = _comment(" ".join(filter(None, (doc, "An exception, which services in ROS cannot throw."))))
                self._add(f"msg/{self._type_name(at)}.msg", [*about, *lines], at)

    def _entry(self, kind: t.Dictionary, at: Name) -> None:
        """The message for the entries of a dictionary."""
        lines = [f"{self._spelled(kind.key, at)} key", f"{self._spelled(kind.value, at)} value"]
        self._add(f"msg/{camel(short(kind.name))}Entry.msg", lines, at)

    def _members(self, kind: t.Enumeration) -> Iterator[str]:
        syntax = self._syntax(kind.name)
        assert isinstance(syntax, m.Enum)
        seen: dict[str, str] = {}
        for (member, value), at in zip(kind.members, syntax.members, strict=True):
            yield f"int32 {self._check_constant(member, seen, at.name)}={value}"

    def _constants(self, constants: Iterable[Constant]) -> Iterator[str]:
        seen: dict[str, str] = {}
        for each in constants:
            at = self._syntax(each.name).name
            name = self._check_constant(short(each.name), seen, at)
            kind = each.type
            if kind is t.TIME:
                self._lossy(
                    f"a constant in ROS cannot be a time; `{at}` becomes int64, nanoseconds since 1970", at.span
                )
                kind = t.INT64
            value = each.value
            if isinstance(kind, t.Enumeration):
                value = dict(kind.members)[value]
            yield from _comment(each.doc)
            yield f"{self._spelled(kind, at)} {name}={_literal(value)}"

    def _check_constant(self, name: str, seen: dict[str, str], at: Name) -> str:
        upper = _upper(name)
        if not re.fullmatch(r"[A-Z][A-Z0-9_]*", upper):
            self._refuse(f"`{name}` is not a valid constant name in ROS: it must begin with a letter", at)
        elif seen.setdefault(upper, name) != name:
            self._refuse(f"`{seen[upper]}` and `{name}` would both become the constant {upper}", at)
        return upper

    # Operations.

    def _operation(self, interface: Interface, operation: Operation[Any]) -> None:
        syntax = self._operation_syntax(interface, operation)
        name = f"{camel(interface.short)}{camel(operation.name)}"
        for thrown in syntax.throws:
            self._lossy(f"services in ROS cannot throw; the caller will not get `{thrown}`", thrown.span)
        pattern, twice = f"[{operation.pattern}]" if operation.pattern else "", "idempotent" * operation.idempotent
        title = " ".join(filter(None, (f"{interface.short}.{operation.name}", pattern, twice)))
        about = list(_comment(": ".join(filter(None, (title, operation.doc)))))
        params = {param.name.text: param.name for param in syntax.params}
        given = self._fields(operation.inputs, params, syntax.name, f"of `{operation.name}`")
        if operation.pattern in (None, Pattern.QUERY):
            raised = ", ".join(short(each.name) for each in operation.raises)
            back = self._fields(operation.outputs, params, syntax.name, f"in the answer of `{operation.name}`")
            answer = [f"# throws {raised}", *back] if raised else back
            self._add(f"srv/{name}.srv", [*about, *given, "---", *answer], syntax.name)
        one_way = operation.pattern in (Pattern.PUBLISH, Pattern.COMMAND)
        if one_way or (operation.pattern is None and not operation.outputs and not operation.raises):
            self._add(f"msg/{name}.msg", [*about, *given], syntax.name)

    def _action(self, interface: Interface, action: Action) -> None:
        syntax = self._operation_syntax(interface, action)
        for thrown in syntax.throws:
            self._lossy(f"actions in ROS cannot throw; the client will not get `{thrown}`", thrown.span)
        title = f"{interface.short}.{action.name} [action]"
        params = {param.name.text: param.name for param in (*syntax.params, *syntax.feedback)}
        told = action.feedback.fields if action.feedback else ()
        parts = [
            self._fields(fields, params, syntax.name, f"of `{action.name}`")
            for fields in (action.inputs, action.outputs, told)
        ]
        about = _comment(": ".join(filter(None, (title, action.doc))))
        lines = [*about, *parts[0], "---", *parts[1], "---", *parts[2]]
        self.uses.add("action_msgs")
        self._add(f"action/{camel(interface.short)}{camel(action.name)}.action", lines, syntax.name)

    # Fields.

    def _fields(self, fields: Iterable[t.Field], places: Mapping[str, Name], at: Name, whose: str) -> list[str]:
        renamed, seen, lines = dict[str, str](), dict[str, str](), list[str]()
        for each in fields:
            where = places.get(each.name, at)
            name = field_name(each.name)
            first = seen.setdefault(name, each.name)
            if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
                self._refuse(f"`{each.name}` is not a valid field name in ROS: it must begin with a letter", where)
            elif first != each.name:
                self._refuse(f"`{first}` and `{each.name}` would both become the field {name}", where)
            elif name != each.name:
                renamed[each.name] = name
            lines += self._field(each, name, where)
        if renamed:
            listed = ", ".join(f"{old} → {new}" for old, new in renamed.items())
            first_place = places.get(next(iter(renamed)), at)
            self.report.warning("renamed-in-rosmsg", f"fields {whose} are renamed: {listed}", first_place.span)
        return lines

    def _field(self, each: t.Field, name: str, at: Name) -> Iterator[str]:
        value = each.default
        if each.type is t.TIME and value is not None:
            self._lossy(f"a time in ROS cannot have a default; the default of `{at}` is omitted", at.span)
            value = None
        if value is not None and isinstance(each.type, t.Enumeration):
            value = dict(each.type.members)[value]
        line = f"{self._spelled(each.type, at)} {name}{'' if value is None else f' {_literal(value)}'}"
        about = ": ".join(filter(None, (_enumeration(each.type), " ".join(spaced(each.doc).split()))))
        if about and len(line) + len(about) + 4 <= WIDTH:
            yield f"{line}  # {about}"
        else:
            yield from _comment(about)
            yield line

    def _field_names(self, definition: str) -> dict[str, Name]:
        """The names of the fields of a struct, or of an exception and its bases, with their places."""
        found = self._syntax(f"{self.module.name}::{definition}")
        syntaxes: list[m.Definition] = [found]
        if isinstance(found, m.Exception_):
            syntaxes += [base for _, base in self.files.bases(found, self.module.name)]
        return {
            each.name.text: each.name
            for syntax in syntaxes
            if isinstance(syntax, m.Struct | m.Exception_)
            for each in syntax.fields
        }

    # Types.

    def _spelled(self, kind: t.Type, at: Name) -> str:
        match kind:
            case t.Primitive():
                spelled = SPELLED[kind].ros
                if "/" in spelled:
                    self.uses.add(spelled.partition("/")[0])
                return spelled
            case t.Enumeration():
                return "int32"
            case t.Struct(name=name):
                return self._reference(module_of(name), camel(short(name)))
            case t.Dictionary(name=name):
                return f"{self._reference(module_of(name), f'{camel(short(name))}Entry')}[]"
            case t.Sequence(item=t.Sequence() | t.Dictionary() as item):
                return f"{self._wrapper(item, at)}[]"
            case t.Sequence(item=item):
                return f"{self._spelled(item, at)}[]"

    def _wrapper(self, kind: t.Sequence | t.Dictionary, at: Name) -> str:
        """A message around a type that cannot be the item of an array."""
        name = self._item_name(kind)
        path = f"msg/{name}.msg"
        if path not in self._wrappers:
            self._wrappers.add(path)
            own = bool(kind.name) and module_of(kind.name) == self.module.name
            place = self._syntax(kind.name).name if own else at
            self._add(path, [f"{self._spelled(kind, place)} items"], place)
        return name

    def _item_name(self, kind: t.Type) -> str:
        """The name of a type among the messages of this package: `Float32Sequence` if it has no name."""
        if isinstance(kind, t.Primitive):
            return camel(kind.value)
        if isinstance(kind, t.Sequence) and not kind.name:
            return f"{self._item_name(kind.item)}Sequence"
        module = module_of(kind.name)
        return camel(short(kind.name)) if module == self.module.name else camel(f"{module}_{short(kind.name)}")

    def _reference(self, module: str, name: str) -> str:
        if module == self.module.name:
            return name
        self.uses.add(package_of(module))
        return f"{package_of(module)}/{name}"

    def _type_name(self, name: Name) -> str:
        found = camel(name.text)
        if not re.fullmatch(r"[A-Z][A-Za-z0-9]*", found):
            self._refuse(f"`{name}` is not a valid message name in ROS: it must begin with a letter", name)
        elif found != name.text:
            self.report.warning("renamed-in-rosmsg", f"`{name}` is renamed: {found}", name.span)
        return found

    # Files and places.

    def _add(self, path: str, lines: Iterable[str], at: Name) -> None:
        first = self._origins.setdefault(path, at)
        if first is not at:
            name = PurePosixPath(path).name
            related = ("first here", first.span)
            message = f"`{first}` and `{at}` would both become {path}"
            self.report.error(
                "not-in-rosmsg", message, at.span, f"rename one of them, so that only one becomes {name}", related
            )
        self.texts[path] = "\n".join(lines) + "\n"

    def _syntax(self, name: str) -> m.Definition:
        return self.files.scope[name]

    def _operation_syntax(self, interface: Interface, operation: Operation[Any] | Action) -> m.Operation:
        syntax = self._syntax(interface.name)
        assert isinstance(syntax, m.Interface)
        inherited = (each for _, each in self.files.bases(syntax, self.module.name))
        there = [syntax, *(each for each in inherited if isinstance(each, m.Interface))]
        return next(o for each in there for o in each.operations if o.name.text == operation.name)

    def _refuse(self, message: str, at: Name) -> None:
        self.report.error("not-in-rosmsg", message, at.span, "rename it")

    def _lossy(self, message: str, at: Span) -> None:
        self.report.warning("lossy-in-rosmsg", message, at)


def _upper(name: str) -> str:
    return snake(name).upper()


def _literal(value: Any) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            return f'"{spaced(value)}"'
        case _:
            return repr(value)


def _enumeration(kind: t.Type) -> str:
    """The enumeration that a field holds as a number."""
    match kind:
        case t.Enumeration(name=name):
            return camel(short(name))
        case t.Sequence(item):
            return _enumeration(item)
        case _:
            return ""


def _comment(text: str) -> Iterator[str]:
    for line in textwrap.wrap(spaced(text), WIDTH - 2, break_long_words=False, break_on_hyphens=False):
        yield f"# {line}"


def _cmake(package: str, paths: list[str], uses: list[str], about: str) -> str:
    found = "".join(f"find_package({each} REQUIRED)\n" for each in uses)
    listed = "".join(f'  "{path}"\n' for path in paths)
    dependencies = f"  DEPENDENCIES {' '.join(uses)}\n" if uses else ""
    return (
        f"# {about}\n\ncmake_minimum_required(VERSION 3.8)\nproject({package})\n\n"
        f"find_package(ament_cmake REQUIRED)\nfind_package(rosidl_default_generators REQUIRED)\n{found}\n"
        f"rosidl_generate_interfaces(${{PROJECT_NAME}}\n{listed}{dependencies})\n\n"
        "ament_export_dependencies(rosidl_default_runtime)\nament_package()\n"
    )


def _package_xml(package: str, module: str, uses: list[str], about: str) -> str:
    depends = "".join(f"  <depend>{each}</depend>\n" for each in uses)
    return (
        f"<!-- {about.replace('--', '- -')} -->\n"
        '<package format="3">\n'
        f"  <name>{package}</name>\n"
        "  <version>0.0.0</version>\n"
        f"  <description>The types and operations of {module}</description>\n"
        '  <maintainer email="you@example.org">TODO: maintainer</maintainer>\n'
        "  <license>TODO: the license of the IDSL file</license>\n"
        "  <buildtool_depend>ament_cmake</buildtool_depend>\n"
        "  <buildtool_depend>rosidl_default_generators</buildtool_depend>\n"
        f"{depends}"
        "  <exec_depend>rosidl_default_runtime</exec_depend>\n"
        "  <member_of_group>rosidl_interface_packages</member_of_group>\n"
        "  <export>\n    <build_type>ament_cmake</build_type>\n  </export>\n"
        "</package>\n"
    )
