"""Reports which parts of a component of RoboComp's own generator are understood.

Its files remain unchanged. `src/specificworker.py` takes the place of our specific part, `etc/config` that of our
configuration; only the generic part is new.

    handlers   Laser_getLaserData, or getLaserData, the name before 2018
    proxies    self.laser_proxy, or self.laserpub, the name of a topic's proxy before 2018
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..codegen.machine import states_of
from ..contract.component import Component, Port
from ..contract.interface import Operation, Verb
from ..contract.parameters import ParameterSet
from ..dsl.cdsl.model import Component as CdslComponent
from ..dsl.diagnostics import Diagnostic, did_you_mean, mistyped
from ..dsl.source import Span
from ..dsl.workspace import read_file
from ..errors import ConfigurationError
from ..runtime import settings
from ..spelling import unknown
from ..usercode.check import takes
from .workers import spellings
from .workers.kind import component as as_run
from .workers.python2 import NotConverted, as_python3, parsed

if TYPE_CHECKING:
    from ..runtime.document import Note

WORKER = Path("src") / "specificworker.py"


class Verdict(StrEnum):
    UNDERSTOOD = "understood"
    WITHOUT_EFFECT = "without effect"
    LACKING = "lacking"
    NOT_UNDERSTOOD = "not understood"


@dataclass(frozen=True)
class Finding:
    """The verdict on one item of a component."""

    file: str
    """Path below the component's folder."""
    line: int
    what: str
    verdict: Verdict
    text: str = ""

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True)
class Findings:
    """All findings of one component."""

    folder: Path
    all: tuple[Finding, ...]

    def lines(self) -> Iterator[str]:
        yield f"It was made by RoboComp's generator. Its files remain unchanged; `rc run {self.folder}` runs it."
        yield f"What is in {self.folder}/:"
        yield ""
        yield from listed(self.all)

    def to_json(self) -> list[dict[str, Any]]:
        return [each.to_json() for each in self.all]


def find(
    component: Component, model: CdslComponent | None, found: Sequence[Diagnostic], folder: Path, middleware: str
) -> Findings:
    """The findings about the component in a folder. See `plugins.WorkerLoader.adopted`."""
    return Findings(folder, tuple(_find(component, model, found, folder, middleware)))


def _find(
    component: Component, model: CdslComponent | None, found: Sequence[Diagnostic], folder: Path, middleware: str
) -> Iterator[Finding]:
    if model:
        yield from in_model(model, found)
    yield from in_worker(read_file(folder / WORKER).decode(errors="replace"), component)
    configuration = settings.find(folder)
    if configuration is None:
        return
    file = str(configuration.relative_to(folder))
    try:
        document = settings.read_for(configuration, component)
        settings.settle(document, as_run(component), middleware)
    except ConfigurationError as exc:
        yield Finding(file, 1, "the file", Verdict.NOT_UNDERSTOOD, str(exc))
    else:
        yield from in_configuration(file, document.notes, component.params or ParameterSet(""))


# -- its CDSL --------------------------------------------------------------------------


def in_model(model: CdslComponent, diagnostics: Sequence[Diagnostic]) -> Iterator[Finding]:
    """Findings about the clauses of the CDSL, from their diagnostics."""
    file = model.source.path.name
    for item in model.items:
        yield Finding(file, _line(item.span), f"{item.verb} {item.interface}", Verdict.UNDERSTOOD)
    for clause in model.clauses:
        text = " ".join(clause.span.text.split()).rstrip(";")
        said = [each for each in diagnostics if _overlap(each.span, clause.span)]
        if said:
            yield Finding(file, _line(clause.span), text, Verdict.WITHOUT_EFFECT, said[0].message)
        else:
            yield Finding(file, _line(clause.span), text, Verdict.UNDERSTOOD)


def _line(span: Span) -> int:
    return span.source.position(span.start)[0]


def _overlap(one: Span, other: Span) -> bool:
    return one.source is other.source and one.start < other.end and other.start < one.end


# -- its worker ------------------------------------------------------------------------


def in_worker(text: str, component: Component) -> Iterator[Finding]:
    """Findings about the class's handlers and the proxies that it uses."""
    file = str(WORKER)
    try:
        source, converted = as_python3(text, file)
    except NotConverted as exc:
        yield Finding(file, exc.lineno or 1, "the file", Verdict.NOT_UNDERSTOOD, exc.why)
        return
    if converted:
        yield Finding(file, 1, "Python 2 (converted when it is run)", Verdict.UNDERSTOOD)
    tree = parsed(source, file)
    worker = next((node for node in ast.walk(tree) if _is_worker(node)), None)
    if worker is None:
        yield Finding(file, 1, "the file", Verdict.NOT_UNDERSTOOD, "there is no class SpecificWorker in it")
        return
    assert isinstance(worker, ast.ClassDef)
    methods = {node.name: node for node in ast.walk(worker) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)}
    for port, operation in component.handlers():
        yield _handler(file, worker, methods, port, operation)
    for state in states_of(component):
        if state.method in methods:
            yield Finding(file, methods[state.method].lineno, state.method, Verdict.UNDERSTOOD, "a state")
        else:
            yield Finding(file, worker.lineno, state.method, Verdict.LACKING, "a state without a method")
    yield from _proxies(file, worker, component)


_Method = ast.FunctionDef | ast.AsyncFunctionDef


def _is_worker(node: ast.AST) -> bool:
    return isinstance(node, ast.ClassDef) and node.name == "SpecificWorker"


