"""Contracts as Python expressions: annotations, default values, and the literals in generated code."""

from __future__ import annotations

import enum
from collections.abc import Iterator, Sequence
from keyword import iskeyword
from typing import Any

from ..contract import types as t
from ..contract.component import Component, Port
from ..contract.interface import Interface, Operation, Pattern
from ..contract.module import Constant
from ..contract.qos import QoS
from .layout import WIDTH, assigned, call, capital, commented, docstring, quoted, signature, spread, tuple_of
from .names import (
    argument,
    class_name,
    handler_class,
    interface_constant,
    loan,
    loan_arguments,
    member_name,
    message_class,
    method,
    module_name,
    module_of,
    operation_constant,
    proxy_class,
    reference,
    short,
    twin,
)
from .shadows import Shadows

# Annotations.


def hint(kind: t.Type, here: str) -> str:
    """The annotation of a value."""
    match kind:
        case t.Primitive():
            return kind.python.__name__
        case t.Struct(name=name) | t.Enumeration(name=name):
            return reference(name, here)
        case t.Sequence(name=name) | t.Dictionary(name=name) if name:
            return reference(name, here)
        case _:
            return expanded(kind, here)


def expanded(kind: t.Sequence | t.Dictionary, here: str) -> str:
    """The annotation of a sequence or dictionary, without its own name."""
    match kind:
        case t.Sequence(records=True):
            return "NDArray[np.void]"
        case t.Sequence(item):
            return f"NDArray[{_dtype(item)}]" if is_array(kind) else f"list[{hint(item, here)}]"
        case t.Dictionary(key, value):
            return f"dict[{hint(key, here)}, {hint(value, here)}]"


def accepted(kind: t.Type, here: str) -> str:
    """The annotation of an argument: any array-like value is accepted for an array, and a list for records."""
    if isinstance(kind, t.Sequence) and kind.records:
        return f"{hint(kind, here)} | list[{hint(kind.item, here)}]"
    return "ArrayLike" if is_array(kind) else hint(kind, here)


def returns(operation: Operation[Any], here: str) -> str:
    """The return annotation of an operation."""
    hints = [hint(output.type, here) for output in operation.outputs]
    match hints:
        case []:
            return "None"
        case [only]:
            return only
        case _:
            return f"tuple[{', '.join(hints)}]"


def is_array(kind: t.Type) -> bool:
    return isinstance(kind, t.Sequence) and kind.is_array


def _dtype(item: t.Type) -> str:
    assert isinstance(item, t.Primitive)
    return f"np.{item.value.replace('bool', 'bool_')}"


# Values.


def zero(kind: t.Type, here: str, default: Any = None) -> str:
    """An expression for the default value of a type."""
    match kind:
        case t.Primitive():
            return quoted(default) if default is not None else quoted(kind.zero)
        case t.Enumeration(name=name, members=members):
            return f"{reference(name, here)}.{member_name(default or members[0][0])}"
        case t.Struct(name=name):
            return f"{reference(name, here)}()"
        case t.Sequence(item, records=True):
            return f"np.empty(0, dtype_of({hint(item, here)}))"
        case t.Sequence(item):
            return f"np.empty(0, {_dtype(item)})" if is_array(kind) else "[]"
        case t.Dictionary():
            return "{}"


def constant_statement(constant: Constant) -> str:
    value = zero(constant.type, module_of(constant.name), constant.value)
    return commented(assigned(class_name(constant.name), value, 0), constant.doc, 0)


# The members of generated classes. Names of earlier members shadow those of the module: see `Shadows`.


def field_line(field: t.Field, here: str, shadows: Shadows) -> str:
    """A field of a dataclass, with its documentation."""
    head = f"{field.attribute}: {shadows.avoid(hint(field.type, here))}"
    factory = _factory(field.type, here)
    if factory:
        arguments = [f"default_factory={shadows.avoid(factory)}"]
        line = f"{head} = {call(shadows.avoid('field'), arguments, 4, len(head) + 3)}"
    else:
        line = assigned(head, shadows.avoid(zero(field.type, here, field.default)), 4)
    return commented(line, field.doc, 4)


