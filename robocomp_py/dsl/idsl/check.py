"""Model to diagnostics: everything wrong with a well-formed file, not just the first thing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

from ...contract.interface import PARTS, RESERVED, Pattern
from ...contract.naming import feedback_struct, goal_class, names_of
from ...contract.types import MAX_DEPTH, Primitive, integer_range, is_key, python_name
from ..diagnostics import Proposals, Report, did_you_mean
from ..numbers import whole
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

_FOREIGN = {"char": "byte", "uchar": "byte", "uint": "uint32", "ulong": "uint64", "ushort": "uint16", "str": "string"}
"""Names of types in other languages, for hints."""

_BOOLS = ("true", "false")

_PREFIX = "RoboComp"
"""The module of X.idsl is called RoboCompX, by convention."""

MAX_ANCESTORS = 100
"""The most interfaces or exceptions that one may extend, directly or indirectly."""

_OF_EXCEPTIONS = ("args", "with_traceback", "add_note")
"""Attributes of every Python exception."""

Scope = Mapping[str, m.Definition]
"""Definitions by qualified name: a file's own, and those of all it imports."""


def qualified(name: str, module: str) -> str:
    return name if "::" in name else f"{module}::{name}"


def module_of(name: str) -> str:
    return name.rpartition("::")[0]


def check(file: m.File, imported: Scope, report: Report, can_import: Callable[[str], bool]) -> None:
    """Report the errors in a file, given the definitions it imports and the other files it could import."""
    _Checker(file, imported, report, can_import).check()


