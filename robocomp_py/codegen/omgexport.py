"""Exports IDSL to OMG IDL 4, for programs that use DDS directly: the types, and the messages of each operation.

There is a file for each module. In addition to the rules of omgidl.py: a query has a request and a response, a command
a request, and a publication its own struct. An operation without a pattern has all three if it can be a publication.
Exceptions are structs that include the fields of their bases. Our message headers are not part of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import PurePosixPath
from typing import Any

from ..contract import types as t
from ..contract.interface import Interface, Operation, Pattern
from ..contract.module import Constant, Module
from ..dsl.diagnostics import Report
from ..dsl.idsl import model as m
from ..dsl.source import Name
from . import omgidl
from .exporting import Files, heading
from .generate import Artifact
from .names import short


def to_omgidl(files: Files, report: Report) -> tuple[Artifact, ...]:
    """A file for each module; reports what IDL cannot express."""
    sent: list[t.Type] = []
    constants: list[Constant] = []
    for module in files.contracts:
        _check(module, files, report)
        for each in module.definitions:
            match each:
                case t.Struct() | t.Enumeration():
                    sent.append(each)
                case t.ExceptionType(name=name, all_fields=fields, doc=doc):
                    sent.append(t.Struct(name, fields, doc=" ".join(filter(None, (doc, "An exception.")))))
                case Constant(type=kind):
                    constants.append(replace(each, type=t.INT64) if kind is t.TIME else each)
                case Interface(operations=operations, actions=actions):
                    parts = [part for action in actions for part in action.parts]
                    sent += [kind for operation in (*operations, *parts) for kind in _messages(operation)]
                case t.Sequence() | t.Dictionary():
                    pass  # written where they are used
    texts = omgidl.idl(sent, [], _ABOUT, constants)
    origin = {f"{module.name}.idl": heading(", ".join(module.files)) for module in files.contracts}
    return tuple(
        Artifact(PurePosixPath(name), text.replace(_ABOUT, origin.get(name, _ABOUT), 1)) for name, text in texts.items()
    )


_ABOUT = heading("IDSL")
"""Heading of the file with types that belong to no module."""


def _messages(operation: Operation[Any]) -> Iterator[t.Struct]:
    thrown = f"Throws {', '.join(short(each.name) for each in operation.raises)}." if operation.raises else ""
    for message in _bare(operation):
        about = (message.doc, operation.doc, thrown if message.name == operation.response.name else "")
        yield replace(message, doc=" ".join(filter(None, about)))


def _bare(operation: Operation[Any]) -> Iterator[t.Struct]:
    gives_back = bool(operation.outputs or operation.raises)
    if operation.pattern is Pattern.PUBLISH or (operation.pattern is None and not gives_back):
        yield omgidl.publication(operation, headed=False)
    if operation.pattern is not Pattern.PUBLISH:
        yield omgidl.request(operation, headed=False)
    if operation.pattern in (None, Pattern.QUERY):
        yield omgidl.response(operation, headed=False)


# -- what IDL does not hold ------------------------------------------------------------


def _check(module: Module, files: Files, report: Report) -> None:
    syntax = {each.name.text: each for each in files.modules[module.name]}
    scope = list(_named(module, syntax))
    _check_scope(scope, module.name, report)
    for written, at in scope:
        if written.lower() == "final":
            message = f"`{written}` is also an annotation of every struct, and idlc confuses the two"
            report.error("not-in-omgidl", message, at.span, "rename it")
    for each in syntax.values():
        match each:
            case m.Struct(name=name, fields=fields) | m.Exception_(name=name, fields=fields):
                _check_scope([(field.name.text, field.name) for field in fields], name.text, report)
                for field in fields:
                    if field.default:
                        message = f"IDL has no defaults; the default of `{field.name}` is omitted"
                        report.warning("lossy-in-omgidl", message, field.default.span)
            case m.Enum(name=name, members=members):
                _check_scope([(member.name.text, member.name) for member in members], name.text, report)
            case m.Interface(operations=operations):
                for param in (param for operation in operations for param in operation.params if param.default):
                    message = f"IDL has no defaults; the default of `{param.name}` is omitted"
                    report.warning("lossy-in-omgidl", message, param.name.span)
                for operation in operations:
                    names = [(param.name.text, param.name) for param in operation.params]
                    _check_scope(names, "", report)
            case m.Const(type=Name(text="time"), name=name):
                message = f"a constant in IDL cannot be a struct; `{name}` becomes int64, nanoseconds since 1970"
                report.warning("lossy-in-omgidl", message, name.span)
            case _:
                pass


def _named(module: Module, syntax: dict[str, m.Definition]) -> Iterator[tuple[str, Name]]:
    """The names that a module of IDL defines, each with the name in the IDSL that it comes from."""
    feedback: dict[str, Interface] = {}
    for each in module.definitions:
        if isinstance(each, Interface):
            feedback |= {short(action.feedback.name): each for action in each.actions if action.feedback}
    for each in module.definitions:
        at = syntax[short((feedback.get(short(each.name)) or each).name)]
        match each:
            case t.Struct(name=name) if short(name) in feedback:
                yield short(name), at.name
            case t.Struct() | t.Enumeration() | t.ExceptionType() | Constant():
                yield at.name.text, at.name
            case t.Dictionary():
                yield f"{at.name}Entry", at.name
            case Interface(operations=operations, actions=actions):
                assert isinstance(at, m.Interface)
                own = {operation.name.text: operation.name for operation in at.operations}
                for operation in (*operations, *(part for action in actions for part in action.parts)):
                    for kind in _bare(operation):
                        yield short(kind.name), own.get(operation.name.partition("-")[0], at.name)
            case t.Sequence():
                pass


def _check_scope(names: list[tuple[str, Name]], owner: str, report: Report) -> None:
    """Report clashes of names. The scope `owner` is itself one of the names in it."""
    seen: dict[str, tuple[str, Name]] = {}
    for written, at in names:
        other, first = seen.setdefault(written.lower(), (written, at))
        related = [] if first is at else [("first here", first.span)]
        if written == owner or (written == other and first is not at):
            message = f"`{written}` would be defined twice in one scope, which IDL does not allow"
            report.error("not-in-omgidl", message, at.span, "rename one of them", *related)
            continue
        if first is at:
            other = owner
        if written.lower() == other.lower():
            message = f"`{written}` and `{other}` differ only in case, which some IDL compilers reject"
            report.warning("alike-in-omgidl", message, at.span, "idlc accepts it with -f case-sensitive", *related)