def _factory(kind: t.Type, here: str) -> str:
    """The default factory of a mutable type; "" for an immutable one."""
    match kind:
        case t.Struct(name=name):
            return reference(name, here)
        case t.Sequence():
            return f"lambda: {zero(kind, here)}" if is_array(kind) else "list"
        case t.Dictionary():
            return "dict"
        case _:
            return ""


def field_shadows(fields: Sequence[t.Field], here: str) -> Shadows:
    """The names that the fields of a class hide from later fields."""
    shadows = Shadows()
    for field in fields:
        factory = _factory(field.type, here)
        value = f"field {factory}" if factory else zero(field.type, here, field.default)
        shadows.member(field.attribute, f"{hint(field.type, here)} {value}")
    shadows.member("__contract__", "ClassVar Struct ExceptionType")
    return shadows


def proxy_signature(operation: Operation[Any], here: str, shadows: Shadows) -> str:
    """`def getLaserData(self, *, deadline: float | None = None) -> TLaserData:`."""
    return _signature(method(operation), operation, returns(operation, here), here, shadows)


def twin_signature(operation: Operation[Any], interface: Interface, here: str, shadows: Shadows) -> str:
    """`def getLaserDataAsync(self, *, deadline: float | None = None) -> Future[TLaserData]:`."""
    return _signature(twin(operation, interface), operation, f"Future[{returns(operation, here)}]", here, shadows)


def _signature(name: str, operation: Operation[Any], returned: str, here: str, shadows: Shadows) -> str:
    arguments = ["self"]
    for field in operation.inputs:
        annotation = shadows.avoid(accepted(field.type, here))
        default = f" = {shadows.avoid(zero(field.type, here, field.default))}" if field.default is not None else ""
        arguments.append(f"{argument(field)}: {annotation}{default}")
    arguments += ["*", f"deadline: {shadows.avoid('float')} | None = None"]
    return signature(name, arguments, shadows.avoid(returned))


def loan_signature(operation: Operation[Any], interface: Interface, here: str, shadows: Shadows) -> str:
    """`def loanPushImage(self, image: int | tuple[int, ...], *, …) -> AbstractContextManager[TImage]:`."""
    shape = shadows.avoid("int | tuple[int, ...]")
    arguments = [f"{name}: {shape}" for name in loan_arguments(operation)]
    if len(arguments) > 1:
        arguments = ["*", *(f"{each} = 0" for each in arguments)]
    else:
        arguments.append("*")
    arguments = ["self", *arguments, f"deadline: {shadows.avoid('float')} | None = None"]
    returned = f"AbstractContextManager[{loan_message(operation, here)}]"
    return signature(loan(operation, interface), arguments, shadows.avoid(returned))


def loan_message(operation: Operation[Any], here: str) -> str:
    """The class of the message to fill: that of the operation's only parameter, or a generated one."""
    return message_class(operation) if has_message(operation) else hint(operation.inputs[0].type, here)


def has_message(operation: Operation[Any]) -> bool:
    """Whether a class is generated that holds the parameters of an operation while they are filled."""
    return len(operation.inputs) != 1 or not isinstance(operation.inputs[0].type, t.Struct)


def can_lend(operation: Operation[Any], pattern: Pattern) -> bool:
    """Whether a message of an operation can be filled in place."""
    return pattern is not Pattern.QUERY and any(t.arrays(operation.inputs))


def loan_passed(operation: Operation[Any]) -> str:
    """The shapes of its arrays as a tuple."""
    names = loan_arguments(operation)
    line = f"({', '.join(names)}{',' if len(names) == 1 else ''})"
    return line if len(line) + 13 <= WIDTH else tuple_of(names, 12, 12)


def loan_doc(operation: Operation[Any]) -> str:
    many = len(loan_arguments(operation)) > 1
    given, they = ("arrays of these shapes", "The arrays") if many else ("an array of this shape", "The array")
    return (
        f"`{operation.name}` with {given}, to be filled in the memory that is sent.\n\n"
        f"The message is sent at the end of the `with` block, unless it raises. {they} "
        "must be filled completely, and must not be used after the block."
    )


