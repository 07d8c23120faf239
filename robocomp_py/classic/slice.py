"""Converts IDSL to Slice, the language of ZeroC Ice: `X.idsl` becomes `X.ice`, with all that it imports.

    int8                     byte, whose sign is lost
    uint16, uint32, uint64   int, long, long
    time                     long: nanoseconds since 1970
    sequence<T> in place     a sequence with a name of its own, `TSeq`
    [command] [publish]      comments: in Ice, the user of an interface decides that

The rules for names are those of slice2py 3.7.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import PurePosixPath

from ..codegen.exporting import Files, heading, in_order, innermost
from ..codegen.generate import Artifact
from ..codegen.omgidl import comment
from ..contract.types import Primitive
from ..dsl.diagnostics import Report
from ..dsl.idsl import model as m
from ..dsl.idsl.check import BUILTIN, enum_values, module_of
from ..dsl.idsl.literals import literal_value
from ..dsl.numbers import whole
from ..dsl.source import Name, Span
from ..printable import spaced
from .slicewords import (
    NOTED,
    SPELLED,
    SUFFIXES,
    TYPES_OF_ITS_OWN,
    WIDTH,
    escaped,
    indented,
    macro,
)

_LOSSY = {
    Primitive.INT8: "a byte of Slice has no sign",
    Primitive.UINT64: "the widest integer of Slice, long, ends at 9223372036854775807",
}


def to_slice(files: Files, report: Report) -> tuple[Artifact, ...]:
    """One Slice file for each IDSL file. Reports what Slice cannot express."""
    names = _Names(files, report)
    writer = _Writer(files, report)
    artifacts = []
    for file in files.all:
        names.check(file)
        path = PurePosixPath(file.source.path.with_suffix(".ice").name)
        artifacts.append(Artifact(path, "\n".join(writer.file(file)) + "\n"))
    return tuple(artifacts)


_TEXT = re.compile(r'"(?:[^"\\]|\\.)*"|//.*')
"""Strings and comments, whose underscores are not in names."""


class _Writer:
    def __init__(self, files: Files, report: Report) -> None:
        self._files, self._report = files, report
        self._taken = {module: {each.name.text.lower() for each in found} for module, found in files.modules.items()}
        self._sequences: dict[tuple[str, str], str] = {}
        """The names made for unnamed sequences, by module and element type."""
        self._new: list[str] = []
        """Their definitions, to be written before their use."""
        self._operation_names: set[str] = set()
        """The present interface's operations, in lower case: types with such names need qualified names."""

    def file(self, file: m.File) -> Iterator[str]:
        self._module = file.module.text
        body: list[str] = []
        for definition in in_order(file):
            self._new = []
            lines = list(self._definition(definition))
            before = [*self._new, ""] if self._new else []
            body += [*([""] if body else ()), *before, *lines]
        guard = macro(file.source.path.stem)
        yield f"// {heading(file.source.path.name)}"
        yield ""
        yield f"#ifndef {guard}_ICE"
        yield f"#define {guard}_ICE"
        yield ""
        if any("_" in _TEXT.sub("", line) for line in (self._module, *body)):
            yield '[["underscore"]]'
            yield ""
        included = [f'#include "{_stem(each.text)}.ice"' for each in file.imports]
        yield from (*included, "") if included else ()
        yield f"module {escaped(self._module)}"
        yield "{"
        yield from (f"    {line}".rstrip() for line in body)
        yield "};"
        yield ""
        yield f"#endif  // {guard}_ICE"

    def _definition(self, definition: m.Definition) -> Iterator[str]:
        name = escaped(definition.name.text)
        yield from comment(definition.doc, 4)
        match definition:
            case m.Struct(fields=fields):
                if not fields:
                    self._refuse(f"`{name}` has no fields, and Slice has no empty structs", definition.name.span)
                yield f"struct {name}"
                yield from self._fields(fields)
            case m.Exception_(fields=fields, bases=bases):
                yield f"exception {name}{self._extends(bases)}"
                yield from self._fields(fields)
            case m.Enum():
                yield f"enum {name}"
                yield from self._enumerators(definition)
            case m.Sequence(item=item, span=span):
                yield f"sequence<{self._type(item, span)}> {name};{self._note(item)}"
            case m.Dictionary(key=key, value=value, span=span):
                types = f"{self._type(key, span)}, {self._type(value, span)}"
                yield f"dictionary<{types}> {name};{self._note(key) or self._note(value)}"
            case m.Const(type=kind, value=value, span=span):
                written = self._literal(kind, value)
                yield f"const {self._type(kind, span)} {name} = {written};{self._note(kind)}"
            case m.Interface(bases=bases):
                yield f"interface {name}{self._extends(bases)}"
                yield from self._operations(definition)

    def _extends(self, bases: Sequence[Name]) -> str:
        return f" extends {', '.join(map(self._reference, bases))}" if bases else ""

    def _fields(self, fields: Iterable[m.Field]) -> Iterator[str]:
        yield "{"
        for field in fields:
            value = f" = {self._literal(field.type, field.default)}" if field.default else ""
            line = f"{self._type(field.type, field.type.span)} {escaped(field.name.text)}{value};"
            yield from indented(_behind(line, self._note(field.type), field.doc))
        yield "};"

    def _enumerators(self, enum: m.Enum) -> Iterator[str]:
        yield "{"
        last = len(enum.members) - 1
        for number, (member, value) in enumerate(zip(enum.members, enum_values(enum), strict=True)):
            if value < 0:
                at = member.value.span if member.value else member.name.span
                self._refuse(f"`{member.name}` is {value}; enumerators of Slice are not negative", at)
            given = f" = {value}" if member.value else ""
            yield f"    {escaped(member.name.text)}{given}{',' if number < last else ''}"
        yield "};"

    def _operations(self, interface: m.Interface) -> Iterator[str]:
        there = [interface, *(each for _, each in self._files.bases(interface, self._module))]
        self._operation_names = {
            operation.name.text.lower()
            for each in there
            if isinstance(each, m.Interface)
            for operation in each.operations
        }
        yield "{"
        for operation in filter(lambda each: each.is_action, interface.operations):
            message = f"Slice has no actions; `{operation.name}` is left out"
            self._report.warning("lossy-in-slice", message, operation.name.span)
        for number, operation in enumerate(each for each in interface.operations if not each.is_action):
            about = " ".join(filter(None, (f"[{operation.pattern}]" if operation.pattern else "", operation.doc)))
            if about and number:
                yield ""
            yield from indented(comment(about, 8))
            yield from indented(self._operation(operation))
        yield "};"
        self._operation_names = set()

    def _operation(self, operation: m.Operation) -> Iterator[str]:
        given = [each for each in operation.params if not each.out] + [each for each in operation.params if each.out]
        for param in given:
            if param.default:
                message = f"Slice has no defaults of parameters; that of `{param.name}` is left out"
                self._report.warning("lossy-in-slice", message, param.default.span)
        params = [
            f"{'out ' if each.out else ''}{self._type(each.type, each.span)} {escaped(each.name.text)}"
            for each in given
        ]
        result = self._type(operation.result, operation.result.span)
        head = f"{'idempotent ' if operation.idempotent else ''}{result} {escaped(operation.name.text)}"
        tail = f" throws {', '.join(map(self._reference, operation.throws))}" if operation.throws else ""
        line = f"{head}({', '.join(params)}){tail};"
        notes = {note for each in (operation.result, *(param.type for param in given)) if (note := self._note(each))}
        yield from (f"//{note.partition('//')[2]}" for note in sorted(notes))
        if len(line) + 8 <= WIDTH:
            yield line
            return
        yield f"{head}("
        yield from (f"    {each}{',' if each is not params[-1] else f'){tail};'}" for each in params)
        if not params:
            yield f"    ){tail};"

    # Types and values.

    def _type(self, kind: m.TypeName, at: Span) -> str:
        if isinstance(kind, m.SequenceOf):
            return self._sequence(kind, at)
        if kind.text == "void":
            return "void"
        if kind.text not in BUILTIN:
            return self._reference(kind)
        primitive = BUILTIN[kind.text]
        if primitive in _LOSSY:
            what = f"`{primitive}` becomes `{SPELLED[primitive]}`: {_LOSSY[primitive]}"
            self._report.warning("lossy-in-slice", what, kind.span)
        return SPELLED[primitive]

    def _sequence(self, kind: m.SequenceOf, at: Span) -> str:
        """The name of a sequence that has none in the IDSL; it is defined here when it is used first."""
        item = self._type(kind.item, at)
        if (self._module, item) not in self._sequences:
            taken = self._taken[self._module]
            base = "".join(f"{part[:1].upper()}{part[1:]}" for part in item.replace("\\", "").split("::")) + "Seq"
            name, number = base, 1
            while name.lower() in taken:
                name, number = f"{base}{number + 1}", number + 1
            taken.add(name.lower())
            self._sequences[self._module, item] = name
            self._new.append(f"sequence<{item}> {name};{self._note(kind.item)}")
        return self._whole(self._module, self._sequences[self._module, item])

    def _reference(self, name: Name) -> str:
        module, own = module_of(name.text), name.text.rpartition("::")[2]
        return self._whole(module or self._module, own)

    def _whole(self, module: str, name: str) -> str:
        """A type's name; with all that is in front of it where its own would mean something else."""
        if name.lower() in self._operation_names or name in TYPES_OF_ITS_OWN:
            return f"::{module}::{name}"
        return escaped(name) if module == self._module else f"{escaped(module)}::{name}"

    def _note(self, kind: m.TypeName) -> str:
        """A comment on a type that is not written as the IDSL has it."""
        found = BUILTIN.get(innermost(kind).text)
        return f"  // {NOTED[found]}" if found in NOTED else ""

    def _literal(self, kind: m.TypeName, literal: m.Literal) -> str:
        assert isinstance(kind, Name)
        if kind.text not in BUILTIN:
            member = literal.text.rpartition("::")[2]
            return f"{self._reference(kind)}::{member}"
        primitive = BUILTIN[kind.text]
        value = literal_value(primitive, literal)
        if primitive.python is str:
            escaped = spaced(literal.text).replace("\\", "\\\\")
            return f'"{escaped}"'
        if primitive.python is bool:
            return literal.text
        if primitive.python is float:
            return literal.text.rstrip("fF")
        if primitive is Primitive.INT8:
            return str(value & 0xFF)
        if primitive is Primitive.UINT64 and value >= 2**63:
            self._refuse(f"{value} does not fit into Slice's widest integer, long", literal.span)
        return str(whole(literal.text))

    def _refuse(self, message: str, at: Span, hint: str = "") -> None:
        self._report.error("not-in-slice", message, at, hint)


