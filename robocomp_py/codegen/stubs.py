"""Finds and adds the methods that an existing specific part lacks, and finds those with a wrong signature."""

from __future__ import annotations

import ast
import io
import re
import sys
import textwrap
import tokenize
from dataclasses import dataclass
from pathlib import Path

from ..usercode.check import takes
from ..usercode.reading import FILE, NotPython, Read, Worker, generic_imports, parse_python, read_worker
from .actions import steps_method, steps_signature
from .expressions import handler, handler_signature
from .generate import GenerationError, Model
from .imports import bound_names, import_from, import_statements, used_names
from .machine import state_method, state_signature
from .names import module_name
from .timers import timer_method, timer_signature


@dataclass(frozen=True)
class Stubs:
    """Missing methods by name, and the imports that they need in addition."""

    missing: dict[str, str]
    unfit: dict[str, str]
    """Methods with wrong arguments, each with its correct first line."""
    imports: str
    gone: tuple[str, ...] = ()
    """Imported modules of the generic part that are no longer generated."""


def find_stubs(folder: Path, model: Model, read: Read) -> Stubs:
    """What the specificworker.py of a folder lacks; nothing if it is not valid Python, or if its class cannot be
    analysed. The component itself reports missing methods at its start.
    """
    siblings = [module_name(module.name) for module in model.modules]
    try:
        source, _ = parse_python(folder / FILE, read(folder / FILE))
        worker = read_worker(folder, read)
    except (NotPython, OSError):
        return Stubs({}, {}, "")
    gone = tuple(name for name, _ in generic_imports(folder, read) if name not in (*siblings, *_OTHERS))
    if worker is None:
        return Stubs({}, {}, "", gone)
    wanted: dict[str, tuple[str, str, tuple[object, ...]]] = {
        port.handler(operation.name): (handler(port, operation), handler_signature(port, operation), operation.inputs)
        for port, operation in model.component.handlers()
    }
    for port, action in model.component.actions():
        text, begins = steps_method(port, action), steps_signature(port, action)
        wanted[port.handler(action.name)] = (text, begins, (None, *action.inputs))
    if machine := model.component.machine:
        for state in machine.every_state():
            wanted[state.method] = (state_method(state, machine), state_signature(state), ())
    for timer in model.component.timers:
        wanted[timer.method] = (timer_method(timer), timer_signature(timer), ())
    missing = {name: text for name, (text, _, _) in wanted.items() if not worker.is_open and not worker.find(name)}
    unfit = {name: begins for name, (_, begins, inputs) in wanted.items() if not _fits(worker, name, len(inputs))}
    used = used_names(textwrap.dedent("\n".join(missing.values()))) - set(bound_names(source.text))
    return Stubs(missing, unfit, import_statements(used, siblings, ".generic"), gone)


_OTHERS = ("fakes", "genericworker", "params")
"""Other modules of the generic part than those of types."""


def _fits(worker: Worker, name: str, number: int) -> bool:
    """Whether a method takes this number of values; True if that is unknown."""
    method = worker.find(name)
    return method is None or method.definition is None or takes(method.definition.args, number)


# Adding methods.


def with_stubs(folder: Path, stubs: Stubs, read: Read) -> bytes:
    """The specificworker.py of a folder with the missing methods at the end of its class. Nothing else changes.

    Raises GenerationError for a class to which no methods can be added.
    """
    worker, path = read_worker(folder, read), folder / FILE
    assert worker is not None, "or nothing would be missing"
    text, body = worker.source.text, worker.main.node.body
    last = body[-1].end_lineno
    if worker.source.path != path:
        raise GenerationError(f"{path}: its SpecificWorker is defined in {worker.source.path.name}; paste the methods")
    if last is None or worker.main.node.lineno == body[0].lineno:
        raise GenerationError(f"{path}: SpecificWorker is written on one line; begin a new line after its `:`")
    lines = text.split("\n")
    margin = re.match(r"\s*", lines[body[0].lineno - 1])
    methods = [_indented(each, margin[0] if margin else "") for each in stubs.missing.values()]
    empty = len(body) == 1 and isinstance(body[0], ast.Pass)
    added = "\n".join(methods).rstrip("\n").split("\n")
    lines[last - 1 if empty else last : last] = added if empty else ["", *added]
    changed = _with_imports("\n".join(lines), stubs.imports)
    ast.parse(changed)
    return _encoded(changed, read(path), path)


def _indented(method: str, margin: str) -> str:
    """A method with the same indentation as the others in its class."""
    inner = textwrap.dedent(method)
    if "\t" in margin:
        inner = re.sub(r"^(?: {4})+", lambda found: "\t" * (len(found[0]) // 4), inner, flags=re.MULTILINE)
    return textwrap.indent(inner, margin)


def _with_imports(text: str, imports: str) -> str:
    """A module with these imports added, at the places that linters expect."""
    for statement in ast.parse(imports).body:
        lines = text.split("\n")
        there = [node for node in ast.parse(text).body if isinstance(node, ast.Import | ast.ImportFrom)]
        relative = [node for node in there if isinstance(node, ast.ImportFrom) and node.level]
        before, after = len(lines), 0
        new = [ast.unparse(statement)]
        if isinstance(statement, ast.ImportFrom) and statement.level:
            same = [node for node in relative if node.module == statement.module and node.lineno == node.end_lineno]
            same = [node for node in same if all(alias.name != "*" and not alias.asname for alias in node.names)]
            if same:
                names = {alias.name for node in (same[0], statement) for alias in node.names}
                before, after = same[0].lineno - 1, same[0].lineno
                new = [import_from(f".{statement.module or ''}", sorted(names))]
            elif relative:
                before = after = relative[0].lineno - 1
            else:
                before = after = there[-1].end_lineno or 0 if there else _behind_docstring(text)
                new = ["", *new]
        elif absolute := [node for node in there if node not in relative and _source(node) != "__future__"]:
            own = [node for node in absolute if _is_library(node) == _is_library(statement)]
            before = after = (own or absolute)[-1].end_lineno or 0
            new = new if own else ["", *new]
        else:
            future = [node.end_lineno or 0 for node in there if _source(node) == "__future__"]
            before = after = max([*future, _behind_docstring(text)])
            new = ["", *new]
        lines[before:after] = new
        text = "\n".join(lines)
    return text


def _behind_docstring(text: str) -> int:
    first = next(iter(ast.parse(text).body), None)
    return first.end_lineno or 0 if isinstance(first, ast.Expr) else 0


def _source(node: ast.stmt) -> str:
    """The module that an import is from."""
    return str(node.module) if isinstance(node, ast.ImportFrom) else getattr(node, "names", [ast.alias("")])[0].name


def _is_library(node: ast.stmt) -> bool:
    return _source(node).partition(".")[0] not in sys.stdlib_module_names


def _encoded(text: str, before: bytes, path: Path) -> bytes:
    """A text in the encoding, and with the line ends and byte order mark, of its file."""
    encoding, _ = tokenize.detect_encoding(io.BytesIO(before).readline)
    crlf = before.count(b"\r\n") * 2 > before.count(b"\n")
    try:
        return (text.replace("\n", "\r\n") if crlf else text).encode(encoding)
    except UnicodeEncodeError as exc:
        raise GenerationError(f"{path} is {encoding}, which has no `{text[exc.start]}`; save it as UTF-8") from exc