def proxy_shadows(port: Port, here: str) -> Shadows:
    """The names that the methods of a proxy hide from later methods."""
    shadows = Shadows()
    for operation, pattern in port.interface.under(port.verb):
        uses = [accepted(each.type, here) for each in operation.inputs]
        uses += [zero(each.type, here, each.default) for each in operation.inputs if each.default is not None]
        uses += [returns(operation, here), "float", "Future"]
        shadows.member(method(operation), " ".join(uses))
        if pattern is Pattern.QUERY:
            shadows.member(twin(operation, port.interface), " ".join(uses))
        if can_lend(operation, pattern):
            lent = f"int tuple float AbstractContextManager {loan_message(operation, here)}"
            shadows.member(loan(operation, port.interface), lent)
    return shadows


def fakes_class(port: Port) -> str:
    """`Laser1Fakes`."""
    return f"{class_name(port.label)}Fakes"


def is_keyword(port: Port) -> bool:
    """Whether the name of a port is a keyword of Python, so that no class can have such a member."""
    return iskeyword(port.name)


def nameable(port: Port) -> list[Operation[Any]]:
    """The operations that can be members of a class: all but those whose names are keywords of Python."""
    return [each for each, _ in port.interface.under(port.verb) if not iskeyword(each.name)]


def fake_line(operation: Operation[Any], shadows: Shadows) -> str:
    """`getLaserData: Fake[RoboCompLaser.TLaserData]`."""
    returned = shadows.avoid(returns(operation, ""))
    line = f"{operation.name}: {shadows.avoid('Fake')}[{returned}]"
    return line if len(line) + 4 <= WIDTH else f"{line[: -len(returned) - 1]}\n        {returned}\n    ]"


def fake_shadows(port: Port) -> Shadows:
    """The names that the operations of an interface hide from later ones."""
    shadows = Shadows()
    for operation in nameable(port):
        shadows.member(operation.name, f"{returns(operation, '')} Fake")
    return shadows


def handler_signature(port: Port, operation: Operation[Any]) -> str:
    arguments = ["self", *(f"{argument(f)}: {hint(f.type, '')}" for f in operation.inputs)]
    return signature(port.handler(operation.name), arguments, returns(operation, ""))


def handler(port: Port, operation: Operation[Any], first: str = "") -> str:
    """A new handler: a method that returns default values. `first` is its first line if it is not the usual one."""
    lines = [first or handler_signature(port, operation), f"    {docstring(operation_doc(operation), 8)}"]
    zeros = [zero(output.type, "") for output in operation.outputs]
    line = f"return {', '.join(zeros)}"
    if zeros and len(line) + 8 > WIDTH:
        line = "return (\n" + "".join(f"            {each},\n" for each in zeros) + "        )"
    lines += [f"    {line}"] if zeros else []
    return "".join(f"    {line}\n" for line in lines)


def proxy_attribute(port: Port) -> str:
    """`laser_proxy: RoboCompLaser.LaserProxy`."""
    kind = f"{module_name(port.interface.module)}.{proxy_class(port)}"
    line = f"{port.attribute}: {kind}"
    return line if len(line) + 4 <= WIDTH else f"{port.attribute}: (\n        {kind}\n    )"


def passed(operation: Operation[Any]) -> str:
    """The arguments of an operation as a tuple."""
    names = [argument(f) for f in operation.inputs]
    return f"({', '.join(names)}{',' if len(names) == 1 else ''})"


# Contracts.


def contract(kind: t.Type | t.ExceptionType, here: str) -> str:
    """The expression for a type in a contract."""
    match kind:
        case t.Primitive():
            return kind.name
        case t.Struct(name=name) | t.Enumeration(name=name) | t.ExceptionType(name=name):
            return f"{reference(name, here)}.__contract__"
        case t.Sequence(item):
            return f"Sequence({contract(item, here)}{', records=True' if kind.records else ''})"
        case t.Dictionary(key, value, name):
            return f"Dictionary({', '.join(_dictionary_arguments(key, value, name, here))})"


def _dictionary_arguments(key: t.Type, value: t.Type, name: str, here: str) -> list[str]:
    named = [f'"{name}"'] if name else []  # DDS shows it
    return [contract(key, here), contract(value, here), *named]


def field_literals(fields: Sequence[t.Field], here: str, indent: int = 8) -> list[str]:
    """The `Field( … )` of a contract."""
    made = []
    for field in fields:
        line = call("Field", list(_field_arguments(field, here, 0)), indent, 1)
        made.append(call("Field", list(_field_arguments(field, here, indent + 4)), indent, 1) if "\n" in line else line)
    return made


