"""How model things are spelt in Python: the filters of the templates."""

from __future__ import annotations

import enum
import keyword
import re
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

from ..contract import types as t
from ..contract.component import Component, Port
from ..contract.interface import Interface, Operation, Pattern
from ..contract.module import Constant, Module
from ..contract.parameters import Parameter, ParameterKind, ParameterList, ParameterSet
from ..contract.qos import QoS

WIDTH = 88
"""Generated lines are no longer: what formatters take for granted."""

_RESERVED_ARGUMENTS = {"deadline"}
_ENUM_ATTRIBUTES = {name for name in dir(enum.IntEnum) if not name.startswith("__")} | {"mro", "name", "value"}


def short(name: str) -> str:
    """`RoboCompLaser::TData` → `TData`."""
    return name.rpartition("::")[2]


def module_of(name: str) -> str:
    return name.rpartition("::")[0]


def class_name(name: str) -> str:
    """What a definition is called in its own module."""
    text = short(name)
    return f"{text}_" if keyword.iskeyword(text) or text in _BUSY_NAMES else text


def reference(name: str, here: str) -> str:
    """What a definition is called from a module; `here` is "" outside of all."""
    module = module_of(name)
    return class_name(name) if module == here else f"{module}.{class_name(name)}"


def hint(kind: t.Type, here: str) -> str:
    """The annotation of a value."""
    match kind:
        case t.Primitive():
            return _SCALARS[kind]
        case t.Struct(name=name) | t.Enumeration(name=name):
            return reference(name, here)
        case t.Sequence(name=name) | t.Dictionary(name=name) if name:
            return reference(name, here)
        case _:
            return expanded(kind, here)


def expanded(kind: t.Sequence | t.Dictionary, here: str) -> str:
    """The annotation of a sequence or dictionary, without its own name."""
    match kind:
        case t.Sequence(item):
            if kind.dtype is not None:
                return f"NDArray[np.{kind.dtype.name.replace('bool', 'bool_')}]"
            return f"list[{hint(item, here)}]"
        case t.Dictionary(key, value):
            return f"dict[{hint(key, here)}, {hint(value, here)}]"


def accepted(kind: t.Type, here: str) -> str:
    """The annotation of a value to send: any array-like for an array."""
    return "ArrayLike" if isinstance(kind, t.Sequence) and kind.dtype is not None else hint(kind, here)


def zero(kind: t.Type, here: str, default: Any = None) -> str:
    """An expression for the value of something not set."""
    match kind:
        case t.Primitive():
            return quoted(default) if default is not None else _ZEROS[kind]
        case t.Enumeration(name=name, members=members):
            return f"{reference(name, here)}.{member_name(default or members[0][0])}"
        case t.Struct(name=name):
            return f"{reference(name, here)}()"
        case t.Sequence():
            return f"np.empty(0, np.{kind.dtype.name.replace('bool', 'bool_')})" if kind.dtype is not None else "[]"
        case t.Dictionary():
            return "{}"


def field_default(field: t.Field, here: str) -> str:
    """What stands behind `=` in a dataclass."""
    match field.type:
        case t.Struct(name=name):
            return f"field(default_factory={reference(name, here)})"
        case t.Sequence() if field.type.dtype is None:
            return "field(default_factory=list)"
        case t.Sequence():
            return f"field(default_factory=lambda: {zero(field.type, here)})"
        case t.Dictionary():
            return "field(default_factory=dict)"
        case _:
            return zero(field.type, here, field.default)


def contract(kind: t.Type | t.ExceptionType, here: str) -> str:
    """The expression for a type in a contract."""
    match kind:
        case t.Primitive():
            return kind.name
        case t.Struct(name=name) | t.Enumeration(name=name) | t.ExceptionType(name=name):
            return f"{reference(name, here)}.__contract__"
        case t.Sequence(item):
            return f"Sequence({contract(item, here)})"
        case t.Dictionary(key, value):
            return f"Dictionary({contract(key, here)}, {contract(value, here)})"


