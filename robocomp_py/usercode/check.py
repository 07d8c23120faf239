"""Checks a specific part against its model: missing handlers, wrong parameters, handlers that nothing calls any more.

What a component refuses at its start is an error here. What reading cannot tell is not reported.
"""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..contract.component import Component
from ..contract.interface import Interface
from ..dsl.cdsl.model import Component as CdslComponent
from ..dsl.diagnostics import Diagnostic, Report, Severity, did_you_mean, mistyped
from ..dsl.source import Span
from ..dsl.workspace import LinkedComponent, Workspace
from ..spelling import closest
from .reading import CLASS, Method, NotPython, Read, Worker, generic_imports, read_worker, words_of

HOOKS: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("initialize", "compute", "emergency", "restore", "finish"), ()),
    "paramsChanged": ("changed",),
    **dict.fromkeys(("on_deadline_missed", "on_liveliness_lost"), ("port", "operation", "instance", "total")),
}
"""Optional methods that the framework calls in every component, with their arguments."""

_MACHINE, _COMPONENT, _TIMERS = -1, -2, -3
"""The state machine, the component itself, and the first timer, where other entries have the number of a port."""


@dataclass(frozen=True)
class Wanted:
    """A method that a model asks for."""

    name: str
    arguments: tuple[str, ...]
    clause: int
    """The port that asks for it, by its number in the component; negative for others."""


def wanted(component: Component) -> list[Wanted]:
    """The methods that a component has to have."""
    ports = {id(port): number for number, port in enumerate(component.ports)}
    found = [
        Wanted(port.handler(operation.name), tuple(each.attribute for each in operation.inputs), ports[id(port)])
        for port, operation in component.handlers()
    ]
    for port, action in component.actions():
        arguments = ("goal", *(each.attribute for each in action.inputs))
        found.append(Wanted(port.handler(action.name), arguments, ports[id(port)]))
    methods = component.machine.methods() if component.machine else ()
    timers = (Wanted(each.method, (), _TIMERS - number) for number, each in enumerate(component.timers))
    return [*found, *(Wanted(each, (), _MACHINE) for each in methods), *timers]


def takes(arguments: ast.arguments, number: int) -> bool:
    """Whether a method can be called with this number of values, besides `self`."""
    positional = len(arguments.posonlyargs) + len(arguments.args) - 1
    needed = positional - len(arguments.defaults)
    demanded = any(default is None for default in arguments.kw_defaults)
    return needed <= number and (number <= positional or arguments.vararg is not None) and not demanded


def yields(method: ast.FunctionDef) -> bool:
    """Whether a method is a generator. Functions inside of it do not count."""
    inside: list[ast.AST] = list(method.body)
    while inside:
        node = inside.pop()
        if isinstance(node, ast.Yield | ast.YieldFrom):
            return True
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Lambda):
            inside += ast.iter_child_nodes(node)
    return False


def check_worker(linked: LinkedComponent, workspace: Workspace) -> None:
    """Report what is wrong with the specific part beside a component's model, if there is one."""
    workspace.report.extend(complaints(linked, workspace))


def check_component(path: Path, workspace: Workspace) -> None:
    """`check_worker` for the component of a CDSL file, unless its model has mistakes."""
    if linked := workspace.component(path):
        check_worker(linked, workspace)


def check_network(path: Path, workspace: Workspace) -> None:
    """`check_worker` for the components that a network runs; not for programs that are started in their place."""
    model = workspace.deployment(path)
    run = {each.component.text.lower() for each in model.instances if not each.program} if model else set()
    for cdsl in workspace.components_of(path):
        linked = workspace.component(cdsl)
        if linked and linked.component.name.lower() in run:
            check_worker(linked, workspace)


