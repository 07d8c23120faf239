"""What of a component in C++ is to be written in Python: every method of its class, where it goes, what changes.

    src/specificworker.cpp, .h, and what else defines methods of the class: read as `cplusplus` reads
    the model: which of these methods are handlers, and what those take and return in Python
    specificworker.py: what is written there already is to do no more

The files in C++ stay as they are. Nothing is translated: what a body does is for people, and this is their list.
"""

from __future__ import annotations

import ast
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path, PurePosixPath
from typing import Any

from ..compat.python2 import parsed
from ..contract import types as t
from ..contract.component import Port
from ..contract.interface import Operation
from . import cplusplus, existing
from .cplusplus import Method, Parameter, Token, Unit
from .existing import Finding, Verdict
from .expressions import expanded, handler, handler_signature, hint
from .generate import Artifact, Model, handlers
from .machine import state_signature, states_of
from .names import argument

WORKER = Path("src") / "specificworker.cpp"
CLASS = "SpecificWorker"


class Kind(StrEnum):
    """What becomes of a method."""

    HANDLER = "handlers"
    STATE = "states"
    LIFE = "life cycle"
    HELPER = "helpers"
    GONE = "not needed"
    LACKING = "without counterpart"


_TO_WRITE = (Kind.HANDLER, Kind.STATE, Kind.LIFE, Kind.HELPER)


@dataclass(frozen=True)
class Task:
    """One method in C++."""

    file: str
    """Below the component's folder."""
    line: int
    method: str
    """As C++ has it, without its body."""
    kind: Kind
    python: str
    """How the method begins that it goes into; empty if there is none."""
    changes: tuple[str, ...] = ()
    types: tuple[tuple[str, str, str], ...] = ()
    """Of what a handler takes and returns: name, type in C++, type in Python."""
    written: bool = False
    """Whether that method does something already."""

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True)
class Porting:
    """The whole list."""

    tasks: tuple[Task, ...]
    others: tuple[Finding, ...]
    """Libraries and other things in its code that are another way in Python, or not there."""
    new: tuple[str, ...]
    """Handlers that the model asks for and that C++ does not have."""

    @property
    def left(self) -> list[Task]:
        return [task for task in self.tasks if task.kind in _TO_WRITE and not task.written]

    def to_json(self) -> dict[str, Any]:
        return {
            "methods": [task.to_json() for task in self.tasks],
            "others": [each.to_json() for each in self.others],
            "new": list(self.new),
        }


def is_cpp(folder: Path) -> bool:
    """Whether a folder holds a component of RoboComp's in C++."""
    return (folder / WORKER).is_file() and not (folder / existing.WORKER).exists()


def beside(artifacts: Sequence[Artifact], folder: Path) -> tuple[Artifact, ...]:
    """What is written into such a folder: all but a configuration, if there is one, which goes on to count."""
    configured = (folder / "etc" / "config").exists()
    return tuple(each for each in artifacts if not (configured and each.path == PurePosixPath("etc/config.toml")))


def sources(names: Sequence[str]) -> list[str]:
    """Those of the files in src/ that are the user's, the class itself first."""
    found = [name for name in names if re.search(r"\.(cpp|cc|cxx|h|hpp)\Z", name) and not _GENERATED.match(name)]
    return sorted(found, key=lambda name: (not name.startswith("specificworker."), name))


_GENERATED = re.compile(r"(genericworker|commonbehaviorI|\w*monitor|main|ui_\w+|moc_\w+|qrc_\w+|config|\w+I)\.\w+\Z")
"""What RoboComp's generator, or a build, puts beside the specific part."""


def porting(texts: Mapping[str, str], worker: str, model: Model) -> Porting:
    """The list for the C++ in `texts`, by file below the component's folder; `worker` is our specificworker.py."""
    units = [cplusplus.read(file, text, CLASS) for file, text in texts.items()]
    written = _Written(worker)
    judge = _Judge(model, written)
    tasks = tuple(judge.task(file, method) for file, method in _methods(units))
    own = [unit for unit in units if not Path(unit.file).name.startswith("specificworker.")]
    others = [*_libraries(units), *_own(own), *_places(units), *_calls(units, model)]
    return Porting(tasks, tuple(others), tuple(judge.untouched()))