class _Names:
    """What Slice says about names."""

    def __init__(self, files: Files, report: Report) -> None:
        self._files, self._report = files, report
        self._modules: dict[str, Name] = {}

    def check(self, file: m.File) -> None:
        module = file.module.text
        self._check(file.module)
        first = self._modules.setdefault(module.lower(), file.module)
        if first.text != module:
            self._alike(file.module, first)
        whole_module: dict[str, Name] = {}
        for each in self._files.modules[module]:
            before = whole_module.setdefault(each.name.text.lower(), each.name)
            if before is not each.name and each.name.span.source is file.source:
                self._alike(each.name, before)
        for definition in file.definitions:
            self._check(definition.name)
            if definition.name.text.lower() == module.lower():
                message = f"`{definition.name}` is called like its module, which Slice does not allow"
                self._report.error("not-in-slice", message, definition.name.span, "rename one of them")
            self._inside(definition, module)

    def _inside(self, definition: m.Definition, module: str) -> None:
        match definition:
            case m.Struct(fields=fields):
                self._scope([each.name for each in fields])
            case m.Exception_(fields=fields):
                inherited = [each for _, each in self._files.bases(definition, module)]
                before = [f.name for each in inherited if isinstance(each, m.Exception_) for f in each.fields]
                self._scope([each.name for each in fields], before)
            case m.Enum(members=members):
                self._scope([each.name for each in members])
            case m.Interface(operations=operations):
                inherited = [each for _, each in self._files.bases(definition, module)]
                others = [o.name for each in inherited if isinstance(each, m.Interface) for o in each.operations]
                self._scope([each.name for each in operations], [definition.name, *others])
                self._inherited(definition, others)
                for operation in operations:
                    self._scope([each.name for each in operation.params])
            case m.Sequence() | m.Dictionary() | m.Const():
                pass

    def _inherited(self, interface: m.Interface, others: list[Name]) -> None:
        """Operations that meet only where two interfaces are extended at once."""
        seen: dict[str, Name] = {}
        for name in others:
            first = seen.setdefault(name.text.lower(), name)
            if first.text != name.text:
                message = f"`{interface.name}` inherits `{first}` and `{name}`, which are the same to Slice"
                self._report.error("not-in-slice", message, interface.name.span, "rename one of them")

    def _scope(self, names: Sequence[Name], before: Sequence[Name] = ()) -> None:
        """Names that stand side by side; `before` are some that were looked at elsewhere."""
        seen = {each.text.lower(): each for each in reversed(before)}
        for name in names:
            self._check(name)
            first = seen.setdefault(name.text.lower(), name)
            if first is not name:
                self._alike(name, first)

    def _alike(self, name: Name, first: Name) -> None:
        message = f"`{name}` and `{first}` are the same to Slice, which takes no notice of capitals"
        self._report.error("not-in-slice", message, name.span, "rename one of them", ("first here", first.span))

    def _check(self, name: Name) -> None:
        text = name.text
        message = hint = ""
        if text.startswith("_") or text.endswith("_") or "__" in text:
            message = f"`{text}`: underscores at an end, or two in a row, are nothing that Slice has"
            hint = f"rename it, for example to `{'_'.join(filter(None, text.split('_'))) or 'x'}`"
        elif text.lower().startswith("ice"):
            message, hint = f"`{text}`: names that begin with `Ice` are Ice's own", "rename it"
        elif suffix := next((each for each in SUFFIXES if text.endswith(each)), ""):
            message, hint = f"`{text}`: names that end in `{suffix}` are Slice's own", "rename it"
        if message:
            self._report.error("not-in-slice", message, name.span, hint)


def _stem(imported: str) -> str:
    """`/opt/robocomp/interfaces/IDSLs/Laser.idsl` → `Laser`."""
    path = PurePosixPath(imported.replace("\\", "/"))
    return path.stem if path.suffix.lower() == ".idsl" else path.name


def _behind(line: str, note: str, doc: str) -> Iterator[str]:
    """A member with its comment after it or, if the line would be too long, above it."""
    about = "; ".join(filter(None, (note.partition("// ")[2], " ".join(spaced(doc).split()))))
    if about and len(line) + len(about) + 13 <= WIDTH:
        yield f"{line}  // {about}".rstrip("\\ ")
        return
    yield from comment(about, 8)
    yield line