def _field_arguments(field: t.Field, here: str, indent: int) -> Iterator[str]:
    """`indent` is that of a type on a line of its own; 0: all is on one line."""
    yield f'"{field.name}"'
    match field.type:
        case t.Dictionary(key, value, name) if indent:
            yield call("Dictionary", _dictionary_arguments(key, value, name, here), indent, 1)
        case _:
            yield contract(field.type, here)
    if field.default is not None:
        yield quoted(field.default)
    if field.doc:
        yield f"doc={quoted(field.doc)}"


def member_literals(enumeration: t.Enumeration) -> list[str]:
    return [f'("{name}", {value})' for name, value in enumeration.members]


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
    arguments += ["confirm=True"] if operation.confirm else []
    arguments += [f"doc={quoted(operation.doc)}"] if operation.doc else []
    margin = " " * indent
    return "Operation(\n" + "".join(f"{margin}    {each},\n" for each in arguments) + f"{margin})"


def type_alias(kind: t.Sequence | t.Dictionary, here: str) -> str:
    """`TLaserData: TypeAlias = list[TData]`."""
    head = f"{reference(kind.name, here)}: TypeAlias"
    return f"{head} = {spread(expanded(kind, here), 0, len(head) + 3, 0)}"


def port_expression(port: Port, indent: int) -> str:
    """The `Port( … )` of a generated component."""
    module = module_name(port.interface.module)
    arguments = [f"Verb.{port.verb.name}", f"{module}.{interface_constant(port.interface)}"]
    if port.number:
        arguments.append(f'number="{port.number}"')
    if port.qos != QoS():
        arguments.append(f"qos={_qos(port.qos, indent + 4)}")
    if port.each:
        arguments.append("each=True")
    if port.policies:
        literals = [f"({quoted(action)}, {quoted(policy)})" for action, policy in port.policies]
        arguments.append(f"policies={tuple_of(literals, indent + 14, indent + 4)}")
    if port.concurrent:
        arguments.append("concurrent=True")
    if port.middleware:
        arguments.append(f"middleware={quoted(port.middleware)}")
    if port.verb.has_proxy:
        arguments.append(f"proxy={module}.{proxy_class(port)}")
    return call("Port", arguments, indent, 1)


def _qos(qos: QoS, indent: int) -> str:
    """`QoS(depth=1)`: the values that differ from the default."""
    plain = QoS()
    given = []
    for name in QoS.__dataclass_fields__:
        value = getattr(qos, name)
        if value != getattr(plain, name):
            spelt = f"{type(value).__name__}.{value.name}" if isinstance(value, enum.Enum) else repr(value)
            given.append(f"{name}={spelt}")
    return call("QoS", given, indent, len("qos=,"))


# Documentation.


def operation_doc(operation: Operation[Any]) -> str:
    """The docstring of an operation: its comment in the IDSL, then its declaration."""
    names = (operation.name, *(field.name for field in (*operation.inputs, *operation.outputs)))
    said = capital(operation.doc.strip(), *names)
    first = said or f"`{operation.name}` of {operation.interface.replace('::', '.')}."
    return f"{_sentence(first)}\n\nIDSL: {operation.source}"


def overlap_doc(component: Component) -> str:
    """The docstring of a worker: which of its methods run at the same time."""
    concurrent = [_methods(port) for port in component.ports if port.concurrent]
    if not concurrent:
        rule = "Only one method runs at a time."
    else:
        rule = (
            f"Methods {' and '.join(concurrent)} are `concurrent`: they may run at any time, and several at once. "
            "Protect attributes that they share with a lock. Of the other methods, only one runs at a time."
        )
    return f"{rule} While it waits for the reply of another component, a handler may run."


def _methods(port: Port) -> str:
    """The handlers of a port, for readers."""
    return f"of {handler_class(port)}" if port.each else f"{port.handler('')}…"


def struct_doc(name: str, doc: str, parts: Sequence[str] = ()) -> str:
    """The docstring of a type: its comment in the IDSL, or else its module. `parts` are its fields or enumerators."""
    return _sentence(capital(doc.strip(), short(name), *parts) or f"{short(name)} of module {module_of(name)}")


def _sentence(text: str) -> str:
    return text if text[-1:] in ".!?:" else f"{text}."