def member_name(name: str) -> str:
    """An enumerator in Python; words that enumerations need for themselves get an underscore behind."""
    return f"{name}_" if keyword.iskeyword(name) or name in _ENUM_ATTRIBUTES else name


def argument(field: t.Field) -> str:
    return f"{field.attribute}_" if field.name in _RESERVED_ARGUMENTS else field.attribute


def returns(operation: Operation[Any], here: str) -> str:
    """What an operation returns in Python."""
    hints = [hint(output.type, here) for output in operation.outputs]
    match hints:
        case []:
            return "None"
        case [only]:
            return only
        case _:
            return f"tuple[{', '.join(hints)}]"


def zero_return(operation: Operation[Any]) -> str:
    """What a new handler does: return zeros."""
    zeros = [zero(output.type, "") for output in operation.outputs]
    line = f"return {', '.join(zeros)}"
    if len(line) + 8 <= WIDTH:
        return line
    return "return (\n" + "".join(f"            {each},\n" for each in zeros) + "        )"


def proxy_attribute(port: Port) -> str:
    """`laser_proxy: RoboCompLaser.LaserProxy`."""
    kind = f"{port.interface.module}.{proxy_class(port)}"
    line = f"{port.attribute}: {kind}"
    return line if len(line) + 4 <= WIDTH else f"{port.attribute}: (\n        {kind}\n    )"


def remark(text: str, indent: int) -> str:
    """A comment on as many lines as it needs."""
    lines = textwrap.wrap(text, WIDTH - indent - 2, break_long_words=False, break_on_hyphens=False)
    return f"\n{' ' * indent}".join(f"# {line}" for line in lines)


def proxy_signature(operation: Operation[Any], here: str, suffix: str = "", returned: str = "") -> str:
    """`def getLaserData(self, *, deadline: float | None = None) -> TLaserData:`."""
    arguments = ["self", *(f"{argument(f)}: {accepted(f.type, here)}" for f in operation.inputs)]
    arguments += ["*", "deadline: float | None = None"]
    name = t.python_name(operation.name) if not suffix else operation.name + suffix
    return signature(name, arguments, returned or returns(operation, here))


def handler_signature(port: Port, operation: Operation[Any]) -> str:
    arguments = ["self", *(f"{f.attribute}: {hint(f.type, '')}" for f in operation.inputs)]
    return signature(port.handler(operation.name), arguments, returns(operation, ""))


def signature(name: str, arguments: Sequence[str], returned: str, indent: int = 4) -> str:
    """A `def` line, or one argument a line if it would be too long."""
    line = f"def {name}({', '.join(arguments)}) -> {returned}:"
    if indent + len(line) <= WIDTH:
        return line
    margin = " " * indent
    inner = "".join(f"{margin}    {each},\n" for each in arguments)
    return f"def {name}(\n{inner}{margin}) -> {spread(returned, indent, 5, 1)}:"


def spread(annotation: str, indent: int, before: int, after: int) -> str:
    """An annotation on several lines, if it would be too long for one, with so much around it."""
    head, bracket, rest = annotation.partition("[")
    if not bracket or indent + before + len(annotation) + after <= WIDTH:
        return annotation
    items = _top_level(rest[:-1])
    margin, comma = " " * indent, "," if len(items) > 1 else ""
    inner = "".join(f"{margin}    {spread(item, indent + 4, 0, len(comma))}{comma}\n" for item in items)
    return f"{head}[\n{inner}{margin}]"


def _top_level(text: str) -> list[str]:
    """The parts between commas that stand in no bracket."""
    parts, depth = [""], 0
    for char in text:
        depth += {"[": 1, "]": -1}.get(char, 0)
        if char == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += char
    return [part.strip() for part in parts]


def operation_statement(operation: Operation[Any], here: str) -> str:
    """`_Laser_getLaserData: Operation[TLaserData] = Operation( … )`."""
    name, kind = operation_constant(operation), f"Operation[{returns(operation, here)}]"
    head = f"{name}: {kind}"
    if len(head) + len(" = Operation(") <= WIDTH:
        return f"{head} = {_operation(operation, here, 0)}"
    if len(head) + len(" = (") <= WIDTH:
        return f"{head} = (\n    {_operation(operation, here, 4)}\n)"
    return f"{name}: {spread(kind, 0, len(name) + 2, 13)} = {_operation(operation, here, 0)}"


