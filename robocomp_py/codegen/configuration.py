"""Parameters as Python classes, and as tables of a configuration file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..contract.parameters import Parameter, ParameterKind, ParameterList, ParameterSet
from ..contract.rosnames import camel
from ..printable import spaced
from .layout import assigned, call, commented, quoted, remark, spread, text, tuple_of
from .shadows import Shadows

_ROOM = 26
"""Column of the comments in TOML."""


@dataclass(frozen=True)
class Scope:
    """One parameter class: its name, its parameters, and the classes of the items of its lists."""

    name: str
    spec: ParameterSet
    items: Mapping[str, str]


def scopes_of(params: ParameterSet) -> list[Scope]:
    """The classes of a set, inner ones first; `Params` is the last one."""
    taken = {"Params"}

    def visit(spec: ParameterSet, name: str) -> Iterator[Scope]:
        items: dict[str, str] = {}
        for each in spec.lists:
            wanted = f"{name.removesuffix('Item') if name != 'Params' else ''}{camel(each.name)}Item"
            items[each.name] = next(n for n in _numbered(wanted) if n not in taken)
            taken.add(items[each.name])
            yield from visit(each.items, items[each.name])
        yield Scope(name, spec, items)

    return list(visit(params, "Params"))


def _numbered(name: str) -> Iterator[str]:
    yield name
    number = 2
    while True:
        yield f"{name}{number}"
        number += 1


# As Python.


def parameter_lines(scope: Scope) -> str:
    """The members of a parameter class."""
    shadows = parameter_shadows(scope)
    lines = []
    for each in scope.spec.parameters:
        annotation = shadows.avoid(_annotation(each))
        head = f"{each.name}: {spread(annotation, 4, len(each.name) + 2, len(quoted(each.default)) + 3)}"
        lines.append(commented(assigned(head, quoted(each.default), 4), _remarks(each), 4))
    for item in scope.spec.lists:
        annotation = shadows.avoid(f"tuple[{scope.items[item.name]}, ...]")
        lines.append(commented(f"{item.name}: {annotation} = ()", item.description, 4))
    return "".join(f"    {line}\n" for line in lines)


def parameter_shadows(scope: Scope) -> Shadows:
    """The names that the members of a parameter class hide from later members."""
    shadows = Shadows()
    for each in scope.spec.parameters:
        shadows.member(each.name, _annotation(each))
    for item in scope.spec.lists:
        shadows.member(item.name, f"tuple {scope.items[item.name]}")
    shadows.member("__spec__", "ClassVar ParameterSet")
    return shadows


def parameter_expression(parameter: Parameter) -> str:
    """The `Parameter( … )` of a generated set."""
    arguments = [quoted(parameter.name), f"ParameterKind.{parameter.kind.name}", quoted(parameter.default)]
    if parameter.minimum is not None:
        arguments += [f"minimum={parameter.minimum!r}", f"maximum={parameter.maximum!r}"]
    if parameter.choices:
        arguments.append(_choices(parameter.choices))
    if parameter.mandatory:
        arguments.append("mandatory=True")
    if parameter.description:
        arguments.append(f"description={_description(parameter.description)}")
    if parameter.dynamic:
        arguments.append("dynamic=True")
    return call("Parameter", arguments, 8, 1)


def _description(description: str) -> str:
    return text(" ".join(description.split()), 12, len("description=,"))


def _choices(choices: Sequence[str]) -> str:
    line = f"choices=({', '.join(map(quoted, choices))}{',' if len(choices) == 1 else ''})"
    return line if len(line) <= 70 else f"choices={tuple_of([quoted(each) for each in choices], 20, 12)}"


def list_expression(each: ParameterList, scope: Scope) -> str:
    """The `ParameterList( … )` of a generated set."""
    arguments = [quoted(each.name), f"{scope.items[each.name]}.__spec__"]
    if each.minimum or each.maximum is not None:
        arguments += [f"minimum={each.minimum}", f"maximum={each.maximum}"]
    if each.description:
        arguments.append(f"description={_description(each.description)}")
    return call("ParameterList", arguments, 8, 1)


def _annotation(parameter: Parameter) -> str:
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


def _remarks(parameter: Parameter) -> str:
    words = [parameter.description] if parameter.description else []
    words += [f"{parameter.minimum} to {parameter.maximum}"] if parameter.minimum is not None else []
    words += ["dynamic"] if parameter.dynamic else []
    return ", ".join(words)


# As TOML.


def toml_params(params: ParameterSet) -> str:
    """The `[params]` table: every parameter with its default, and an example of each list."""
    return "\n".join(_toml_lines(params, "params"))


def toml_item(path: str, values: Mapping[str, object]) -> list[str]:
    """The lines of one item of a list of parameters."""
    return [f"[[{path}]]", *(f"{name} = {_toml(value)}" for name, value in values.items())]


def _toml_lines(params: ParameterSet, path: str, mark: str = "") -> list[str]:
    lines = []
    for parameter in params.parameters:
        words = [parameter.description] if parameter.description else []
        words += [parameter.allowed()] + (["mandatory"] if parameter.mandatory else [])
        words += ["dynamic"] if parameter.dynamic else []
        lines.append(beside(f"{mark}{parameter.name} = {_toml(parameter.default)}", "; ".join(words)))
    for each in params.lists:
        limit = "any number of" if each.maximum is None else f"{each.minimum} to {each.maximum}"
        said = each.description or "one table for each"
        lines += ["", remark(f"{each.name}: {limit} items; {said}", 0)]
        needed = "" if each.minimum and not mark else "# "
        for _ in range(max(1, each.minimum if not mark else 1)):
            lines += [f"{needed}[[{path}.{each.name}]]", *_toml_lines(each.items, f"{path}.{each.name}", needed)]
    return lines


def beside(text: str, comment: str) -> str:
    """A line of TOML with a comment, aligned with the others."""
    return f"{text:<{_ROOM}} # {' '.join(spaced(comment).split())}"


def duration(seconds: float) -> str:
    """`50 ms`, `2 s`."""
    return f"{seconds * 1000:g} ms" if seconds < 1 else f"{seconds:g} s"


def _toml(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else quoted(value)