def _methods(units: Sequence[Unit]) -> Iterator[tuple[str, Method]]:
    """Every method once: where it is defined, or else where it is declared."""
    sections = {(each.name, len(each.parameters)): each.section for unit in units for each in unit.declared}
    defined = [(unit.file, each) for unit in units for each in unit.defined]
    there = {(each.name, len(each.parameters)) for _, each in defined}
    for file, method in defined:
        section = method.section or sections.get((method.name, len(method.parameters)), "")
        yield file, replace(method, section=section)
    for unit in units:
        yield from ((unit.file, each) for each in unit.declared if (each.name, len(each.parameters)) not in there)


# What becomes of a method.

_MACHINE = "the state machine that every component had is the life cycle here"
_LIFE = {
    CLASS: ("initialize", "proxies and parameters are there before it is called"),
    f"~{CLASS}": ("finish", "called once, while everything is there still"),
    "initialize": ("initialize", "a period is `period … ms;` in the .cdsl, or Period.Compute in etc/config"),
    "setParams": ("initialize", 'parameters are declared in a .pdsl (`params "x.pdsl";`) and read as self.params.x'),
    "compute": ("compute", ""),
    "emergency": ("emergency", "self.goToEmergency() leads there"),
    "restore": ("restore", "self.goToRestore() leads there"),
    "sm_initialize": ("initialize", _MACHINE),
    "sm_compute": ("compute", _MACHINE),
    "sm_finalize": ("finish", _MACHINE),
}
_COMMON = "every component answers CommonBehavior by itself"
_GONE = {
    "startup_check": "a component that does not fit its generic part says so when it is started",
    **dict.fromkeys(("getFreq", "setFreq", "timeAwake", "getAttrList", "killYourSelf", "reloadConfig"), _COMMON),
    **dict.fromkeys(("getPeriod", "setPeriod", "getState", "getParameterList", "setParameterList"), _COMMON),
}
_DSR = re.compile(r"(modify|del|add_or_assign|update)_(node|edge|attrs)\w*_slot|\w+_signal\Z")
_AGM = re.compile(
    r"(AGM\w*_\w+|(de)?activateAgent|killAgent|uptimeAgent|reloadConfigAgent|[gs]etAgentParameters|getAgentState"
    r"|setParametersAndPossibleActivation|sendModificationProposal|structuralChange|(edge|symbol)s?Updated"
    r"|selfEdge(Added|Deleted))\Z"
)