def complaints(linked: LinkedComponent, workspace: Workspace, folder: Path | None = None) -> list[Diagnostic]:
    """What is wrong with the specific part in a folder, by default that of the model."""
    root = folder or linked.path.parent
    try:
        worker = read_worker(root, workspace.read)
    except NotPython as exc:
        message = f"not valid Python: {exc}; the handlers are not checked"
        related = [("it is the code of this component", linked.model.name.span)] if linked.model else []
        return [Diagnostic("python-syntax", message, exc.span, related=tuple(related))]
    gone = list(_gone(linked, root, workspace.read))
    if worker is None:
        return gone
    clauses = _clauses(linked.model, linked.component) if linked.model else {}
    return [*gone, *_Checker(worker, linked, clauses, root, workspace.read).check()]


def _gone(linked: LinkedComponent, folder: Path, read: Read) -> Iterator[Diagnostic]:
    """Imported modules that the generic part lacks; none if it is not generated yet."""
    generic = folder / "generic"
    if not _is_there(generic / "genericworker.py", read):
        return
    for name, at in generic_imports(folder, read):
        if not (_is_there(generic / f"{name}.py", read) or _is_there(generic / name / "__init__.py", read)):
            message = f"there is no module `{name}` in the generic part"
            hint = did_you_mean(name, [each.name for each in linked.modules])
            related = [("the component imports none that makes it", linked.model.name.span)] if linked.model else []
            yield Diagnostic("missing-module", message, at, Severity.ERROR, hint, tuple(related))


def _is_there(path: Path, read: Read) -> bool:
    try:
        read(path)
    except OSError:
        return False
    return True


def stubs_command(cdsl: Path, folder: Path) -> str:
    """The command that appends the stubs of the methods that the specific part in a folder lacks."""
    output = ["-o", str(folder)] if folder != cdsl.parent else []
    return shlex.join(["rcgen", "--stubs", str(cdsl), *output])