@dataclass
class _Checker:
    file: m.File
    imported: Scope
    report: Report
    can_import: Callable[[str], bool]

    def check(self) -> None:
        self.module = self.file.module.text
        self.scope: dict[str, m.Definition] = dict(self.imported)
        self.propose = Proposals()
        self.imported_modules = {module_of(each) for each in self.imported}
        self._check_unique()
        self._check_python_names()
        for definition in self.file.definitions:
            match definition:
                case m.Struct(fields=fields):
                    self._check_fields(fields)
                case m.Exception_(fields=fields):
                    self._check_fields(fields)
                    self._check_exception(definition)
                case m.Sequence(item=item, records=records):
                    self._check_type(item)
                    if records:
                        self._check_records(item)
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

    # Names.

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
        self._check_reserved([self.file.module, *(definition.name for definition in self.file.definitions)])

    def _check_python_names(self) -> None:
        """Check that no two definitions of the module need the same name in Python; an interface needs several."""
        seen: dict[str, Name] = {}
        for name, definition in self.scope.items():
            if module_of(name) != self.module:
                continue
            for wanted in self._python_names(definition):
                first = seen.setdefault(wanted, definition.name)
                if first is not definition.name and definition.name.span.source is self.file.source:
                    message = f"`{definition.name}` and `{first}` both need the name `{wanted}` in Python"
                    related = ("first here", first.span)
                    self._error("duplicate", message, definition.name.span, "rename one of them", related)
                    break

    def _python_names(self, definition: m.Definition) -> list[str]:
        if not isinstance(definition, m.Interface):
            return [definition.name.text]
        every = [definition, *self._ancestors(definition)]
        operations = [each.name.text for part in every if isinstance(part, m.Interface) for each in part.operations]
        found = [*names_of(definition.name.text, operations)]
        for each in definition.operations:
            if each.is_action and each.feedback:
                found += [feedback_struct(definition.name.text, each.name.text)]
                found += [goal_class(definition.name.text, each.name.text)]
        return list(dict.fromkeys(found))

    def _check_names(self, names: Sequence[Name], what: str, code: str = "duplicate") -> None:
        """Check that names are unique, here and in Python."""
        seen: dict[str, Name] = {}
        for name in names:
            first = seen.setdefault(python_name(name.text), name)
            if first.text == name.text and first is not name:
                self._error(code, f"{what} `{name}` is defined twice", name.span, "", ("first here", first.span))
            elif first is not name:
                message = f"{what} `{name}` and `{first}` have the same name in Python, `{python_name(name.text)}`"
                self._error(code, message, name.span, "rename one of them", ("first here", first.span))
        self._check_reserved(names)

    def _check_reserved(self, names: Sequence[Name]) -> None:
        for name in names:
            if name.text.startswith("__"):
                message = f"`{name}`: names that begin with two underscores are reserved by Python"
                self._error("reserved-name", message, name.span, "give it another name")

    # Definitions.

    def _check_fields(self, fields: tuple[m.Field, ...]) -> None:
        self._check_names([field.name for field in fields], "field")
        for field in fields:
            self._check_type(field.type)
            if field.default:
                self._check_literal(field.type, field.default)

    def _check_enum(self, enum: m.Enum) -> None:
        if not enum.members:
            hint = f"give it one: `enum {enum.name} {{ none }};`"
            self._error("empty-enum", f"`{enum.name}` has no enumerators, so it has no value", enum.name.span, hint)
        self._check_names([each.name for each in enum.members], "enumerator", "duplicate-enumerator")
        seen: dict[int, Name] = {}
        low, high = integer_range(Primitive.INT32)
        for each, value in zip(enum.members, enum_values(enum), strict=True):
            at = each.value.span if each.value else each.name.span
            if not low <= value <= high:
                self._error("out-of-range", f"`{each.name}` is {value}; allowed: {low} to {high}", at)
            elif value in seen:
                self._error("duplicate-value", f"`{each.name}` has the value of `{seen[value]}`, {value}", at)
            seen.setdefault(value, each.name)

    def _check_shared_enumerators(self) -> None:
        seen: dict[str, tuple[m.Enum, Name]] = {}
        for enum in (each for each in self.file.definitions if isinstance(each, m.Enum)):
            for member in enum.members:
                other, first = seen.setdefault(member.name.text, (enum, member.name))
                if other is not enum:
                    self.report.warning(
                        "shared-enumerator",
                        f"`{member.name}` is an enumerator of `{other.name}`, too; Slice before Ice 3.7 refuses that",
                        member.name.span,
                        "",
                        ("also here", first.span),
                    )

    def _check_exception(self, exception: m.Exception_) -> None:
        for field in exception.fields:
            if field.name.text in _OF_EXCEPTIONS:
                message = f"every Python exception already has an attribute `{field.name}`"
                self._error("reserved-name", message, field.name.span, "give it another name")
        for extra in exception.bases[1:]:
            self._error("several-bases", "an exception can extend at most one other", extra.span)
        bases = self._ancestors(exception)
        self._check_lineage(exception, bases)
        for base in exception.bases[:1]:
            found = self._find(base, "unknown-exception", "exception", m.Exception_)
            if isinstance(found, m.Exception_) and found in bases and exception in bases:
                self._error("circular-base", f"`{exception.name}` extends itself", base.span)
            elif found and not isinstance(found, m.Exception_):
                self._error("not-an-exception", f"`{base}` is not an exception", base.span)
        inherited = {f.name.text: f for each in bases if isinstance(each, m.Exception_) for f in each.fields}
        for field in exception.fields:
            first = inherited.get(field.name.text)
            if first and exception not in bases:
                related = ("first here", first.name.span)
                self._error("duplicate", f"field `{field.name}` is inherited already", field.name.span, "", related)

    def _check_interface(self, interface: m.Interface) -> None:
        bases = self._ancestors(interface)
        self._check_lineage(interface, bases)
        is_circular = interface in bases
        for base in interface.bases:
            found = self._find(base, "unknown-interface", "interface", m.Interface)
            if isinstance(found, m.Interface) and is_circular:
                self._error("circular-base", f"`{interface.name}` extends itself", base.span)
                break
            if found and not isinstance(found, m.Interface):
                self._error("not-an-interface", f"`{base}` is not an interface", base.span)
        seen: dict[str, m.Operation] = {}
        for each in dict.fromkeys([*reversed(bases), interface]):
            for operation in each.operations if isinstance(each, m.Interface) else ():
                first = seen.setdefault(operation.name.text, operation)
                if first is not operation:
                    self._error(
                        "overload",
                        f"operation `{operation.name}` is defined twice; overloading is not possible",
                        operation.name.span if each is interface else interface.name.span,
                        "give it another name",
                        ("first here", first.name.span),
                    )
        self._check_reserved([operation.name for operation in interface.operations])
        for operation in interface.operations:
            self._check_operation(operation)
        self._check_actions(interface, seen)

    def _ancestors(self, definition: m.Interface | m.Exception_) -> list[m.Definition]:
        """The definitions that it extends directly or indirectly, nearest first; itself, too, if that is circular.

        Stops soon after MAX_ANCESTORS, because a longer list is an error in any case.
        """
        found: dict[str, m.Definition] = {}
        waiting = [(self.module, definition)]
        while waiting and len(found) <= MAX_ANCESTORS:
            module, each = waiting.pop(0)
            for base in each.bases:
                name = qualified(base.text, module)
                extended = self.scope.get(name)
                if extended is not None and name not in found:
                    found[name] = extended
                    if isinstance(extended, m.Interface | m.Exception_):
                        waiting.append((module_of(name), extended))
        return list(found.values())

    def _check_lineage(self, definition: m.Interface | m.Exception_, bases: list[m.Definition]) -> None:
        if len(bases) > MAX_ANCESTORS:
            message = f"`{definition.name}` extends more than {MAX_ANCESTORS} others, directly or indirectly"
            self._error("too-deep", message, definition.name.span)

    def _check_operation(self, operation: m.Operation) -> None:
        if operation.returns:
            self._check_type(operation.result)
        self._check_names([param.name for param in operation.params], "parameter")
        outputs = [param for param in operation.params if param.out]
        for param in operation.params:
            self._check_type(param.type)
            if param.out and param.name.text == "ret" and (operation.returns or len(outputs) > 1):
                beside = "a returned value" if operation.returns else "others would count as the returned value"
                self._error("duplicate", f"an output named `ret` beside {beside}", param.name.span, "rename it")
        self._check_param_defaults(operation)
        self._check_throws(operation)
        self._check_feedback(operation)
        pattern = operation.pattern
        if pattern and pattern.text not in (Pattern.QUERY, m.ACTION) and (operation.gives_back or operation.throws):
            self._error(
                "one-way-gives-back",
                f"a {pattern} is one-way: it cannot return, have outputs or throw",
                _given_back(operation),
                "make it a [query]",
                ("declared here", pattern.span),
            )

    def _check_feedback(self, operation: m.Operation) -> None:
        for param in operation.feedback:
            self._check_type(param.type)
            if param.default:
                self._check_literal(param.type, param.default)
            if param.out:
                self._error("wrong-action", "feedback has no `out`: it goes to the client", param.span, "remove `out`")
        self._check_names([param.name for param in operation.feedback], "field of the feedback")
        if operation.feedback_at and not operation.is_action:
            message = f"only actions have feedback, and `{operation.name}` is none"
            pattern = operation.pattern
            hint = f"write `[action]` instead of `[{pattern}]`" if pattern else "write `[action]` before it"
            self._error("wrong-action", message, operation.feedback_at, hint)
        if not operation.is_action:
            return
        if operation.idempotent and operation.pattern:
            message = f"`{operation.name}` cannot be idempotent: each goal of an action is executed once"
            self._error("wrong-action", message, operation.pattern.span, "remove `idempotent`")
        for param in operation.params:
            if param.name.text in RESERVED:
                message = f"every action already has a parameter `{param.name}`"
                self._error("reserved-name", message, param.name.span, "give it another name")

    def _check_actions(self, interface: m.Interface, operations: Mapping[str, m.Operation]) -> None:
        """Check that no operation is called as a part of an action, as Ice spells it."""
        for action in operations.values():
            parts = [f"{action.name}_{part}" for part in PARTS] if action.is_action else []
            for other in (operations[name] for name in parts if name in operations):
                message = f"`{other.name}` and a part of the action `{action.name}` have the same name in Ice"
                at, there = (other, action) if other in interface.operations else (action, other)
                related = ("the other one is here", there.name.span)
                self._error("wrong-action", message, at.name.span, "rename one of them", related)

    def _check_param_defaults(self, operation: m.Operation) -> None:
        given: Name | None = None
        for param in operation.params:
            if param.default and param.out:
                self._error("bad-default", "an output has no default", param.default.span)
            elif param.default:
                self._check_literal(param.type, param.default)
                given = param.name
            elif given and not param.out:
                message = f"`{param.name}` needs a default, because `{given}` before it has one"
                self._error("bad-default", message, param.name.span)

    def _check_throws(self, operation: m.Operation) -> None:
        seen: dict[str, Name] = {}
        for thrown in operation.throws:
            found = self._find(thrown, "unknown-exception", "exception", m.Exception_)
            if found and not isinstance(found, m.Exception_):
                self._error("throws-non-exception", f"`{thrown}` is not an exception", thrown.span)
            first = seen.setdefault(qualified(thrown.text, self.module), thrown)
            if first is not thrown:
                self._error("duplicate", f"`{thrown}` is defined twice", thrown.span, "", ("first here", first.span))

    # Types.

    def _check_type(self, kind: m.TypeName) -> None:
        if isinstance(kind, m.SequenceOf):
            self._check_type(kind.item)
            if kind.records:
                self._check_records(kind.item)
        elif kind.text == "void":
            self._error("void-type", "nothing can have the type `void`; only operations return it", kind.span)
        elif kind.text not in BUILTIN:
            found = self._find(kind, "unknown-type", "type", m.Struct, m.Sequence, m.Dictionary, m.Enum)
            if isinstance(found, m.Interface | m.Exception_ | m.Const):
                self._error("not-a-value-type", f"`{kind}` is not a type of values", kind.span)

    def _check_records(self, item: m.TypeName) -> None:
        """The items of `[records]` are flat structs. Types that are not known are reported elsewhere."""
        if isinstance(item, m.SequenceOf):
            self._error("not-flat", "the items of [records] are structs", item.span, "remove `[records]`")
            return
        name = qualified(item.text, self.module)
        found = self.scope.get(name)
        if isinstance(found, m.Struct):
            self._check_flat(item, found, module_of(name))
        elif item.text in BUILTIN or found is not None:
            hint = "remove `[records]`"
            if item.text in BUILTIN and BUILTIN[item.text].in_arrays:
                hint += ": sequences of numbers are arrays"
            self._error("not-flat", f"the items of [records] are structs, not `{item}`", item.span, hint)

    def _check_flat(self, item: Name, struct: m.Struct, module: str) -> None:
        if not struct.fields:
            self._error("not-flat", f"`{item}` has no fields, so it has no records", item.span, "remove `[records]`")
        for field in struct.fields:
            if self._is_scalar(field.type, module):
                continue
            message = f"`{field.name}` of `{item}` is not a number, bool or enumerator, so `{item}` has no records"
            is_time = isinstance(field.type, Name) and field.type.text == Primitive.TIME
            hint = "make it a `long` of nanoseconds, or remove `[records]`" if is_time else "remove `[records]`"
            self._error("not-flat", message, item.span, hint, ("declared here", field.name.span))
            return

    def _is_scalar(self, kind: m.TypeName, module: str) -> bool:
        """Whether values of a type, named in that module, have a numpy dtype. Unknown types are reported elsewhere."""
        if isinstance(kind, m.SequenceOf):
            return False
        if kind.text in BUILTIN:
            return BUILTIN[kind.text].in_arrays
        return isinstance(self.scope.get(qualified(kind.text, module)), m.Enum | None)

    def _check_key(self, key: m.TypeName) -> None:
        found = None if isinstance(key, m.SequenceOf) else self.scope.get(qualified(key.text, self.module))
        known = isinstance(key, m.SequenceOf) or found is not None or key.text in BUILTIN
        builtin = not isinstance(key, m.SequenceOf) and key.text in BUILTIN and is_key(BUILTIN[key.text])
        if known and not builtin and not isinstance(found, m.Enum):
            hint = "write a sequence of structs that have a key and a value" if isinstance(found, m.Struct) else ""
            self._error("bad-key", "a dictionary's keys are strings, bools, integers or enumerators", key.span, hint)

    def _check_literal(self, kind: m.TypeName, literal: m.Literal) -> None:
        if isinstance(kind, m.SequenceOf):
            self._error("bad-default", "a sequence has no literal", literal.span)
            return
        found = self.scope.get(qualified(kind.text, self.module))
        meaning: Primitive | m.Enum | None = found if isinstance(found, m.Enum) else BUILTIN.get(kind.text)
        if meaning is None or (isinstance(meaning, m.Enum) and not meaning.members):
            if found is not None and meaning is None:
                self._error("bad-default", f"`{kind}` has no literal", literal.span)
            return
        try:
            literal_value(meaning, literal)
        except ValueError as exc:
            enumerators = [each.name.text for each in meaning.members] if isinstance(meaning, m.Enum) else []
            hint = did_you_mean(literal.text.rpartition("::")[2], enumerators or _BOOLS)
            self._error("bad-default", str(exc), literal.span, hint if enumerators or meaning is Primitive.BOOL else "")

    def _find(self, name: Name, code: str, what: str, *kinds: type[m.Definition]) -> m.Definition | None:
        """The definition with a name; if there is none, report that, unless a syntax error may have hidden it.

        It must be of one of these kinds.
        """
        found = self.scope.get(qualified(name.text, self.module))
        short = name.text.rpartition("::")[2]
        if found is not None or short in self.file.skipped:
            return found
        module = module_of(name.text)
        if name.text in BUILTIN:
            self._error(
                code, f"`{name}` is a built-in type, not {'an' if what[0] in 'aeiou' else 'a'} {what}", name.span
            )
        elif module and module != self.module and module not in self.imported_modules:
            hint = _foreign(short) or self._suggest_import(module)
            self._error("missing-import", f"module `{module}` is not imported", name.span, hint)
        else:
            self._error(code, f"unknown {what} `{name}`", name.span, self._suggest(name.text, kinds))
        return None

    def _suggest(self, name: str, kinds: tuple[type[m.Definition], ...]) -> str:
        short = name.rpartition("::")[2]
        if short in self._by_short_name:
            return f"did you mean `{self._by_short_name[short]}`?"
        own, builtin = f"{self.module}::", BUILTIN if m.Struct in kinds else ()
        defined = (name.removeprefix(own) for name, each in self.scope.items() if isinstance(each, kinds))
        return (_foreign(short) if builtin else "") or self.propose(name, chain(builtin, defined))

    def _suggest_import(self, module: str) -> str:
        """A hint for an unknown module: to import its file, to correct its name, or to create the file."""
        stem = module.removeprefix(_PREFIX)
        add = f'add: import "{stem}.idsl";'
        if self.can_import(stem):
            return add
        misspelt = self.propose(module, self.imported_modules, prefix=_PREFIX)
        return misspelt or (add if module.startswith(_PREFIX) else "")

    @cached_property
    def _by_short_name(self) -> dict[str, str]:
        """The first definition of each name, whatever its module. Used when the scope is complete."""
        return {each.rpartition("::")[2]: each for each in reversed(self.scope)}

    # Nesting.

    def _check_nesting(self) -> None:
        """Check that no type contains itself, or is nested too deeply for the codecs."""
        heights: dict[str, int] = {}
        for definition in self.file.definitions:
            self._height(qualified(definition.name.text, self.module), [], heights)

    def _height(self, name: str, inside: list[str], heights: dict[str, int]) -> int:
        """The number of levels of a definition, itself included; each definition is examined once."""
        definition = self.scope.get(name)
        if definition is None or name in heights:
            return heights.get(name, 1)
        heights[name] = 1
        for kind, at in _parts(definition):
            levels = 1
            while isinstance(kind, m.SequenceOf):
                kind, levels = kind.item, levels + 1
            part = qualified(kind.text, module_of(name))
            if not isinstance(self.scope.get(part), m.Struct | m.Sequence | m.Dictionary):
                heights[name] = max(heights[name], levels + 1)
            elif part in (name, *inside):
                self._error("recursive-type", f"`{definition.name}` contains itself", at)
            elif len(inside) <= MAX_DEPTH:
                heights[name] = max(heights[name], levels + self._height(part, [*inside, name], heights))
        if heights[name] > MAX_DEPTH and not inside:
            self._error("too-deep", f"`{definition.name}` nests deeper than {MAX_DEPTH} levels", definition.name.span)
        return heights[name]

    def _error(self, code: str, message: str, span: Span, hint: str = "", *related: tuple[str, Span]) -> None:
        self.report.error(code, message, span, hint, *related)