class _Judge:
    """Tells for each method in turn what becomes of it."""

    def __init__(self, model: Model, written: _Written) -> None:
        self._component = model.component
        self._written = written
        self._wanted = {
            port.handler(operation.name): (port, operation) for port, operation in handlers(self._component)
        }
        self._states = {state.method: state for state in states_of(self._component)}
        self._seen: set[str] = set()

    def task(self, file: str, method: Method) -> Task:
        name = self._handler(method)
        if name:
            return self._handles(file, method, name)
        if method.name in self._states:
            begins = state_signature(self._states[method.name])
            return self._made(file, method, Kind.STATE, begins, written=self._written.does(method.name))
        if method.section == "signals":
            return self._made(file, method, Kind.LACKING, "", "a signal of Qt: call what is connected to it")
        if method.name in _LIFE:
            hook, change = _LIFE[method.name]
            begins, done = f"def {hook}(self) -> None:", self._written.does(hook)
            return self._made(file, method, Kind.LIFE, begins, change, written=done)
        return self._other(file, method)

    def untouched(self) -> list[str]:
        """The handlers of which there was nothing."""
        return [name for name in self._wanted if name not in self._seen]

    def _handler(self, method: Method) -> str:
        """The handler that a method is, by the name it has, or had in generators before 2018: without the interface."""
        if method.name in self._wanted:
            return method.name
        bare = [name for name, (_, operation) in self._wanted.items() if operation.name == method.name]
        free = [name for name in bare if name not in self._seen] or bare
        alike = [name for name in free if self._arity(name) == len(method.parameters)] or free
        return alike[0] if alike else ""

    def _arity(self, name: str) -> int:
        _, operation = self._wanted[name]
        return len(operation.inputs) + len(_outs(operation))

    def _handles(self, file: str, method: Method, name: str) -> Task:
        self._seen.add(name)
        port, operation = self._wanted[name]
        changes, types = (*_changes(method, operation), *_nowhere(method)), tuple(_types(method, operation))
        begins = _on_one_line(handler_signature(port, operation))
        done = self._written.does(name, handler(port, operation))
        return Task(file, method.line, method.text, Kind.HANDLER, begins, changes, types, done)

    def _other(self, file: str, method: Method) -> Task:
        short = method.name.removeprefix("CommonBehavior_")
        if short in _GONE:
            return self._made(file, method, Kind.GONE, "", _GONE[short])
        if _DSR.match(method.name):
            return self._made(file, method, Kind.LACKING, "", "a slot of DSR's graph, which is not known here")
        if _AGM.match(method.name):
            return self._made(file, method, Kind.LACKING, "", "of AGM, which is not known here")
        notes = [*self._received(method.name), *_given_back(method), *_nowhere(method)]
        return self._made(file, method, Kind.HELPER, "", *notes, written=self._written.has(method.name))

    def _received(self, name: str) -> list[str]:
        """Whether a helper is called as if it were a handler."""
        interface, _, operation = name.partition("_")
        if not operation or not interface[:1].isupper() or interface.isupper():
            return []
        if any(port.label == interface for port, _ in self._wanted.values()):
            return [f"is it a handler? {interface} has no {operation} here"]
        return [f"is it a handler? the .cdsl has no {interface} that is received"]

    def _made(self, file: str, method: Method, kind: Kind, begins: str, *changes: str, written: bool = False) -> Task:
        return Task(file, method.line, method.text, kind, begins, tuple(filter(None, changes)), written=written)


def _given_back(method: Method) -> list[str]:
    names = [each.name or each.type for each in method.parameters if each.gives_back]
    return [f"gives {', '.join(names)} back: return {'them' if len(names) > 1 else 'it'}"] if names else []


def _nowhere(method: Method) -> list[str]:
    return [] if method.body is not None else ["declared, and defined nowhere"]


def _on_one_line(text: str) -> str:
    """A signature as it is quickest to read beside the one in C++."""
    return " ".join(text.split()).replace("( ", "(").replace(", )", ")")


def _outs(operation: Operation[Any]) -> list[str]:
    """The names of its `out` parameters."""
    return [each.name for each in operation.outputs if each.name != "ret"]


def _changes(method: Method, operation: Operation[Any]) -> Iterator[str]:
    """What is another way in Python, beside the types."""
    outs = _outs(operation)
    if outs:
        behind = ", behind what is returned already" if len(operation.outputs) > len(outs) else ""
        order = ", in this order" if len(outs) > 1 and not behind else ""
        yield f"{', '.join(outs)}: out, so returned{behind}{order}"
    theirs = [each.name for each in _taken(method, operation)]
    ours = [argument(each) for each in operation.inputs]
    if len(method.parameters) != len(operation.inputs) + len(outs):
        yield f"the IDSL has other parameters now: {operation.source}"
    elif theirs != ours:
        other = [f"{one} is {two}" for one, two in zip(theirs, ours, strict=True) if one and one != two]
        yield from ([f"other names: {', '.join(other)}"] if other else [])
    if operation.raises and any(token.text == "throw" for token in method.body or ()):
        names = ", ".join(each.name.replace("::", ".") for each in operation.raises)
        yield f"what it throws is raised: {names}"
    fields = [*operation.inputs, *operation.outputs]
    named = {hint(each.type, ""): _python(each.type) for each in fields}
    yield from (f"{name} is {python}" for name, python in named.items() if name != python)