def _operation(operation: Operation[Any], here: str, indent: int) -> str:
    arguments = [quoted(operation.interface), quoted(operation.name)]
    inner = indent + 4
    for key, fields in (("inputs", operation.inputs), ("outputs", operation.outputs)):
        if fields:
            literals = field_literals(fields, here, inner + 4)
            arguments.append(f"{key}={tuple_of(literals, inner + len(key) + 1, inner)}")
    if operation.raises:
        literals = [contract(each, here) for each in operation.raises]
        arguments.append(f"raises={tuple_of(literals, inner + 7, inner)}")
    arguments += [f"pattern=Pattern.{operation.pattern.name}"] if operation.pattern else []
    arguments += ["idempotent=True"] if operation.idempotent else []
    margin = " " * indent
    return "Operation(\n" + "".join(f"{margin}    {each},\n" for each in arguments) + f"{margin})"


def passed(operation: Operation[Any]) -> str:
    """The arguments of an operation as a tuple."""
    names = [argument(f) for f in operation.inputs]
    return f"({', '.join(names)}{',' if len(names) == 1 else ''})"


def call(function: str, arguments: Sequence[str], indent: int, around: int = 0) -> str:
    """A call in one line, or one argument a line if that, with what is `around` it, would be too long."""
    line = f"{function}({', '.join(arguments)})"
    if indent + len(line) + around <= WIDTH:
        return line
    margin = " " * indent
    inner = "".join(f"{margin}    {each},\n" for each in arguments)
    return f"{function}(\n{inner}{margin})"


def tuple_of(items: Sequence[str], before: int, indent: int = 4) -> str:
    """A tuple, one item a line; a single one in one line if there is room behind `before` characters."""
    line = f"({', '.join(items)},)" if items else "()"
    if not items or (len(items) == 1 and before + len(line) + 1 <= WIDTH):
        return line
    margin = " " * indent
    inner = "".join(f"{margin}    {each},\n" for each in items)
    return f"(\n{inner}{margin})"


def field_literals(fields: Sequence[t.Field], here: str, indent: int = 8) -> list[str]:
    """The `Field( … )` of a contract."""
    return [call("Field", [f'"{each.name}"', contract(each.type, here)], indent, 1) for each in fields]


def member_literals(enumeration: t.Enumeration) -> list[str]:
    return [f'("{name}", {value})' for name, value in enumeration.members]


def operation_constant(operation: Operation[Any]) -> str:
    return f"_{short(operation.interface)}_{operation.name}"


def interface_constant(interface: Interface) -> str:
    return f"{interface.short.upper()}_INTERFACE"


def proxy_class(port: Port) -> str:
    return f"{port.interface.short}{'Publisher' if port.verb.is_topic else 'Proxy'}"


def docstring(text: str, indent: int, quote: str = '"""') -> str:
    """A docstring of wrapped paragraphs; lines that begin with a back-quote stay as they are."""
    safe = text.replace("\\", "\\\\").replace('"""', "'''").strip()
    if safe.endswith('"'):
        safe += " "
    lines: list[str] = []
    for line in (quote + safe).splitlines():
        lines += textwrap.wrap(line, WIDTH - indent, break_long_words=False, break_on_hyphens=False) or [""]
    lines[0] = lines[0].removeprefix(quote)
    margin = " " * indent
    if len(lines) == 1 and indent + len(lines[0]) + 6 <= WIDTH:
        return f"{quote}{lines[0]}{quote}"
    if len(lines) == 1:  # the closing quotes need a line of their own: then the text gets two
        lines = textwrap.wrap(lines[0], WIDTH - indent - 6, break_long_words=False, break_on_hyphens=False)
    body = "\n".join(f"{margin}{line}".rstrip() for line in lines[1:])
    return f"{quote}{lines[0]}\n{body}\n{margin}{quote}".replace(f"\n\n{margin}{quote}", f"\n{margin}{quote}")


