"""Runs a component of RoboComp's own generators as a worker of ours.

Its `SpecificWorker` is not a `Worker`. An `ExistingWorker` owns it, and makes its base `GenericWorker` with only the
names of RoboComp's generated class. So our names do not clash with the author's, and the class may derive from a
window. Its code runs like any worker's: one piece at a time.
"""

from __future__ import annotations

import ast
import gc
import importlib
import inspect
import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

from ...contract.component import Port
from ...contract.interface import Operation
from ...contract.statemachine import StateMachine, label
from ...errors import ComponentError, TransportError
from ...runtime.clock import Real
from ...runtime.document import Document
from ...runtime.lifecycle import Beat
from ...runtime.trace import frames_in, times_more, user_trace, way_of
from ...runtime.worker import Worker
from ...transports.sparing import Repeats
from . import qt, spellings, waits
from .given import entries
from .ice import Ices, real, uses_ice
from .imports import Imports, source_text
from .kind import component as as_in_robocomp
from .libraries import advice
from .machines import Chart
from .proxies import handler, proxy_class
from .python2 import NotConverted, as_python3, parsed
from .slices import Slices, component_of, module_of

log = logging.getLogger("robocomp.worker")

WORKER = Path("src") / "specificworker.py"
_FORM = Path("src") / "mainUI.ui"

_ARGUMENTS = {
    **dict.fromkeys(("configData", "configdata", "config_data", "config"), "tables"),
    **dict.fromkeys(("params", "parameters"), "texts"),
    "startup_check": "no",
}
"""Arguments of a constructor after the proxies."""

_PLACES = 3
"""Maximum number of lines that a warning names."""


def existing_worker(folder: Path, package: str, alone: bool) -> type[ExistingWorker]:
    """The worker class for a component with a generated generic part, whose folder is the package of that name.

    `alone`, it runs in its own folder, as RoboComp starts it. Raises ComponentError if its file cannot be read; what
    it imports is imported when it is made.
    """
    sources = dict(_sources(folder))
    generated = importlib.import_module(f"{package}.generic.genericworker").GenericWorker
    component = as_in_robocomp(generated.component)
    modules = {
        path.stem: importlib.import_module(f"{package}.generic.{path.stem}")
        for path in sorted((folder / "generic").glob("*.py"))
        if path.stem not in ("__init__", "genericworker", "params")
    }
    tree = parsed(sources[WORKER.name], str(folder / WORKER))
    if not any(isinstance(node, ast.ClassDef) and node.name == "SpecificWorker" for node in ast.walk(tree)):
        raise ComponentError(f"{folder / WORKER} has no class SpecificWorker(GenericWorker)")
    is_ice = "Ice" in sys.modules or any(map(uses_ice, sources.values()))
    ices = Ices(package, real if is_ice else _nothing)
    slices = Slices(package, ices.user_exception)
    own = component_of(component, slices, partial(proxy_class, ices=ices))
    handlers = {
        port.handler(operation.name): _handler(port, operation)
        for port in own.ports
        if not port.verb.has_proxy
        for operation, _ in port.interface.under(port.verb)
    }
    namespace = {
        **handlers,
        "__module__": __name__,
        "_home": folder,
        "package": package,
        "alone": alone,
        "component": own,
        "middleware": generated.middleware,
        "window": component.window,
        "machine": component.machine,
        "sources": sources,
        "tree": tree,
        "generated": modules,
        "ices": ices,
        "slices": slices,
    }
    return type("SpecificWorker", (ExistingWorker,), namespace)


def _nothing(name: str) -> None:
    return None


def _sources(folder: Path) -> Iterator[tuple[str, str]]:
    """The author's readable files. Files besides the specific part may be unused leftovers, so errors are skipped."""
    for path in sorted((folder / "src").glob("*.py")):
        if path.is_file() and _is_users(path, folder):
            try:
                yield path.name, as_python3(source_text(path.read_bytes()), str(path))[0]
            except NotConverted as exc:
                if path.name == WORKER.name:
                    raise ComponentError(_not_converted(exc, path)) from exc


def _not_converted(exc: NotConverted, path: Path) -> str:
    return f"{exc.filename or path}:{exc.lineno or 1}: {exc.why}"


def _is_users(path: Path, folder: Path) -> bool:
    """Whether the author wrote a file of `src`, and not RoboComp's generator."""
    if path.name in ("genericworker.py", "interfaces.py", "__init__.py", f"{folder.name}.py"):
        return False
    return path.name == WORKER.name or not path.name.startswith("ui_")