def _taken(method: Method, operation: Operation[Any]) -> list[Parameter]:
    """The parameters that are inputs."""
    if sum(each.gives_back for each in method.parameters) == len(_outs(operation)):
        return [each for each in method.parameters if not each.gives_back]
    outs = _outs(operation)
    return [each for each in method.parameters if each.name not in outs][: len(operation.inputs)]


def _python(kind: t.Type) -> str:
    """What a value is, said without the name that its IDSL gives to a sequence or a dictionary."""
    return expanded(kind, "") if isinstance(kind, t.Sequence | t.Dictionary) else hint(kind, "")


def _types(method: Method, operation: Operation[Any]) -> Iterator[tuple[str, str, str]]:
    taken = _taken(method, operation)
    given = [each for each in method.parameters if each not in taken]
    for parameter, field in zip(taken, operation.inputs, strict=False):
        yield argument(field), parameter.type, _python(field.type)
    outputs = list(operation.outputs)
    if outputs and outputs[0].name == "ret":
        yield "", method.returns, _python(outputs.pop(0).type)
    for parameter, field in zip(given, outputs, strict=False):
        yield field.name, parameter.type, _python(field.type)


class _Written:
    """What our specific part has already."""

    def __init__(self, text: str) -> None:
        try:
            tree = parsed(text, "specificworker.py")
        except (SyntaxError, ValueError):
            tree = ast.Module([], [])  # whoever starts it is told
        classes = (node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == CLASS)
        body = next((node.body for node in classes), [])
        self._methods = {node.name: node for node in body if isinstance(node, ast.FunctionDef)}

    def has(self, name: str) -> bool:
        return name in self._methods

    def does(self, name: str, stub: str = "") -> bool:
        """Whether a method does more than the one that rcgen wrote."""
        if name not in self._methods:
            return False
        made = ast.parse(textwrap.dedent(stub)).body
        empty = [[], ["Pass()"], *(_statements(node) for node in made if isinstance(node, ast.FunctionDef))]
        return _statements(self._methods[name]) not in empty


def _statements(method: ast.FunctionDef) -> list[str]:
    """A body without its docstring, to compare."""
    body = method.body[1:] if ast.get_docstring(method) is not None else method.body
    return [ast.dump(each) for each in body]


# What else is in its code.

_WINDOW = "a window: PySide6 can show it from code of yours, but nothing is generated for it"
_LIBRARIES: tuple[tuple[str, str | None], ...] = (
    (r"(genericworker|specificworker|commonbehaviorI)\.h|(?i:configloader)|Ice(Util|Storm)?/", None),
    (r"ui_\w+\.h|qlog/", _WINDOW),
    (r"osg|.*viewer|innermodel/.*viewer|rcdraw|qcustomplot|(?i:.*graphic)", "draws: nothing is generated for it"),
    (r"(?i:innermodel)", "InnerModel's tree of transforms is not known here: numpy, or pytransform3d"),
    (r"dsr/", "the graph of DSR is not known here"),
    (r"(?i:agm)", "AGM is not known here"),
    (r"qmat/|Eigen/|eigen3/|unsupported/Eigen", "numpy does this"),
    (r"opencv\d?/|cv\.h|highgui\.h", "cv2 does this (pip install opencv-python)"),
    (r"pcl/", "open3d does much of this"),
    (r"boost/|cppitertools/|ranges|fmt/", "Python's own library does this"),
    (r"doublebuffer\w*/|fps/|timer/|fixedsizedeque|threadpool/", "a class of RoboComp's for C++ only"),
    (r"Qt?[A-Z]\w*\Z|qt\d/|Qt\w*/|q[a-z]+\.h", "Qt: what is no window has a counterpart in Python's own library"),
    (r"ros/|\w+_msgs/", "ROS: over another middleware in Python"),
)
_STANDARD = re.compile(
    r"[a-z_]+\Z|(sys|bits|experimental|ext)/|c?(math|stdio|stdlib|string|time|assert|errno|float)\.h\Z"
)
_STANDARD_C = re.compile(r"(unistd|signal|pthread|fcntl|limits|stdint|termios|malloc|omp|memory|values)\.h\Z")