def operation_doc(operation: Operation[Any], lead: str = "") -> str:
    """What its IDSL says of an operation, then its declaration there."""
    said = operation.doc.strip()
    said = f"{said[:1].upper()}{said[1:]}" if said else ""
    first = said or lead or f"`{operation.name}` of {operation.interface.replace('::', '.')}."
    return f"{_sentence(first)}\n\nIDSL: {operation.source}"


def _sentence(text: str) -> str:
    return text if text[-1:] in ".!?:" else f"{text}."


def comment(text: str) -> str:
    """The first line of a field's documentation, as a comment behind it."""
    line = " ".join(text.split())
    return f"  # {line}" if line else ""


def struct_doc(name: str, doc: str) -> str:
    lead = doc.strip() or f"{short(name)} of module {module_of(name)}"
    return _sentence(f"{lead[:1].upper()}{lead[1:]}")


def qos_expression(qos: QoS) -> str:
    """`QoS(depth=1)`: what differs from the default."""
    plain = QoS()
    given = []
    for name in QoS.__dataclass_fields__:
        value = getattr(qos, name)
        if value != getattr(plain, name):
            spelt = f"{type(value).__name__}.{value.name}" if isinstance(value, enum.Enum) else repr(value)
            given.append(f"{name}={spelt}")
    return f"QoS({', '.join(given)})"


def parameter_type(parameter: Parameter) -> str:
    match parameter.kind:
        case ParameterKind.INT:
            return "int"
        case ParameterKind.FLOAT | ParameterKind.DOUBLE:
            return "float"
        case ParameterKind.BOOL:
            return "bool"
        case ParameterKind.STRING:
            return "str"
        case ParameterKind.ENUM:
            return f"Literal[{', '.join(quoted(choice) for choice in parameter.choices)}]"


def quoted(value: Any) -> str:
    """A literal, texts in double quotes."""
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'
    return repr(value)


def parameter_expression(parameter: Parameter) -> str:
    """The `Parameter( … )` of a generated set."""
    arguments = [quoted(parameter.name), f"ParameterKind.{parameter.kind.name}", quoted(parameter.default)]
    if parameter.minimum is not None:
        arguments += [f"minimum={parameter.minimum!r}", f"maximum={parameter.maximum!r}"]
    if parameter.choices:
        arguments.append(f"choices=({', '.join(map(quoted, parameter.choices))},)")
    if parameter.mandatory:
        arguments.append("mandatory=True")
    return call("Parameter", arguments, 8, 1)


def toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return quoted(value)


def camel(name: str) -> str:
    """`left_motors` → `LeftMotors`."""
    return "".join(part[:1].upper() + part[1:] for part in re.split(r"[_\W]+", name))


def module_imports(module: Module, ports: Sequence[Port]) -> str:
    """The imports of a module of types and proxies."""
    of = [type(definition) for definition in module.definitions]
    classes = {t.Struct, t.ExceptionType, t.Enumeration} & set(of)
    data = {t.Struct, t.ExceptionType} & set(of)
    arrays = uses_numpy(module)
    numpy_names = [*(["ArrayLike"] if takes_arrays(ports) else []), *(["NDArray"] if arrays else [])]
    typing = [*(["ClassVar"] if classes else []), *(["TypeAlias"] if {t.Sequence, t.Dictionary} & set(of) else [])]
    standard = {
        "dataclasses": ["dataclass", *(["field"] if has_factories(module) else [])] if data else [],
        "enum": ["IntEnum"] if t.Enumeration in of else [],
        "typing": typing,
    }
    return _import_groups(
        [import_from(package, names) for package, names in standard.items() if names],
        [
            *(["import numpy as np"] if arrays else []),
            *_from("numpy.typing", numpy_names),
            *_from("robocomp_py.runtime.api", _api_names(module, ports)),
        ],
        _from(".", modules_used(module)),
    )