def _handler(
    file: str, worker: ast.ClassDef, methods: dict[str, _Method], port: Port, operation: Operation[Any]
) -> Finding:
    names = spellings.handlers(port, operation)
    what = "handles" if port.verb is Verb.IMPLEMENTS else "hears"
    about = f"{what} {port.interface.short}.{operation.name}"
    method = next((methods[name] for name in names if name in methods), None)
    if method is None:
        near = mistyped(names[0], [each for each in methods if each.startswith(f"{port.label}_")])
        hint = f"; did you mean `{near}`?" if near else ""
        elsewhere = " here; a base class may" if len(worker.bases) > 1 else ""
        return Finding(file, worker.lineno, names[0], Verdict.LACKING, f"nothing {about}{elsewhere}{hint}")
    number = len(operation.inputs)
    if not takes(method.args, number):
        inputs = ", ".join(each.name for each in operation.inputs) or "nothing"
        message = f"it does not take what it is given: {inputs}"
        return Finding(file, method.lineno, method.name, Verdict.NOT_UNDERSTOOD, message)
    return Finding(file, method.lineno, method.name, Verdict.UNDERSTOOD, about)


def _proxies(file: str, worker: ast.ClassDef, component: Component) -> Iterator[Finding]:
    known = proxies(component)
    used: dict[str, ast.Attribute] = {}
    called: dict[str, dict[str, int]] = {}
    for node in ast.walk(worker):
        match node:
            case ast.Attribute(value=ast.Attribute(value=ast.Name(id="self"), attr=proxy), attr=operation):
                called.setdefault(proxy, {}).setdefault(operation, node.lineno)
            case ast.Attribute(value=ast.Name(id="self"), attr=proxy):
                used.setdefault(proxy, node)
            case _:
                pass
    seen = []
    for name, node in used.items():
        port = known.get(name)
        if port is None and name.endswith("_proxy"):
            yield Finding(file, node.lineno, f"self.{name}", Verdict.NOT_UNDERSTOOD, no_proxy(name, known))
        elif port is not None:
            seen.append(port)
            yield Finding(file, node.lineno, f"self.{name}", Verdict.UNDERSTOOD, f"{port.verb} {port.interface.short}")
            yield from _calls(file, name, port, called.get(name, {}))
    for port in dict.fromkeys(known.values()):
        if port not in seen:
            message = f"{port.verb} {port.interface.short}, and nothing here uses it"
            yield Finding(file, worker.lineno, f"self.{port.attribute}", Verdict.WITHOUT_EFFECT, message)


def _calls(file: str, name: str, port: Port, called: dict[str, int]) -> Iterator[Finding]:
    """Findings about methods that a proxy does not have, though Ice's may."""
    there = spellings.calls(port)
    for operation, line in called.items():
        if operation not in there:
            yield Finding(file, line, f"self.{name}.{operation}", Verdict.NOT_UNDERSTOOD, no_operation(operation, port))


def proxies(component: Component) -> dict[str, Port]:
    """The names of a component's proxies, in all generations."""
    ports = [port for port in component.ports if port.verb.has_proxy]
    return {name: port for port in ports for name in spellings.attributes(port)}


def no_proxy(name: str, known: Mapping[str, Port]) -> str:
    hint = did_you_mean(name, [port.attribute for port in known.values()])
    return f"the .cdsl has nothing that is called so{f'; {hint}' if hint else ''}"


def no_operation(name: str, port: Port) -> str:
    hint = did_you_mean(name, [operation.name for operation, _ in port.interface.under(port.verb)])
    return f"`{port.interface.short}` has no such operation{f'; {hint}' if hint else ''}"


# -- its configuration -----------------------------------------------------------------


def in_configuration(file: str, notes: Iterable[Note], params: ParameterSet) -> Iterator[Finding]:
    """Findings about the keys of a configuration of RoboComp's."""
    names = [*(each.name for each in params.parameters), *(each.name for each in params.lists)]
    for note in notes:
        if note.undeclared:
            yield Finding(file, note.line, note.key, Verdict.UNDERSTOOD, "given to setParams")
        elif note.became[:1] == ("params",) and note.became[1] not in names:
            message = unknown("parameter", str(note.became[1]), names)
            yield Finding(file, note.line, note.key, Verdict.NOT_UNDERSTOOD, message)
        elif note.became:
            key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in note.became).lstrip(".")
            yield Finding(file, note.line, note.key, Verdict.UNDERSTOOD, f"sets {key}")
        else:
            verdict = Verdict.WITHOUT_EFFECT if note.understood else Verdict.NOT_UNDERSTOOD
            yield Finding(file, note.line, note.key, verdict, note.why)


# -- for people ------------------------------------------------------------------------


def listed(findings: Sequence[Finding]) -> Iterator[str]:
    """The report, by file and verdict, the good ones first; equal findings are merged."""
    for file in dict.fromkeys(each.file for each in findings):
        yield f"  {file}"
        for verdict in Verdict:
            group = [each for each in findings if each.file == file and each.verdict is verdict]
            if verdict is Verdict.UNDERSTOOD and group:
                yield f"    {verdict}: {', '.join(each.what for each in group)}"
                continue
            group.sort(key=lambda each: each.line)
            for text in dict.fromkeys(each.text for each in group):
                same = [each for each in group if each.text == text]
                numbers = ", ".join(dict.fromkeys(str(each.line) for each in same))
                line = f"line{'s' if ',' in numbers else ''} {numbers}"
                yield f"    {verdict}: {line}: {', '.join(each.what for each in same)}: {text}"
