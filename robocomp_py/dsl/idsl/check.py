"""Model to diagnostics: everything wrong with a well-formed file, not just the first thing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ...contract.interface import Pattern
from ...contract.types import MAX_DEPTH, Primitive, integer_range, is_key
from ..diagnostics import Report, did_you_mean
from ..source import Name, Span
from . import model as m
from .literals import literal_value

BUILTIN: dict[str, Primitive] = {
    "byte": Primitive.UINT8,
    "short": Primitive.INT16,
    "int": Primitive.INT32,
    "long": Primitive.INT64,
    "float": Primitive.FLOAT32,
    "double": Primitive.FLOAT64,
    **{str(kind): kind for kind in Primitive},
}
"""Slice's names, and those that tell their width."""

Scope = Mapping[str, m.Definition]
"""Definitions by qualified name: a file's own, and those of all it imports."""


def qualified(name: str, module: str) -> str:
    return name if "::" in name else f"{module}::{name}"


def check(file: m.File, imported: Scope, report: Report) -> None:
    """Say what is wrong in a file, given what its imports define."""
    _Checker(file, imported, report).check()


@dataclass
class _Checker:
    file: m.File
    imported: Scope
    report: Report

    def check(self) -> None:
        self.module = self.file.module.text
        self.scope: dict[str, m.Definition] = dict(self.imported)
        self._check_unique()
        for definition in self.file.definitions:
            match definition:
                case m.Struct(fields=fields) | m.Exception_(fields=fields):
                    self._check_fields(fields)
                    if isinstance(definition, m.Exception_):
                        self._check_exception(definition)
                case m.Sequence(item=item):
                    self._check_type(item)
                case m.Dictionary(key=key, value=value):
                    self._check_type(key)
                    self._check_key(key)
                    self._check_type(value)
                case m.Enum():
                    self._check_enum(definition)
                case m.Const():
                    self._check_type(definition.type)
                    self._check_literal(definition.type, definition.value)
                case m.Interface():
                    self._check_interface(definition)
        self._check_shared_enumerators()
        self._check_nesting()

    # Definitions.

    def _check_unique(self) -> None:
        for definition in self.file.definitions:
            name = qualified(definition.name.text, self.module)
            first = self.scope.get(name)
            if definition.name.text in BUILTIN or definition.name.text == "void":
                self._error("duplicate", f"`{definition.name}` is a built-in type", definition.name.span)
            elif first is not None:
                related = ("first defined here", first.name.span)
                self._error("duplicate", f"`{definition.name}` is already defined", definition.name.span, "", related)
            else:
                self.scope[name] = definition

    def _check_fields(self, fields: tuple[m.Field, ...]) -> None:
        self._check_names([field.name for field in fields], "field")
        for field in fields:
            self._check_type(field.type)
            if field.default:
                self._check_literal(field.type, field.default)

    def _check_names(self, names: list[Name], what: str, code: str = "duplicate") -> None:
        seen: dict[str, Name] = {}
        for name in names:
            first = seen.setdefault(name.text, name)
            if first is not name:
                self._error(code, f"{what} `{name}` is there twice", name.span, "", ("first here", first.span))

    def _check_enum(self, enum: m.Enum) -> None:
        self._check_names([each.name for each in enum.members], "enumerator", "duplicate-enumerator")
        seen: dict[int, Name] = {}
        for each, value in zip(enum.members, enum_values(enum), strict=True):
            low, high = integer_range(Primitive.INT32)
            at = each.value.span if each.value else each.name.span
            if not low <= value <= high:
                self._error("out-of-range", f"`{each.name}` is {value}; allowed: {low} to {high}", at)
            elif value in seen and each.value:
                self._error("duplicate-value", f"`{each.name}` has the value of `{seen[value]}`", at)
            seen.setdefault(value, each.name)

    def _check_shared_enumerators(self) -> None:
        seen: dict[str, tuple[m.Enum, Name]] = {}
        for enum in (each for each in self.file.definitions if isinstance(each, m.Enum)):
            for member in enum.members:
                other, first = seen.setdefault(member.name.text, (enum, member.name))
                if other is not enum:
                    self.report.warning(
                        "shared-enumerator",
                        f"`{member.name}` is an enumerator of `{other.name}`, too; Slice refuses that",
                        member.name.span,
                        "",
                        ("also here", first.span),
                    )

    def _check_exception(self, exception: m.Exception_) -> None:
        for extra in exception.bases[1:]:
            self._error("several-bases", "an exception extends one other at most", extra.span)
        for base in exception.bases[:1]:
            if self._look_up(base, "exception", m.Exception_, "not-an-exception") and self._circular(exception):
                self._error("circular-base", f"`{exception.name}` extends itself", base.span)

    def _check_interface(self, interface: m.Interface) -> None:
        for base in interface.bases:
            if self._look_up(base, "interface", m.Interface, "not-an-interface") and self._circular(interface):
                self._error("circular-base", f"`{interface.name}` extends itself", base.span)
                return
        seen: dict[str, Name] = {}
        for operation in self._operations(interface):
            first = seen.setdefault(operation.name.text, operation.name)
            if first is not operation.name:
                self._error(
                    "overload",
                    f"operation `{operation.name}` is there twice; overloading is not possible",
                    operation.name.span if operation in interface.operations else interface.name.span,
                    "give it another name",
                    ("first here", first.span),
                )
        for operation in interface.operations:
            self._check_operation(operation)

    def _operations(self, interface: m.Interface) -> Iterator[m.Operation]:
        """Inherited ones first."""
        for base in interface.bases:
            definition = self.scope.get(qualified(base.text, self.module))
            if isinstance(definition, m.Interface):
                yield from self._operations(definition)
        yield from interface.operations

    def _check_operation(self, operation: m.Operation) -> None:
        if not (isinstance(operation.result, Name) and operation.result.text == "void"):
            self._check_type(operation.result)
        self._check_names([param.name for param in operation.params], "parameter")
        for param in operation.params:
            self._check_type(param.type)
            returns = not (isinstance(operation.result, Name) and operation.result.text == "void")
            if param.out and param.name.text == "ret" and returns:
                self._error("duplicate", "an output named `ret` beside a returned value", param.name.span, "rename it")
        for thrown in operation.throws:
            self._look_up(thrown, "exception", m.Exception_, "throws-non-exception")
        pattern = operation.pattern
        if pattern and pattern.text != Pattern.QUERY and (operation.gives_back or operation.throws):
            self._error(
                "one-way-gives-back",
                f"a {pattern} goes one way: it cannot return, have outputs or throw",
                operation.name.span,
                "make it a [query]",
                ("declared here", pattern.span),
            )

    # Types.

    def _check_type(self, kind: m.TypeName) -> None:
        if isinstance(kind, m.SequenceOf):
            self._check_type(kind.item)
        elif kind.text == "void":
            self._error("void-type", "nothing can have the type `void`; only operations return it", kind.span)
        elif kind.text not in BUILTIN:
            found = self._find(kind, "type")
            if isinstance(found, m.Interface | m.Exception_ | m.Const):
                self._error("not-a-value-type", f"`{kind}` is not a type of values", kind.span)

    def _check_key(self, key: m.TypeName) -> None:
        found = None if isinstance(key, m.SequenceOf) else self.scope.get(qualified(key.text, self.module))
        known = isinstance(key, m.SequenceOf) or found is not None or key.text in BUILTIN
        builtin = not isinstance(key, m.SequenceOf) and key.text in BUILTIN and is_key(BUILTIN[key.text])
        if known and not builtin and not isinstance(found, m.Enum):
            self._error("bad-key", "a dictionary's keys are strings, bools, integers or enumerators", key.span)

    def _check_literal(self, kind: m.TypeName, literal: m.Literal) -> None:
        if isinstance(kind, m.SequenceOf):
            self._error("bad-default", "a sequence has no literal", literal.span)
            return
        found = self.scope.get(qualified(kind.text, self.module))
        meaning: Primitive | m.Enum | None = found if isinstance(found, m.Enum) else BUILTIN.get(kind.text)
        if meaning is None:
            if found is not None:
                self._error("bad-default", f"`{kind}` has no literal", literal.span)
            return
        try:
            literal_value(meaning, literal)
        except ValueError as exc:
            self._error("bad-default", str(exc), literal.span)

    def _look_up(self, name: Name, what: str, wanted: type[m.Definition], code: str) -> bool:
        found = self._find(name, what)
        if found is not None and not isinstance(found, wanted):
            self._error(code, f"`{name}` is not an {what}", name.span)
        return isinstance(found, wanted)

    def _find(self, name: Name, what: str) -> m.Definition | None:
        """The definition a name means; if there is none, say so."""
        found = self.scope.get(qualified(name.text, self.module))
        if found is not None or name.text in BUILTIN or name.text.rpartition("::")[2] in self.file.skipped:
            return found
        module = name.text.rpartition("::")[0]
        modules = {each.rpartition("::")[0] for each in self.scope} | {self.module}
        if module and module not in modules:
            guess = module.removeprefix("RoboComp")
            hint = did_you_mean(module, modules) or f'add: import "{guess}.idsl";'
            self._error("missing-import", f"module `{module}` is not imported", name.span, hint)
        else:
            self._error(f"unknown-{what}", f"unknown {what} `{name}`", name.span, self._suggest(name))
        return None

    def _suggest(self, name: Name) -> str:
        short = name.text.rpartition("::")[2]
        elsewhere = [each for each in self.scope if each.rpartition("::")[2] == short]
        if elsewhere:
            return f"did you mean `{elsewhere[0]}`?"
        own = f"{self.module}::"
        return did_you_mean(name.text, [*BUILTIN, *(each.removeprefix(own) for each in self.scope)])

    # Shapes.

    def _circular(self, definition: m.Interface | m.Exception_) -> bool:
        seen: set[str] = set()
        waiting = [definition]
        while waiting:
            for base in waiting.pop().bases:
                found = self.scope.get(qualified(base.text, self.module))
                if found is definition:
                    return True
                if isinstance(found, m.Interface | m.Exception_) and base.text not in seen:
                    seen.add(base.text)
                    waiting.append(found)
        return False

    def _check_nesting(self) -> None:
        """No type contains itself, or is nested too deeply for the codecs."""
        heights: dict[str, int] = {}
        for definition in self.file.definitions:
            self._height(qualified(definition.name.text, self.module), [], heights)

    def _height(self, name: str, inside: list[str], heights: dict[str, int]) -> int:
        """How many levels a definition has, itself included; each is looked at once."""
        definition = self.scope.get(name)
        if definition is None or name in heights:
            return heights.get(name, 1)
        heights[name] = 1
        for kind, at in _parts(definition):
            levels = 1
            while isinstance(kind, m.SequenceOf):
                kind, levels = kind.item, levels + 1
            part = qualified(kind.text, name.rpartition("::")[0])
            if part in (name, *inside):
                self._error("recursive-type", f"`{definition.name}` contains itself", at)
            elif len(inside) <= MAX_DEPTH:
                heights[name] = max(heights[name], levels + self._height(part, [*inside, name], heights))
        if heights[name] > MAX_DEPTH and not inside:
            self._error("too-deep", f"`{definition.name}` nests deeper than {MAX_DEPTH} levels", definition.name.span)
        return heights[name]

    def _error(self, code: str, message: str, span: Span, hint: str = "", *related: tuple[str, Span]) -> None:
        self.report.error(code, message, span, hint, *related)


def _parts(definition: m.Definition) -> list[tuple[m.TypeName, Span]]:
    """The types a definition is made of, and where they stand."""
    match definition:
        case m.Struct(fields=fields):
            return [(field.type, field.type.span) for field in fields]
        case m.Sequence(item=item):
            return [(item, item.span)]
        case m.Dictionary(key=key, value=value):
            return [(key, key.span), (value, value.span)]
        case _:
            return []


def enum_values(enum: m.Enum) -> list[int]:
    """The value of each enumerator: as given, else one more than the one before."""
    values: list[int] = []
    for each in enum.members:
        previous = values[-1] if values else -1
        values.append(int(each.value.text, 0) if each.value else previous + 1)
    return values