def _libraries(units: Sequence[Unit]) -> Iterator[Finding]:
    """What is included, and what does the same in Python."""
    own = {Path(unit.file).name for unit in units}
    rules = [(re.compile(pattern), text) for pattern, text in _LIBRARIES]
    for unit in units:
        for include in unit.includes:
            if Path(include.name).name in own or _STANDARD.match(include.name):
                continue
            unknown = "no counterpart is known: look for its Python form, or bind what you need of it"
            if include.quoted and ("/" not in include.name or include.name[0] in "./"):
                unknown = _OWN
            text = next((text for pattern, text in rules if pattern.match(include.name)), unknown)
            if text:
                yield Finding(unit.file, include.line, include.name, Verdict.LACKING, text)


_OWN = "code of your own: to be ported too"


def _own(units: Sequence[Unit]) -> Iterator[Finding]:
    for unit in units:
        yield Finding(unit.file, 1, Path(unit.file).name, Verdict.LACKING, _OWN)


_Place = tuple[tuple[str, ...], Verdict, str]
_LOCKS = "no two methods run at once here, so locks between them go"
_THREADS = "threads of your own are threading.Thread, and are ended in finish"
_LOG = "self.log.info(…) and the like"
_PLACES: tuple[_Place, ...] = (
    (("Ice", "::", "Exception"), Verdict.UNDERSTOOD, "except RobocompError, of robocomp_py.errors"),
    (("timer", ".", "start"), Verdict.UNDERSTOOD, "the period is self.period, in seconds"),
    (("setPeriod", "("), Verdict.UNDERSTOOD, "the period is self.period, in seconds"),
    (("QTimer",), Verdict.LACKING, "a timer of its own: count in compute"),
    (("emit",), Verdict.LACKING, "a signal of Qt: call what is connected to it"),
    (("connect", "("), Verdict.LACKING, "a signal of Qt: call what is connected to it"),
    (("G", "->"), Verdict.LACKING, "the graph of DSR is not known here"),
    (("innerModel", "->"), Verdict.LACKING, "InnerModel's tree of transforms is not known here"),
    (("innermodel", "->"), Verdict.LACKING, "InnerModel's tree of transforms is not known here"),
    *(((name,), Verdict.UNDERSTOOD, _LOCKS) for name in ("QMutexLocker", "lock_guard", "unique_lock", "scoped_lock")),
    *(((name,), Verdict.UNDERSTOOD, _LOCKS) for name in ("shared_lock", "mutex")),
    *(((name,), Verdict.UNDERSTOOD, _LOG) for name in ("qDebug", "qInfo", "qWarning", "cout", "cerr", "printf")),
    (("std", "::", "thread"), Verdict.UNDERSTOOD, _THREADS),
    (("std", "::", "jthread"), Verdict.UNDERSTOOD, _THREADS),
    (("QThread",), Verdict.UNDERSTOOD, _THREADS),
)


def _places(units: Sequence[Unit]) -> Iterator[Finding]:
    """What is said another way in Python, where a body does it."""
    by_first: dict[str, list[_Place]] = {}
    for place in _PLACES:
        by_first.setdefault(place[0][0], []).append(place)
    for file, tokens, at in _steps(units):
        for words, verdict, text in by_first.get(tokens[at].text, ()):
            if tuple(token.text for token in tokens[at : at + len(words)]) == words:
                yield Finding(file, tokens[at].line, "".join(words).removesuffix("("), verdict, text)


def _steps(units: Sequence[Unit]) -> Iterator[tuple[str, Sequence[Token], int]]:
    """Every token of every body: its file, the body, its place there."""
    for unit in units:
        for method in unit.defined:
            tokens = method.body or ()
            yield from ((unit.file, tokens, at) for at in range(len(tokens)))