def _sleeps(text: str) -> Iterator[int]:
    """The lines of a file that call `time.sleep`."""
    for node in ast.walk(parsed(text, "its file")):
        match node:
            case ast.Call(func=ast.Attribute(value=ast.Name(id="time"), attr="sleep") | ast.Name(id="sleep")):
                yield node.lineno


class ExistingWorker(Worker[Any]):
    """Base of the worker classes, one for each loaded component."""

    _takes_any_params: ClassVar[bool] = True
    _home: ClassVar[Path]
    package: ClassVar[str]
    alone: ClassVar[bool]
    window: ClassVar[str]
    machine: ClassVar[StateMachine | None]
    sources: ClassVar[Mapping[str, str]]
    """The author's files in `src`, converted to Python 3."""
    tree: ClassVar[ast.Module]
    """The syntax tree of the specific part."""
    generated: ClassVar[Mapping[str, ModuleType]]
    ices: ClassVar[Ices]
    slices: ClassVar[Slices]
    _instances: ClassVar[int] = 0
    _grace_s = 2.0
    """Seconds to wait, at the end, for threads that the component has started."""
    _work_s = 4.0
    """The same for pools with waiting calls; a deployment allows five seconds for the whole end."""

    def __init__(self) -> None:
        if self.alone:
            os.chdir(self._home)
        self._repeats = Repeats()
        self._user: Any = None
        self._thread: int | None = None
        """The timer that runs its loop."""
        self._begun = waits.Begun()
        self.statemachine = None
        self._chart: Chart | None = None
        if self.machine:
            self._chart = Chart(self.machine, self._enter, self._attempt, self._wake)
            self.statemachine = self._chart.engine
        if self.window and not (self._home / _FORM).is_file():
            raise ComponentError(f"{self._home / _FORM} is not there, and the .cdsl says gui: its window")
        self._need = qt.need({f"src/{name}": text for name, text in self.sources.items()}, self.window)
        self._loop = qt.open_loop(
            self._need,
            wake=self._wake,
            quit=self.stop,
            outside=self._suspended,
            tell=self._tell,
            clock=self._clock,
            folder=self._home,
            name=self.instance,
        )
        self._in_front = self._loop.in_front
        self._imports = self._surroundings()
        try:
            module = self._loop.call(self._imports.load, "specificworker")
        except ModuleNotFoundError as exc:
            raise ComponentError(advice(exc, self._home)) from exc
        except NotConverted as exc:
            raise ComponentError(_not_converted(exc, self._home / WORKER)) from exc
        generic = vars(self._imports.given["genericworker"])["GenericWorker"]
        found = getattr(module, "SpecificWorker", None)
        if not (isinstance(found, type) and issubclass(found, generic)):
            raise ComponentError(f"{self._home / WORKER} has no class SpecificWorker(GenericWorker)")
        self._class: type[Any] = found
        self._generic: type[Any] = generic
        self._wanted = self._constructor()

    # Called by the framework.

    @property
    def period(self) -> float:
        """Seconds between two timeouts of the component's timer, as last set."""
        said = getattr(self._user, "Period", None)
        return said / 1000 if isinstance(said, int | float) and said > 0 else self._period

    @period.setter
    def period(self, seconds: float) -> None:
        Worker.period.__set__(self, seconds)  # type: ignore[attr-defined]  # a property, to mypy a function

    def initialize(self) -> None:
        if not isinstance(self._clock, Real):
            self._warn_of_machine_time()
        texts, tables = entries(self._document or Document(), self._period)
        proxies = {key: proxy for port, proxy in self._proxies() for key in spellings.keys(port)}
        given = {"proxies": proxies, "tables": tables, "texts": texts, "no": False}
        params = tables if "tables" in self._wanted else texts
        self._loop.call(self._construct, [given[each] for each in self._wanted], params)
        for name in self._lacking():
            self.log.warning("%s has no method %s; calls of it fail", self._home / WORKER, name)

    def compute(self) -> None:
        """Do one thing that is due: a step of the state machine, a timer, or a signal. Handlers may run in between."""
        self._thread = threading.get_ident()
        if self._chart and self._chart.due:
            self._chart.step()
        else:
            self._loop.run(self._clock.now())

    def finish(self) -> None:
        begun = time.monotonic()
        self._loop.close()
        pools = self._begun.pools()  # before the object goes, with its pools
        self._loop.call(self._part)
        with self._suspended():
            work_s = max(0.0, self._work_s - (time.monotonic() - begun))  # slots may have used some of it
            left, calls = self._begun.end(pools, min(self._grace_s, work_s), work_s)
        if left:
            self.log.warning("its own threads are still running, and end with the process: %s", ", ".join(left))
        if calls:
            self.log.warning("%d calls in its thread pools have not begun after %g s", calls, self._work_s)

    def _part(self) -> None:
        """Release the component's object, so that its `__del__` runs."""
        self._user = None
        if self._need or "PySide6" not in sys.modules:  # windows of others may be garbage, too: that is Qt's thread's
            gc.collect()  # its timers and signals form cycles with it

    def _end(self) -> None:
        """End, after queued signals from other threads have been handled."""
        if threading.get_ident() == self._thread:
            self.stop()
        else:
            self._loop.post(self.stop)

    def _beats(self, now: int) -> Beat:
        self._loop.begin(now)
        return _LoopBeat(self._loop, self._chart, self._period, self._period_set)

    def _warn_of_machine_time(self) -> None:
        """Warn of what does not follow the clock of the component."""
        if self._need:
            self.log.warning(
                "it needs Qt (%s), whose timers follow the machine's clock, not the time of this run", self._need.why
            )
        places = [f"src/{name}:{line}" for name, text in self.sources.items() for line in _sleeps(text)]
        if places:
            self.log.warning(
                "%s: `time.sleep` waits for the machine while the time of this run stands still; "
                "`QTimer` follows the time of this run",
                ", ".join(places[:_PLACES]) + (", ..." if len(places) > _PLACES else ""),
            )

    def _period_set(self, seconds: float) -> None:
        """The period was changed from outside."""
        user = self._user
        if user is not None:
            self._loop.post(partial(user.setPeriod, round(seconds * 1000)))

    def _handle(self, names: tuple[str, ...], operation: str, *arguments: Any) -> Any:
        method = next((each for each in map(self._method, names) if each), None)
        if method is None:
            raise NotImplementedError(f"{WORKER} has no method {names[0]}, so that {operation} is not answered")
        return self._loop.call(method, *arguments)

    # The component's object.

    def _construct(self, arguments: list[Any], params: Mapping[str, Any]) -> None:
        self._user = self._class(*arguments)
        set_params = getattr(self._user, "setParams", None)
        if set_params and set_params(params) is False:
            self.log.warning("%s: setParams returned False; going on, as RoboComp does", self._home / WORKER)

    def _constructor(self) -> list[str]:
        """The arguments that its constructor expects, by the names used in RoboComp's components."""
        signature = inspect.signature(getattr(self._class, "__init__"))  # noqa: B009 - of a class, not of an instance
        taken = [each for each in signature.parameters.values() if each.kind is each.POSITIONAL_OR_KEYWORD][2:]
        wanted = ["proxies"]
        for parameter in taken:
            if parameter.name in _ARGUMENTS:
                wanted.append(_ARGUMENTS[parameter.name])
            elif parameter.default is parameter.empty:
                raise ComponentError(
                    f"{self._home / WORKER}: SpecificWorker is made with (proxy_map) or (proxy_map, configData), and "
                    f"startup_check=False behind it; give `{parameter.name}` a default"
                )
            else:
                break
        return wanted

    def _proxies(self) -> Iterator[tuple[Port, Any]]:
        for port in self.component.ports:
            if port.verb.has_proxy:
                proxy = getattr(self, port.attribute)
                proxy._loop = self._loop if self._need else None
                yield port, proxy

    def _method(self, name: str) -> Callable[..., Any] | None:
        """A method that the component's author has written, not one of a window class."""
        for each in type(self._user).__mro__ if self._user is not None else ():
            if each is self._generic:
                return None
            if name in vars(each):
                found: Callable[..., Any] = getattr(self._user, name)
                return found
        return None

    def _lacking(self) -> Iterator[str]:
        for port in self.component.ports:
            if not port.verb.has_proxy:
                for operation, _ in port.interface.under(port.verb):
                    names = spellings.handlers(port, operation)
                    if not any(map(self._method, names)):
                        yield names[0]
        yield from (each for each in (self.machine.methods() if self.machine else ()) if not self._method(each))

    def _enter(self, state: str) -> None:
        method = self._method(f"sm_{label(state)}")
        if method:
            self._attempt(method)

    def _attempt(self, slot: Callable[[], object]) -> None:
        """Call the slots of a state, or of its signals."""
        try:
            self._loop.call(slot)
        except Exception as exc:
            self._tell(exc)

    def _tell(self, exc: BaseException) -> None:
        """Log an exception of a slot. As with Qt, it does not end the component."""
        more = self._repeats.untold(way_of(exc))
        if more is None:
            return
        hindered = isinstance(exc, TransportError)
        what = f"was cut short: {exc}" if hindered else f"raised {type(exc).__name__}\n{user_trace(exc)}"
        own = frames_in(self._home, exc)
        slot = own[0][0].f_code.co_qualname if own else "a slot"
        self.log.log(logging.WARNING if hindered else logging.ERROR, "%s %s%s", slot, what, times_more(more))

    # The modules that its files import.

    def _surroundings(self) -> Imports:
        package = self._own_package()
        imports = Imports(package, self._home)
        self._loop.builtins = imports.builtins
        types = {name: module_of(module, self.slices, package) for name, module in self.generated.items()}
        types.setdefault("RoboCompCommonBehavior", ModuleType(f"{package}.RoboCompCommonBehavior"))
        for name, module in types.items():
            sys.modules.setdefault(f"{self.package}.{name}", module)  # pickle looks here for their classes
        for module in types.values():
            for name, other in types.items():
                if name not in vars(module):
                    setattr(module, name, other)
        given = imports.given
        given |= {**types, "Ice": self.ices.ice, "IceStorm": self.ices.storm}
        given |= waits.modules(self._loop, self._begun)
        imports.lazily |= {name: partial(importlib.import_module, name) for name in waits.BELOW}
        imports.lazily |= {name: partial(self._loop.modules.__getitem__, name) for name in self._loop.modules}
        given["genericworker"] = self._genericworker(package, types, given)
        given["interfaces"] = self._interfaces(package, {**types, "time": given["time"]})
        servants = {
            f"{port.interface.short.lower()}I": types.get(port.interface.module) for port in self.component.ports
        }
        given |= {name: module for name, module in servants.items() if module}
        for each in (given["genericworker"], given["interfaces"]):
            sys.modules[each.__name__] = each
        return imports

    def _own_package(self) -> str:
        """The component's package, or, for a further instance, another package for the same folder."""
        number = type(self)._instances = type(self)._instances + 1
        if number == 1:
            return self.package
        name = f"{self.package}_again{number}"
        package = ModuleType(name)
        package.__path__ = [str(self._home)]
        sys.modules[name] = package
        return name

    def _genericworker(
        self, package: str, types: Mapping[str, ModuleType], given: Mapping[str, ModuleType]
    ) -> ModuleType:
        """The module `genericworker`, with all names that RoboComp's has had, in all generations."""
        module = ModuleType(f"{package}.genericworker")
        names: dict[str, Any] = {"os": os, "sys": sys, "Ice": given["Ice"]}
        names |= {"ROBOCOMP": os.environ.get("ROBOCOMP") or "/opt/robocomp", "preStr": "", "additionalPathStr": ""}
        names |= {"icePaths": [], "rDebug": self.log.debug}
        imported = self._imported()
        version = next((each for each in ("PySide2", "PySide6", "PySide") if each in imported), "PySide2")
        modules = self._loop.modules
        parts = {part: modules[f"{version}.{part}"] for part in _QT if f"{version}.{part}" in modules}
        names |= parts
        if self.window:
            for part in parts.values():  # the form re-exports their names
                names |= {name: getattr(part, name) for name in dir(part) if not name.startswith("_")}
            names |= _public(modules["ui_mainUI"])
            if "Ui_guiDlg" not in names:
                raise ComponentError(f"{self._home / _FORM}: its <class> has to be guiDlg, as in all of RoboComp's")
        if "interfaces" not in imported:  # since 2020, types are accessed only by their modules
            bound = self._bound()
            for each in types.values():
                names |= {name: value for name, value in _public(each).items() if name not in bound}
        names |= {**types, "GenericWorker": self._make_generic()}
        vars(module).update(names)
        return module

    def _imported(self) -> frozenset[str]:
        """The top-level modules that its specific part imports."""
        return frozenset(
            name.partition(".")[0]
            for node in ast.walk(self.tree)
            if isinstance(node, ast.Import | ast.ImportFrom)
            for name in ([each.name for each in node.names] if isinstance(node, ast.Import) else [node.module or ""])
        )

    def _bound(self) -> frozenset[str]:
        """Names that its specific part defines or imports anywhere; they take precedence over names imported by `*`."""
        found: set[str] = set()
        for node in self.tree.body:
            match node:
                case ast.Import(names=names) | ast.ImportFrom(names=names):
                    found |= {each.asname or each.name.partition(".")[0] for each in names}
                case ast.ClassDef(name=name) | ast.FunctionDef(name=name):
                    found.add(name)
                case _:
                    continue
        return frozenset(found)

    def _interfaces(self, package: str, types: Mapping[str, ModuleType]) -> ModuleType:
        module = _Interfaces(f"{package}.interfaces")
        lists = {
            name: value
            for each in types.values()
            for name, value in vars(each).items()
            if isinstance(value, type) and issubclass(value, list)
        }
        vars(module).update({**lists, **types, "Ice": self.ices.ice, "IceStorm": self.ices.storm})
        return module

    def _make_generic(self) -> type[Any]:
        """The class that RoboComp generates, without further names."""
        adapter = self
        core = self._loop.modules["PySide6.QtCore"]

        def make(this: Any, mprx: Any = None, configData: Any = None, *rest: Any) -> None:
            super(generic, this).__init__()
            adapter._equip(this, core, configData)

        def kill_yourself(this: Any) -> None:
            this.kill.emit()
            adapter._end()

        def set_period(this: Any, p: Any) -> None:
            this.Period = p
            this.timer.start(p)

        def startup_check(this: Any) -> None:
            core.QTimer.singleShot(200, adapter.stop)

        generic: type[Any] = type(self._loop.base)(
            "GenericWorker",
            (self._loop.base,),
            {
                "__module__": "genericworker",
                "__doc__": "As RoboComp generates it.",
                "__init__": make,
                "kill": core.Signal(),
                "killYourSelf": core.Slot()(kill_yourself),
                "setPeriod": core.Slot(int)(set_period),
                "startup_check": startup_check,
            },
        )
        return generic

    def _equip(self, user: Any, core: Any, config: Any) -> None:
        """Set the attributes that the generated constructor sets."""
        for port, proxy in self._proxies():
            for attribute in spellings.attributes(port):
                setattr(user, attribute, proxy)
        if self.window:
            form = self._loop.modules["ui_mainUI"]
            user.ui = vars(form)["Ui_guiDlg"]()
            user.ui.setupUi(user)
            user.show()
        user.mutex = core.QMutex(core.QMutex.Recursive)
        user.Period = round(self._period * 1000)
        user.timer = core.QTimer(user)
        user.configData = config
        if self._chart:
            for name, part in self._chart.names.items():
                setattr(user, name, part)
            again = self._chart.names.get("t_compute_to_compute")
            if again and self.machine and self.machine.name == "defaultMachine":
                user.timer.timeout.connect(again)