def as_warnings(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Errors turned into warnings, for a command that is run to mend them."""
    found = Report()
    for each in diagnostics:
        found.warning(each.code, each.message, each.span, each.hint, *each.related)
    return found.diagnostics


def _clauses(model: CdslComponent, component: Component) -> dict[int, tuple[str, Span]]:
    """The clauses of the model that ask for handlers, by the number of the port or by the constants above."""
    found = {
        number: (f"{item.verb} {item.interface}", item.interface.span)
        for number, (item, _) in enumerate(zip(model.ports, component.ports, strict=False))
    }
    found[_COMPONENT] = (f"component {model.name}", model.name.span)
    if model.statemachine:
        found[_MACHINE] = (f"statemachine {model.statemachine}", model.statemachine.span)
    found |= {_TIMERS - number: (f"timer {each.name}", each.name.span) for number, each in enumerate(model.timers)}
    return found


class _Checker:
    def __init__(
        self,
        worker: Worker,
        linked: LinkedComponent,
        clauses: Mapping[int, tuple[str, Span]],
        folder: Path,
        read: Read,
    ) -> None:
        self._worker, self._linked, self._clauses = worker, linked, clauses
        self._folder, self._read = folder, read
        self._wanted = wanted(linked.component)
        self._actions = {port.handler(action.name) for port, action in linked.component.actions()}

    def check(self) -> Iterator[Diagnostic]:
        yield from self._wrong()
        if self._worker.is_open:
            return
        missing = [each for each in self._wanted if self._worker.find(each.name) is None]
        uncalled = self._uncalled()
        for clause in dict.fromkeys(each.clause for each in missing):
            yield self._lacks(clause, [each for each in missing if each.clause == clause])
        for method in uncalled:
            yield self._report_uncalled(method, [each.name for each in missing])

    def _wrong(self) -> Iterator[Diagnostic]:
        """Methods that cannot be called with what they are given."""
        asked = [*self._wanted, *(Wanted(name, arguments, _COMPONENT) for name, arguments in HOOKS.items())]
        for each in asked:
            method = self._worker.find(each.name)
            if method is None or method.definition is None:
                continue
            hint = f"write `def {each.name}({', '.join(('self', *each.arguments))})`"
            if isinstance(method.definition, ast.AsyncFunctionDef):
                message = f"`{each.name}` is `async def`, but the framework calls it as an ordinary method"
            elif not takes(method.definition.args, len(each.arguments)):
                message = f"`{each.name}` does not take what it is given: {', '.join(each.arguments) or 'nothing'}"
            elif each.name in self._actions and not yields(method.definition):
                message = f"`{each.name}` executes an action, but has no `yield`"
                hint = "write `yield` where the goal waits for the next compute"
            else:
                continue
            related = self._at(each.clause, "asked for here")
            yield Diagnostic("wrong-handler", message, method.at, Severity.ERROR, hint, related)

    def _at(self, clause: int, text: str) -> tuple[tuple[str, Span], ...]:
        """A place in the model, with what it is."""
        return ((text, self._clauses[clause][1]),) if clause in self._clauses else ()

    def _lacks(self, clause: int, missing: Sequence[Wanted]) -> Diagnostic:
        names = [each.name for each in missing]
        text, _ = self._clauses.get(clause, ("", None))
        asked = f", which `{text}` asks for" if text else ""
        others = {name: each for name, each in self._worker.methods.items() if self._is_free(name)}
        near = {name: mistyped(name, others) for name in names}
        meant = [f"`{there}` to `{name}`" for name, there in near.items() if there]
        hint = f"run: {stubs_command(self._linked.path, self._folder)}"
        if meant:
            hint = f"rename {' and '.join(meant)}, or {hint}"
        behind = [each for each in self._worker.behind if any(name in each.members for name in names)]
        if behind:
            hint = f"name the class {behind[0].node.name} in front of GenericWorker, whose own methods are empty"
        related = list(self._at(clause, "asked for here"))
        related += [("this may be meant", others[there].at) for there in near.values() if there]
        message = f"`{CLASS}` lacks {_listed(names)}{asked}"
        return Diagnostic("missing-handler", message, self._worker.main.at, Severity.ERROR, hint, tuple(related))

    def _is_free(self, name: str) -> bool:
        return name not in HOOKS and not name.startswith("__") and name not in {each.name for each in self._wanted}

    def _uncalled(self) -> list[Method]:
        """Methods with names of handlers that no model needs, or misspelt ones of hooks, which no code mentions."""
        interfaces = {
            each.short for module in self._linked.modules for each in module.definitions if isinstance(each, Interface)
        }
        interfaces |= {port.interface.short for port in self._linked.component.ports}
        pattern = re.compile(rf"(?:{'|'.join(map(re.escape, sorted(interfaces))) or '(?!)'})\d*_\w+|(?:sm|timer)_\w+")
        candidates = [
            each
            for name, each in self._worker.methods.items()
            if each.definition and self._is_free(name) and (pattern.fullmatch(name) or self._hook_meant(name))
        ]
        words = words_of(self._folder, self._read) if candidates else None
        return [each for each in candidates if words is not None and each.name not in words]

    def _hook_meant(self, name: str) -> str:
        return mistyped(name, [each for each in HOOKS if self._worker.find(each) is None])

    def _report_uncalled(self, method: Method, missing: Collection[str]) -> Diagnostic:
        """An old handler, or a misspelt hook; `missing` are those that one of its kind may have been renamed to."""
        message = f"`{method.name}` is not called by anything"
        if meant := self._hook_meant(method.name):
            hint = f"did you mean `{meant}`, which the framework calls?"
            return Diagnostic("uncalled-handler", message, method.at, Severity.WARNING, hint)
        kind = method.name.partition("_")[0]
        kin = [name for name in missing if name.partition("_")[0] == kind]
        now = kin[0] if len(kin) == 1 else closest(method.name, kin, prefix=f"{kind}_")
        hint = f"was it renamed to `{now}`?" if now else "remove it if it is not needed any more"
        clauses = [each.clause for each in self._wanted if each.name.partition("_")[0] == kind] or [_COMPONENT]
        related = self._at(clauses[0], "nothing here asks for it")
        return Diagnostic("uncalled-handler", message, method.at, Severity.WARNING, hint, related)


def _listed(names: Sequence[str]) -> str:
    *others, last = (f"`{name}`" for name in names)
    return f"{', '.join(others)} and {last}" if others else last