def params_imports(scopes: Sequence[tuple[str, ParameterSet]]) -> str:
    choices = any(p.kind is ParameterKind.ENUM for _, scope in scopes for p in scope.parameters)
    api = ["Parameters", "ParameterSet"]
    api += ["Parameter", "ParameterKind"] if any(scope.parameters for _, scope in scopes) else []
    api += ["ParameterList"] if any(scope.lists for _, scope in scopes) else []
    return _import_groups(
        ["from dataclasses import dataclass", f"from typing import ClassVar{', Literal' if choices else ''}"],
        _from("robocomp_py.runtime.api", api),
    )


def worker_imports(component: Component) -> str:
    handles = any(not port.verb.has_proxy and any(port.interface.under(port.verb)) for port in component.ports)
    api = {"Component", "Worker"} | ({"Port", "Verb"} if component.ports else set())
    for expression in (qos_expression(port.qos) for port in component.ports):
        api |= {"QoS"} if expression != "QoS()" else set()
        api |= {name for name in ("Reliability", "Durability", "History", "Liveliness") if f"{name}." in expression}
    modules = {*modules_handled(component.ports), *(port.interface.module for port in component.ports)}
    return _import_groups(
        ["from abc import abstractmethod"] if handles else [],
        _from("robocomp_py.runtime.api", sorted(api)),
        [*_from(".", sorted(modules)), *(["from .params import PARAMS, Params"] if component.params else [])],
    )


def specific_imports(component: Component) -> str:
    operations = [o for p in component.ports if not p.verb.has_proxy for o, _ in p.interface.under(p.verb)]
    zeros = any("np." in zero_return(operation) for operation in operations)
    return _import_groups(
        ["import numpy as np"] if zeros else [],
        [*_from(".generic", modules_handled(component.ports)), "from .generic.genericworker import GenericWorker"],
    )


def _from(package: str, names: Sequence[str]) -> list[str]:
    return [import_from(package, names)] if names else []


def _import_groups(*groups: Sequence[str]) -> str:
    return "\n\n".join("\n".join(group) for group in groups if group)


def _api_names(module: Module, ports: Iterable[Port]) -> list[str]:
    """What a module of types needs from the run time's front door."""
    names: set[str] = set()
    for definition in module.definitions:
        match definition:
            case t.Struct(fields=fields):
                names |= {"Struct"} | _needs(fields)
            case t.Enumeration():
                names.add("Enumeration")
            case t.ExceptionType(fields=fields, base=base):
                names |= {"ExceptionType"} | _needs(fields) | (set() if base else {"DeclaredError"})
            case Interface(operations=operations):
                names |= {"Interface"} | ({"Operation"} if operations else set())
                for operation in operations:
                    names |= _needs((*operation.inputs, *operation.outputs))
                    names |= {"Pattern"} if operation.pattern else set()
    for port in ports:
        names.add("Proxy")
        if any(pattern is Pattern.QUERY for _, pattern in port.interface.under(port.verb)):
            names.add("Future")
    return list(names)


def _needs(fields: Iterable[t.Field]) -> set[str]:
    fields = tuple(fields)
    found = {"Field"} if fields else set()
    waiting: list[t.Type] = [field.type for field in fields]
    while waiting:
        match waiting.pop():
            case t.Primitive() as kind:
                found.add(kind.name)
            case t.Sequence(item):
                found.add("Sequence")
                waiting.append(item)
            case t.Dictionary(key, value):
                found.add("Dictionary")
                waiting += (key, value)
            case _:
                pass
    return found


def modules_used(module: Module) -> list[str]:
    """The other modules whose names a module mentions."""
    mentioned: set[str] = set()
    for definition in module.definitions:
        match definition:
            case t.Struct(fields=fields):
                mentioned |= _mentioned(f.type for f in fields)
            case t.ExceptionType(fields=fields, base=base):
                mentioned |= _mentioned(f.type for f in fields) | ({base.name} if base else set())
            case t.Sequence(item):
                mentioned |= _mentioned([item])
            case t.Dictionary(key, value):
                mentioned |= _mentioned([key, value])
            case Interface(operations=operations):
                for o in operations:
                    mentioned |= _mentioned(f.type for f in (*o.inputs, *o.outputs)) | {e.name for e in o.raises}
    return sorted({module_of(name) for name in mentioned} - {module.name})