# names for error messages
ExistingWorker.initialize.__qualname__ = "the start of SpecificWorker"
ExistingWorker.compute.__qualname__ = "SpecificWorker's loop"
ExistingWorker.finish.__qualname__ = "the end of SpecificWorker"


class _LoopBeat(qt.LoopBeat):
    """The times at which something is due in a component's loop or state machine."""

    def __init__(self, loop: qt.Loop, chart: Chart | None, period: float, changed: Callable[[float], None]) -> None:
        self._chart, self._changed, self._seconds = chart, changed, period
        super().__init__(loop, period)

    @property
    def period(self) -> float:
        return self._seconds

    @period.setter
    def period(self, seconds: float) -> None:
        if seconds != self._seconds:
            self._seconds = seconds
            self._changed(seconds)

    def due(self, now: int) -> int:
        return now if self._chart and self._chart.due else super().due(now)


class _Interfaces(ModuleType):
    """The module `interfaces`; its console is made at its first use, since that takes time."""

    def __getattr__(self, name: str) -> Any:
        if name not in ("console", "Console", "Text"):
            raise AttributeError(
                f"`{name}` is none of the component's interfaces; those are {', '.join(_listed(self))}"
            )
        from rich.console import Console
        from rich.text import Text

        vars(self).update(Console=Console, Text=Text, console=Console())
        return vars(self)[name]


def _listed(module: ModuleType) -> list[str]:
    return sorted(name for name, each in vars(module).items() if isinstance(each, ModuleType) and name != "time")


_QT = ("QtCore", "QtWidgets", "QtGui")


def _public(module: ModuleType) -> dict[str, Any]:
    return {name: value for name, value in vars(module).items() if not name.startswith("_")}


def _handler(port: Port, operation: Operation[Any]) -> Callable[..., Any]:
    names = spellings.handlers(port, operation)
    about = f"{port.interface.short}.{operation.name}"
    handle = handler(operation)

    def method(self: ExistingWorker, *arguments: Any) -> Any:
        return handle(partial(self._handle, names, about), arguments)

    method.__name__, method.__qualname__ = names[0], f"SpecificWorker.{names[0]}"
    return method
