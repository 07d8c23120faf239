"""Imports in one component's files: it has its own modules, separate from other components of the process.

Every module of a component is executed with builtins of its own, of which `__import__` looks here first: a statement
`import genericworker` in its files, wherever it stands and whenever it runs, gives this component's. What is neither
provided nor one of its files is imported as everywhere. In `sys.modules`, its modules are below a package that is
called like the component's folder.
"""

from __future__ import annotations

import builtins
import importlib
import importlib.machinery
import importlib.util
import logging
import re
import sys
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from .python2 import as_python3

log = logging.getLogger("robocomp.worker")


class Imports:
    """Implements `import` for the files of one component."""

    def __init__(self, package: str, folder: Path) -> None:
        """`package` is the imported package of the folder."""
        self.package, self.folder = package, folder
        self.given: dict[str, ModuleType] = {}
        """Modules that are provided, by the name under which the component imports them; dotted ones, too."""
        self.lazily: dict[str, Callable[[], ModuleType]] = {}
        """The same for those that are made when they are first imported."""
        self._source = folder / "src"
        self._found: dict[str, ModuleType | None] = {}
        """By first part of a name; None is for what is imported as everywhere."""
        self._packages: dict[str, ModuleType] = {}
        """Empty modules for the packages in which the component's folder is installed elsewhere, by dotted name."""
        self._lock = threading.RLock()
        self.builtins: dict[str, Any] = {**vars(builtins), "__import__": self._import}

    def load(self, name: str) -> ModuleType:
        """The module of a file in `src`."""
        return self._file(f"src.{name}", self._source / f"{name}.py")

    # Called by the import statement.

    def _import(
        self,
        name: str,
        globals: Mapping[str, Any] | None = None,
        locals: Mapping[str, Any] | None = None,
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> ModuleType:
        if level:
            where = str((globals or {}).get("__package__") or self.package)
            absolute = importlib.util.resolve_name("." * level + name, where)
            module = self._below(absolute.removeprefix(f"{self.package}.") if absolute != self.package else "")
            return self._with(module, fromlist)
        head, _, rest = name.partition(".")
        if own := self._installed(name):
            module = self._below(own)
            return self._with(module, fromlist) if fromlist else self._package_of(name, own)
        first = self._provided(head) or self._own(head)
        if first is None:
            return self._elsewhere(name, globals, locals, fromlist)
        module = first
        for part in rest.split(".") if rest else ():
            module = self._inside(module, part, head)
        return self._with(module, fromlist) if fromlist else first

    def _installed(self, name: str) -> str:
        """The component's module for a name as `learnbot_components.laser.src.genericworker`; "" if it means another.

        Such a name is that of the folder in the package that installs it. `genericworker` always means the component's.
        """
        packages, found, rest = f"{name}.".partition(".src.")
        head = name.partition(".")[0]
        if not found or self._provided(head) or self._own(head) or self._place(head):
            return ""
        own = f"src.{rest}".rstrip(".")
        if self._generated(own):
            return own
        named = packages.rpartition(".")[2].lower() == self.folder.name.lower()
        absent = head not in sys.modules and importlib.machinery.PathFinder.find_spec(head) is None
        return own if (named or absent) and self._place(own) else ""

    def _package_of(self, name: str, own: str) -> ModuleType:
        """The first package of such a name, which leads to the component's module."""
        with self._lock:
            parts = name.removesuffix(f".{own}").split(".")
            packages = [".".join(parts[: number + 1]) for number in range(len(parts))]
            above = None
            for dotted, last in zip(packages, parts, strict=True):
                package = self._packages.setdefault(dotted, ModuleType(dotted))
                if above is not None:
                    setattr(above, last, package)
                above = package
            vars(self._packages[packages[-1]])["src"] = self._below("src")
            return self._packages[packages[0]]

    def _generated(self, dotted: str) -> ModuleType | None:
        """What is provided in place of a file in `src` that RoboComp's generator writes."""
        folder, _, name = dotted.rpartition(".")
        if folder != "src" or not (name in ("genericworker", "interfaces") or name[-1:] == "I" or name[:3] == "ui_"):
            return None
        return self._provided(name)

    def _provided(self, name: str) -> ModuleType | None:
        with self._lock:
            if name not in self.given and name in self.lazily:
                self.given[name] = self.lazily[name]()
            return self.given.get(name)

    def _inside(self, module: ModuleType, part: str, head: str) -> ModuleType:
        names = [known for known, each in self.given.items() if each is module]
        for known in names:
            if found := self._provided(f"{known}.{part}"):
                setattr(module, part, found)
                return found
        if head in self.given:
            found = getattr(module, part, None)
            if isinstance(found, ModuleType):
                return found
            raise ModuleNotFoundError(f"No module named {part!r} in {head}", name=f"{head}.{part}")
        return self._below(f"{module.__name__.removeprefix(f'{self.package}.')}.{part}")

    def _with(self, module: ModuleType, fromlist: Sequence[str] | None) -> ModuleType:
        """The module, with those of its submodules that `from … import` names."""
        for name in fromlist or ():
            if name == "*" or hasattr(module, name):
                continue
            if module.__name__.startswith(f"{self.package}."):
                path = f"{module.__name__.removeprefix(f'{self.package}.')}.{name}"
                if self._generated(path) or self._place(path):
                    self._below(path)
            else:
                for known in [known for known, each in self.given.items() if each is module]:
                    self._provided(f"{known}.{name}")
        return module

    def _elsewhere(self, name: str, globals: Any, locals: Any, fromlist: Any) -> ModuleType:
        try:
            return __import__(name, globals, locals, fromlist or (), 0)
        except ModuleNotFoundError as exc:
            head = name.partition(".")[0]
            if exc.name != head or not self._place(head):
                raise
            with self._lock:
                self._found[head] = self._below(head)  # of its root folder, which comes last as in `sys.path`
            return self._import(name, globals, locals, fromlist)

    def _own(self, head: str) -> ModuleType | None:
        """The module of a file of the component, unless Python has one of that name at hand already."""
        with self._lock:
            if head not in self._found:
                self._found[head] = self._search(head)
            return self._found[head]

    def _search(self, head: str) -> ModuleType | None:
        if head in ("src", "generated"):
            return self._below(head)
        if head in sys.builtin_module_names:
            return None
        if self._place(f"src.{head}"):
            return self._below(f"src.{head}")
        spec = None if head in sys.modules else importlib.machinery.PathFinder.find_spec(head)
        origin = Path(spec.origin).resolve() if spec and spec.origin and spec.has_location else None
        if origin and origin.suffix == ".py" and origin.is_relative_to(self.folder):  # its own `sys.path.append`
            package = origin.name == "__init__.py"
            parts = (origin.parent if package else origin.with_suffix("")).relative_to(self.folder).parts
            return self._below(".".join(parts))
        return None

    # Files.

    def _place(self, dotted: str) -> Path | None:
        """The file or the folder of a module below the component's folder."""
        path = self.folder.joinpath(*dotted.split("."))
        for file in (path / "__init__.py", path.with_name(f"{path.name}.py")):
            if file.is_file():
                return file
        return path if path.is_dir() and any(path.rglob("*.py")) else None

    def _below(self, dotted: str) -> ModuleType:
        """A module of the component, its parents first, each executed once."""
        module = sys.modules[self.package]
        done: list[str] = []
        for part in dotted.split(".") if dotted else ():
            done.append(part)
            name = ".".join(done)
            if generated := self._generated(name):
                setattr(module, part, generated)
                module = generated
                continue
            place = self._place(name)
            if place is None:
                raise ModuleNotFoundError(f"No module named {name!r} in {self.folder}", name=name)
            module = self._file(name, place)
        return module

    def _file(self, dotted: str, place: Path) -> ModuleType:
        name = f"{self.package}.{dotted}"
        with self._lock:
            if name in sys.modules:
                return sys.modules[name]
            parent, _, last = name.rpartition(".")
            if parent not in sys.modules:
                self._below(parent.removeprefix(f"{self.package}."))
            module = ModuleType(name)
            module.__builtins__ = self.builtins  # type: ignore[attr-defined]  # what Python executes it with
            is_package = place.is_dir() or place.name == "__init__.py"
            spec = importlib.machinery.ModuleSpec(name, None, origin=str(place), is_package=is_package)
            if is_package:
                folder = str(place if place.is_dir() else place.parent)
                spec.submodule_search_locations = [folder]
                module.__path__ = [folder]
            module.__spec__ = spec
            module.__package__ = name if is_package else parent
            if not place.is_dir():
                module.__file__ = str(place)
            sys.modules[name] = module
            try:
                if not place.is_dir():
                    exec(code_of(place), vars(module))  # the component's own code, as an import statement does it
            except BaseException:
                del sys.modules[name]
                raise
            setattr(sys.modules[parent], last, module)
            return module


def code_of(file: Path) -> Any:
    """A file, compiled; one in Python 2 is converted first. Raises SyntaxError."""
    text = source_text(file.read_bytes())
    source, converted = as_python3(text, str(file))
    if converted:
        log.warning("%s is Python 2: run as 2to3 converts it; `2to3 -w %s` makes that lasting", file, file)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SyntaxWarning)
        warnings.simplefilter("ignore", DeprecationWarning)  # so that `"\d"` is as good as it was
        return compile(source, str(file), "exec", dont_inherit=True)


def source_text(data: bytes) -> str:
    """The text of a file of Python, by the encoding that it declares, or in UTF-8, or as was usual before."""
    try:
        return importlib.util.decode_source(data)
    except (SyntaxError, UnicodeDecodeError):
        text = data.decode("latin-1").replace("\r\n", "\n")
        return re.sub(r"coding[:=][ \t]*[-\w.]+", "coding: utf-8", text, count=1)
