"""What an existing specific part does not have yet, or has in another form than its generic part asks for."""

from __future__ import annotations

import ast
import textwrap
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from .expressions import handler, handler_signature
from .generate import Model, handlers
from .imports import bound_names, import_statements, used_names
from .machine import state_method, state_signature
from .names import module_name


@dataclass(frozen=True)
class Stubs:
    """Methods to write, by name, and the imports they need besides those there."""

    missing: dict[str, str]
    unfit: dict[str, str]
    """Methods that do not take what they are given, each with the line it should begin with."""
    imports: str
    gone: tuple[str, ...] = ()
    """Modules of the generic part that are imported, but not generated."""


def find_stubs(source: str, model: Model) -> Stubs:
    """What the text of a specificworker.py lacks. One that is no Python, or whose class takes methods from
    elsewhere, is not judged: the component says at its start what it lacks.
    """
    siblings = [module_name(module.name) for module in model.modules]
    worker, gone = _worker(source), tuple(_gone(source, [*siblings, *_OTHERS]))
    if worker is None:
        return Stubs({}, {}, "", gone)
    bound = set(_bound(worker.body))
    methods = {node.name: node for node in worker.body if isinstance(node, ast.FunctionDef)}
    wanted = {
        port.handler(operation.name): (handler(port, operation), handler_signature(port, operation), operation.inputs)
        for port, operation in handlers(model.component)
    }
    if machine := model.component.machine:
        for state in machine.every_state():
            wanted[state.method] = (state_method(state, machine), state_signature(state), ())
    missing = {name: text for name, (text, _, _) in wanted.items() if name not in bound}
    unfit = {
        name: begins
        for name, (_, begins, inputs) in wanted.items()
        if name in methods and not _takes(methods[name].args, len(inputs))
    }
    used = used_names(textwrap.dedent("\n".join(missing.values()))) - set(bound_names(source))
    return Stubs(missing, unfit, import_statements(used, siblings, ".generic"), gone)


_OTHERS = ("genericworker", "params")
"""What the generic part has beside the modules of types."""


def _gone(source: str, there: Collection[str]) -> Iterator[str]:
    for node in _body(source):
        match node:
            case ast.ImportFrom(module="generic", level=1, names=aliases):
                yield from (alias.name for alias in aliases if alias.name not in (*there, "*"))
            case ast.ImportFrom(module=str(name), level=1) if name.startswith("generic."):
                yield from (part for part in name.split(".")[1:2] if part not in there)
            case _:
                pass


def _body(source: str) -> list[ast.stmt]:
    try:
        return ast.parse(source).body
    except (SyntaxError, ValueError):
        return []


def _worker(source: str) -> ast.ClassDef | None:
    body = _body(source)
    worker = next((node for node in body if isinstance(node, ast.ClassDef) and node.name == "SpecificWorker"), None)
    return worker if worker and len(worker.bases) == 1 else None


def _bound(body: list[ast.stmt]) -> Iterator[str]:
    """The names that a class gives to something."""
    for node in body:
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield name
            case ast.Assign(targets=targets):
                yield from (target.id for target in targets if isinstance(target, ast.Name))
            case ast.AnnAssign(target=ast.Name(id=name), value=ast.expr()):
                yield name
            case ast.If(body=then, orelse=otherwise):
                yield from _bound([*then, *otherwise])
            case _:
                pass


def _takes(arguments: ast.arguments, number: int) -> bool:
    """Whether a method can be called with so many values, besides `self`."""
    positional = len(arguments.posonlyargs) + len(arguments.args) - 1
    needed = positional - len(arguments.defaults)
    demanded = any(default is None for default in arguments.kw_defaults)
    return needed <= number and (number <= positional or arguments.vararg is not None) and not demanded