def _given_back(operation: m.Operation) -> Span:
    """The first value that an operation returns."""
    outputs = [param.span for param in operation.params if param.out]
    results = [operation.result.span] if operation.returns else []
    return [*results, *outputs, *(name.span for name in operation.throws)][0]


def _foreign(short: str) -> str:
    """The built-in type that a name of another language means: `std::string` is `string`."""
    meant = short if short in BUILTIN else _FOREIGN.get(short)
    return f"did you mean `{meant}`?" if meant else ""


def _parts(definition: m.Definition) -> Iterator[tuple[m.TypeName, Span]]:
    """The types in a definition, and their places."""
    match definition:
        case m.Struct(fields=fields) | m.Exception_(fields=fields):
            yield from ((field.type, field.type.span) for field in fields)
        case m.Interface(operations=operations):
            for operation in operations:
                yield operation.result, operation.result.span
                yield from ((each.type, each.type.span) for each in (*operation.params, *operation.feedback))
        case m.Sequence(item=item):
            yield item, item.span
        case m.Dictionary(key=key, value=value):
            yield key, key.span
            yield value, value.span
        case _:
            pass


def enum_values(enum: m.Enum) -> list[int]:
    """The value of each enumerator: the given one, or the previous value plus one."""
    values: list[int] = []
    for each in enum.members:
        previous = values[-1] if values else -1
        values.append(whole(each.value.text) if each.value else previous + 1)
    return values