def modules_handled(ports: Iterable[Port]) -> list[str]:
    """The modules whose types the handlers of these ports mention."""
    mentioned: set[str] = set()
    for port in ports:
        if not port.verb.has_proxy:
            for o, _ in port.interface.under(port.verb):
                mentioned |= _mentioned(f.type for f in (*o.inputs, *o.outputs))
    return sorted({module_of(name) for name in mentioned})


def _mentioned(kinds: Iterable[t.Type]) -> set[str]:
    """The names by which annotations and contracts refer to these types."""
    found: set[str] = set()
    waiting = list(kinds)
    while waiting:
        match waiting.pop():
            case t.Struct(name=name) | t.Enumeration(name=name):
                found.add(name)
            case t.Sequence(item, name=name):
                found |= {name} if name else set()
                waiting.append(item)
            case t.Dictionary(key, value, name=name):
                found |= {name} if name else set()
                waiting += (key, value)
            case _:
                pass
    return found


def is_array(kind: t.Type) -> bool:
    return isinstance(kind, t.Sequence) and kind.dtype is not None


def constant_value(constant: Constant) -> str:
    return zero(constant.type, module_of(constant.name), constant.value)


_SCALARS = {
    t.BOOL: "bool",
    t.STRING: "str",
    t.TIME: "int",
    **dict.fromkeys(t.INTEGERS, "int"),
    **dict.fromkeys(t.FLOATS, "float"),
}
_ZEROS = {
    t.BOOL: "False",
    t.STRING: '""',
    t.TIME: "0",
    **dict.fromkeys(t.INTEGERS, "0"),
    **dict.fromkeys(t.FLOATS, "0.0"),
}
_BUSY_NAMES = {
    *(kind.name for kind in t.Primitive),
    *("ClassVar", "DeclaredError", "Dictionary", "Enumeration", "ExceptionType", "Field", "Future", "IntEnum"),
    *("Interface", "NDArray", "Operation", "Pattern", "Proxy", "Sequence", "Struct", "TypeAlias", "ArrayLike"),
    *("annotations", "dataclass", "field", "np"),
    *("bool", "dict", "float", "int", "list", "str", "tuple", "property", "super", "type"),
}
"""What a generated module uses for itself; a definition of that name gets an underscore behind."""


def snake(name: str) -> str:
    """A name for a Python function or module."""
    return re.sub(r"\W+", "_", name).lower()


def self_dot(name: str) -> str:
    return f"self.{name}"


def one_line(text: str) -> str:
    """The first sentence or line of a documentation."""
    line = " ".join(text.strip().split("\n\n")[0].split())
    return line[:1].upper() + line[1:]


def duration(seconds: float) -> str:
    """`50 ms`, `2 s`."""
    return f"{seconds * 1000:g} ms" if seconds < 1 else f"{seconds:g} s"


def import_from(package: str, names: Iterable[str]) -> str:
    """An import in one line, or one name a line if it would be too long; constants first, then classes."""
    ordered = sorted(names, key=_import_order)
    line = f"from {package} import {', '.join(ordered)}"
    if len(line) <= WIDTH:
        return line
    return f"from {package} import (\n" + "".join(f"    {name},\n" for name in ordered) + ")"


def _import_order(name: str) -> tuple[int, list[str | int]]:
    """As isort has it: CONSTANTS, Classes, functions; numbers in names by their value."""
    rank = 0 if name.isupper() and len(name) > 1 else 1 if name[:1].isupper() else 2
    return rank, [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name.lower())]


def beside(text: str, comment: str) -> str:
    """A line of TOML with a comment, aligned with the others."""
    return f"{text:<26} # {comment}"


def field_line(field: t.Field, here: str) -> str:
    """A field of a dataclass, its documentation behind it or, if it is long, above it."""
    line = f"    {field.attribute}: {hint(field.type, here)} = {field_default(field, here)}"
    behind = comment(field.doc)
    if not behind or len(line) + len(behind) <= WIDTH:
        return line + behind
    above = textwrap.wrap(behind.strip(" #"), WIDTH - 6, break_long_words=False, break_on_hyphens=False)
    return "\n".join(f"    # {text}" for text in above) + f"\n{line}"