def _calls(units: Sequence[Unit], model: Model) -> Iterator[Finding]:
    """Calls of other components that look another way in Python, or that the model does not know."""
    known = existing.proxies(model.component)
    for file, tokens, at in _steps(units):
        name = tokens[at].text
        asked = at + 3 < len(tokens) and tokens[at + 1].text == "->" and tokens[at + 3].text == "("
        if not asked or not (name.endswith("_proxy") or name in known):
            continue
        found = _call(known, name, tokens[at + 2].text)
        if found:
            yield Finding(file, tokens[at].line, f"{name}->{tokens[at + 2].text}", *found)


def _call(known: Mapping[str, Port], name: str, called: str) -> tuple[Verdict, str] | None:
    port = known.get(name)
    if port is None:
        return Verdict.NOT_UNDERSTOOD, existing.no_proxy(name, known)
    operations = {operation.name: operation for operation, _ in port.interface.under(port.verb)}
    if called not in operations:
        if called.startswith(("ice_", "begin_", "end_")):
            return Verdict.LACKING, f"of Ice; a call that does not wait is self.{port.attribute}.…Async(…)"
        return Verdict.NOT_UNDERSTOOD, existing.no_operation(called, port)
    operation = operations[called]
    if not _outs(operation):
        return None
    results = ", ".join(each.name for each in operation.outputs)
    inputs = ", ".join(argument(each) for each in operation.inputs)
    return Verdict.UNDERSTOOD, f"{results} = self.{port.attribute}.{called}({inputs})"


# For people.


def listed(found: Porting, root: Path) -> Iterator[str]:
    """What is to do, by kind; then what else to know. Said in short once a method is written."""
    to_write = [task for task in found.tasks if task.kind in _TO_WRITE]
    done = len(to_write) - len(found.left)
    yield f"Its methods go into {root / 'specificworker.py'}: {done} of {len(to_write)} are written."
    for kind in Kind:
        group = [task for task in found.tasks if task.kind is kind]
        left = [task for task in group if not task.written]
        if left:
            yield f"\n  {kind}"
            yield from _grouped(left) if kind in (Kind.GONE, Kind.LACKING) else _detailed(left)
        if any(task.written for task in group):
            yield f"\n  {kind} written: {', '.join(_called(task) for task in group if task.written)}"
    if found.new:
        yield f"\n  new, not in C++: {', '.join(found.new)}"
    for verdict, title in _TITLES.items():
        lines = [each for each in found.others if each.verdict is verdict]
        if lines:
            yield f"\n  {title}"
            for text in dict.fromkeys(each.text for each in lines):
                same = [each for each in lines if each.text == text]
                yield f"    {_where(same)}: {', '.join(dict.fromkeys(each.what for each in same))}: {text}"


_TITLES = {
    Verdict.UNDERSTOOD: "said another way",
    Verdict.LACKING: "without counterpart here",
    Verdict.NOT_UNDERSTOOD: "not understood",
}


def _detailed(tasks: Sequence[Task]) -> Iterator[str]:
    for task in tasks:
        yield f"    {task.file}:{task.line}: {task.method}"
        if task.python:
            yield f"        {task.python}"
        yield from (f"        # {change}" for change in task.changes)


def _grouped(tasks: Sequence[Task]) -> Iterator[str]:
    for changes in dict.fromkeys(task.changes for task in tasks):
        same = [task for task in tasks if task.changes == changes]
        findings = [Finding(task.file, task.line, _called(task), Verdict.LACKING) for task in same]
        names = ", ".join(dict.fromkeys(each.what for each in findings))
        yield f"    {_where(findings)}: {names}: {'; '.join(changes)}"


def _called(task: Task) -> str:
    """A method's name, from how it is written."""
    return task.method.partition("(")[0].rpartition(" ")[2]


_SHOWN = 6


def _where(findings: Sequence[Finding]) -> str:
    """`src/specificworker.cpp:12, 40 and 7 more; src/specificworker.h:3`."""
    files = []
    for file in dict.fromkeys(each.file for each in findings):
        lines = list(dict.fromkeys(str(each.line) for each in findings if each.file == file))
        more = f" and {len(lines) - _SHOWN} more" if len(lines) > _SHOWN else ""
        files.append(f"{file}:{', '.join(lines[:_SHOWN])}{more}")
    return "; ".join(files)