def port_expression(port: Port, indent: int) -> str:
    """The `Port( … )` of a generated component."""
    module = port.interface.module
    arguments = [f"Verb.{port.verb.name}", f"{module}.{interface_constant(port.interface)}"]
    if port.number:
        arguments.append(f'number="{port.number}"')
    if qos_expression(port.qos) != "QoS()":
        arguments.append(f"qos={qos_expression(port.qos)}")
    if port.concurrent:
        arguments.append("concurrent=True")
    if port.middleware:
        arguments.append(f'middleware="{port.middleware}"')
    if port.verb.has_proxy:
        arguments.append(f"proxy={module}.{proxy_class(port)}")
    return call("Port", arguments, indent, 1)


def parameter_comment(parameter: Parameter) -> str:
    """What a parameter means and which values it may have, behind its line."""
    words = [" ".join(parameter.description.split())] if parameter.description else []
    if parameter.minimum is not None:
        words.append(f"{parameter.minimum} to {parameter.maximum}")
    return f"  # {', '.join(words)}" if words else ""


def item_class(items: ParameterSet) -> str:
    """The class of a list's items: `motors` → `MotorsItem`."""
    return f"{camel(items.name)}Item"


def list_expression(each: ParameterList) -> str:
    """The `ParameterList( … )` of a generated set."""
    arguments = [quoted(each.name), f"{item_class(each.items)}.__spec__"]
    if each.minimum or each.maximum is not None:
        arguments += [f"minimum={each.minimum}", f"maximum={each.maximum}"]
    return call("ParameterList", arguments, 8, 1)


def toml_params(params: ParameterSet) -> str:
    """The `[params]` table: every parameter with its default, and an example of each list."""
    return "\n".join(_toml_lines(params, "params"))


def _toml_lines(params: ParameterSet, path: str, mark: str = "") -> list[str]:
    lines = []
    for parameter in params.parameters:
        line = f"{mark}{parameter.name} = {toml(parameter.default)}"
        words = [" ".join(parameter.description.split())] if parameter.description else []
        words.append(parameter.allowed())
        words += ["mandatory"] if parameter.mandatory else []
        lines.append(beside(line, "; ".join(words)))
    for each in params.lists:
        limit = "any number" if each.maximum is None else f"{each.minimum} to {each.maximum}"
        lines += ["", f"# {each.name}: {limit} of these; {each.description or 'repeat the table for each'}"]
        needed = "" if each.minimum and not mark else "# "
        for _ in range(max(1, each.minimum if not mark else 1)):
            lines += [f"{needed}[[{path}.{each.name}]]", *_toml_lines(each.items, f"{path}.{each.name}", needed)]
    return lines


def uses_numpy(module: Module) -> bool:
    """Whether annotations of a module mention arrays."""
    for definition in module.definitions:
        match definition:
            case t.Struct(fields=fields) | t.ExceptionType(fields=fields):
                if any(_spells_array(f.type) or is_array(f.type) for f in fields):
                    return True
            case t.Sequence() | t.Dictionary():
                if "NDArray" in expanded(definition, module.name):
                    return True
            case Interface(operations=operations):
                if any(_spells_array(f.type) for o in operations for f in o.outputs):
                    return True
            case _:
                pass
    return False


def _spells_array(kind: t.Type) -> bool:
    return "NDArray" in hint(kind, "")


def takes_arrays(ports: Sequence[Port]) -> bool:
    """Whether a proxy of these ports has an array among its arguments."""
    operations = [o for port in ports for o, _ in port.interface.under(port.verb)]
    return any(is_array(f.type) for o in operations for f in o.inputs)


def has_factories(module: Module) -> bool:
    """Whether a dataclass of a module needs `field( … )`."""
    fields = [f for d in module.definitions if isinstance(d, t.Struct | t.ExceptionType) for f in d.fields]
    return any(isinstance(f.type, t.Struct | t.Sequence | t.Dictionary) for f in fields)
