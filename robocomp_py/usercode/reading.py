"""Finds what the class of a specific part defines, from its text. Nothing is imported and nothing is executed.

Base classes are followed through the files of the component. Where reading cannot tell what a class has (a base from
elsewhere, a metaclass, a class decorator, `setattr`), the class is *open*: nothing is said to be missing in it.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from ..dsl.source import Source, Span

CLASS = "SpecificWorker"
BASE = "GenericWorker"
FILE = "specificworker.py"

Read = Callable[[Path], bytes]
"""A file's bytes; raises OSError."""

Definition = ast.FunctionDef | ast.AsyncFunctionDef

_HARMLESS = {"object", "ABC", "Generic", "Protocol"}
"""Base classes from elsewhere without methods that a generic part asks for."""

_TRANSPARENT = {"final", "override", "typing.final", "typing.override", "typing_extensions.override"}
"""Decorators that leave a function or a class as it is."""

_OPENING = {"__getattr__", "__getattribute__", "__init_subclass__"}
"""Methods that can give a class attributes that its text does not show."""

_MOST_FILES = 200
"""Python files of one component that are read."""


class NotPython(Exception):
    """A file is not valid Python; the message says why, `span` where."""

    def __init__(self, why: str, span: Span) -> None:
        super().__init__(why)
        self.span = span


@dataclass(frozen=True)
class Method:
    """A name that a class defines."""

    name: str
    at: Span
    definition: Definition | None = None
    """Its function, if it is an ordinary one; None if it is something else, or is decorated, or has several."""


@dataclass(frozen=True)
class Class:
    """A class of the component's files, and the names it defines."""

    node: ast.ClassDef
    at: Span
    members: Mapping[str, Method]


@dataclass(frozen=True)
class Worker:
    """The class SpecificWorker: its methods, and those of the classes it inherits from."""

    main: Class
    classes: tuple[Class, ...]
    """In the order in which Python looks for names, up to GenericWorker."""
    behind: tuple[Class, ...]
    """Those that Python looks into only after GenericWorker, whose methods are abstract."""
    is_open: bool

    @property
    def source(self) -> Source:
        return self.main.at.source

    def find(self, name: str) -> Method | None:
        """What the class has by a name, as Python finds it."""
        return next((each.members[name] for each in self.classes if name in each.members), None)

    @cached_property
    def methods(self) -> dict[str, Method]:
        """Everything that the classes define, by name."""
        return {name: each.members[name] for each in reversed(self.classes) for name in each.members}


def read_worker(folder: Path, read: Read) -> Worker | None:
    """The SpecificWorker of a component; None if there is no such file, or no such class that could be judged.

    Raises NotPython.
    """
    files = _Files(folder, read)
    try:
        module = files.module(folder / FILE)
    except OSError:
        return None
    return _Reader(files).worker(module)


def generic_imports(folder: Path, read: Read) -> list[tuple[str, Span]]:
    """The modules of the generic part that a specific part imports when it is loaded, each with its place.

    Raises NotPython.
    """
    try:
        source, tree = parse_python(folder / FILE, read(folder / FILE))
    except OSError:
        return []
    found = []
    for node in tree.body:
        match node:
            case ast.ImportFrom(module="generic", level=1, names=aliases):
                found += [(each.name, _at(source, each)) for each in aliases if each.name != "*"]
            case ast.ImportFrom(module=str(name), level=1) if name.startswith("generic."):
                found.append((name.split(".")[1], _at(source, node)))
            case _:
                pass
    return found


def _at(source: Source, node: ast.alias | ast.stmt) -> Span:
    """Where a node begins and ends; columns count bytes there."""

    def offset(line: int, column: int) -> int:
        text = source.line(line).encode()[:column].decode(errors="ignore")
        return source.offset(line, len(text))

    end = offset(node.end_lineno or node.lineno, node.end_col_offset or 0)
    return source.span(offset(node.lineno, node.col_offset), end)


def words_of(folder: Path, read: Read) -> set[str] | None:
    """Every name and text in the code of a component; None if that cannot be read.

    The name in a function's definition does not count.
    """
    try:
        paths = list(python_files(folder))
    except OSError:
        return None
    files, found = _Files(folder, read), set[str]()
    for path in paths:
        try:
            tree = files.module(path).tree
        except (OSError, NotPython):
            return None
        for node in ast.walk(tree):
            match node:
                case ast.Call(func=ast.Name(id="getattr"), args=[_, ast.Constant(), *_]):
                    pass
                case ast.Call(func=ast.Name(id="getattr")):
                    return None  # anything may be meant
                case ast.Name(id=word) | ast.Attribute(attr=word) | ast.Constant(value=str(word)):
                    found.update(re.findall(r"\w+", word))
                case _:
                    pass
    return found if len(paths) <= _MOST_FILES else None


def python_files(folder: Path) -> Iterator[Path]:
    """The user's Python files of a component, the specific part first; one more than are read at most."""
    found = (each for each in folder.rglob("*.py") if not _is_passed_over(each.relative_to(folder).parts))
    some = [path for path, _ in zip(found, range(_MOST_FILES + 1), strict=False)]
    return iter(sorted(some, key=lambda path: (path != folder / FILE, path)))


def _is_passed_over(parts: tuple[str, ...]) -> bool:
    return parts[0] == "generic" or any(part.startswith((".", "__pycache__")) for part in parts[:-1])


def parse_python(path: Path, data: bytes) -> tuple[Source, ast.Module]:
    """A file's text, with lines that end in a newline, and its syntax tree. Raises NotPython."""
    try:
        encoding, _ = tokenize.detect_encoding(io.BytesIO(data).readline)
        text = io.TextIOWrapper(io.BytesIO(data), encoding).read()
    except (SyntaxError, UnicodeDecodeError, LookupError) as exc:
        raise NotPython(f"cannot be decoded: {exc}", Source(path, "").span(0, 0)) from exc
    source = Source(path, text)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a user's literals, say
            return source, ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as exc:
        line = min(getattr(exc, "lineno", None) or 1, text.count("\n") + 1)
        start = source.offset(line, max(0, (getattr(exc, "offset", None) or 1) - 1))
        raise NotPython(getattr(exc, "msg", None) or str(exc), source.span(start, start + 1)) from exc


@dataclass(frozen=True)
class _Import:
    """Where a name of a module comes from; `name` is "" for the module itself."""

    module: str
    level: int
    name: str


@dataclass(eq=False)
class _Module:
    path: Path
    source: Source
    tree: ast.Module

    @cached_property
    def names(self) -> dict[str, list[ast.ClassDef | _Import | None]]:
        """What each name of the module is bound to; None for what is neither a class nor imported."""
        found: dict[str, list[ast.ClassDef | _Import | None]] = {}
        for name, what in _bindings(self.tree.body):
            found.setdefault(name, []).append(what)
        return found

    @cached_property
    def opens(self) -> bool:
        """Whether its code may set attributes of a class by names that cannot be read."""
        for node in ast.walk(self.tree):
            match node:
                case ast.Call(func=ast.Name(id="exec")) | ast.Call(func=ast.Name(id="locals" | "vars"), args=[]):
                    return True
                case ast.Call(func=ast.Name(id="setattr"), args=[ast.Name() | ast.Call(), *_]):
                    return True
                case _:
                    pass
        return False

    def span(self, node: ast.ClassDef | Definition) -> Span:
        """The name in a definition."""
        start = self.source.offset(node.lineno, 0)
        found = re.compile(rf"(?:class|def)\s+({re.escape(node.name)})").search(self.source.text, start)
        return self.source.span(*found.span(1)) if found else self.source.span(start, start)


class _Files:
    """The modules of one component, read once each."""

    def __init__(self, folder: Path, read: Read) -> None:
        self.folder, self._read = folder, read
        self._modules: dict[Path, _Module] = {}

    def module(self, path: Path) -> _Module:
        if path not in self._modules:
            self._modules[path] = _Module(path, *parse_python(path, self._read(path)))
        return self._modules[path]

    def imported(self, module: str, level: int, importing: Path) -> _Module | None:
        """The module that an import statement means, if it is one of the component's."""
        parts = module.split(".") if module else []
        if level:
            base = importing.parent
            for _ in range(level - 1):
                base = base.parent
        elif parts[:1] == [self.folder.name]:
            base, parts = self.folder, parts[1:]
        else:
            return None
        if base != self.folder and self.folder not in base.parents:
            return None
        path = base.joinpath(*parts)
        for each in (path.with_suffix(".py"), path / "__init__.py"):
            try:
                return self.module(each)
            except (OSError, NotPython):
                continue
        return None


class _Open(Exception):
    """A class has something that cannot be read."""


_GENERIC = type(BASE, (), {})


class _Reader:
    """Follows classes to their bases. A Python class is made of each, empty, so that Python orders them."""

    def __init__(self, files: _Files) -> None:
        self._files = files
        self._read: dict[type, Class] = {}
        self._made: dict[ast.ClassDef, type] = {}
        self._is_open = False

    def worker(self, module: _Module) -> Worker | None:
        try:
            found = self._lookup(CLASS, module)
        except _Open:
            return None
        if not isinstance(found, tuple):
            return None
        node, home = found
        try:
            mro = self._make(node, home).__mro__
        except (TypeError, _Open):  # TypeError: no order is possible, which Python says at the start
            mro, self._is_open = (), True
        at = mro.index(_GENERIC) if _GENERIC in mro else len(mro)
        if _GENERIC not in mro:
            self._is_open = True
        main = self._read.get(self._made[node]) or self._class(node, home)
        classes = tuple(self._read[each] for each in mro[:at] if each in self._read) or (main,)
        behind = tuple(self._read[each] for each in mro[at:] if each in self._read)
        return Worker(main, classes, behind, self._is_open)

    def _make(self, node: ast.ClassDef, module: _Module) -> type:
        if node in self._made:
            return self._made[node]
        self._made[node] = object  # if it inherits from itself, Python does not get that far
        self._is_open |= bool(node.keywords) or module.opens
        self._is_open |= any(ast.unparse(each) not in _TRANSPARENT for each in node.decorator_list)
        bases: list[type] = []
        for each in node.bases:
            try:
                base = self._base(each, module)
            except _Open:
                self._is_open = True
            else:
                bases += [base] if base is not object else []
        made = type(node.name, tuple(bases), {})
        self._made[node], self._read[made] = made, self._class(node, module)
        self._is_open |= bool(_OPENING & self._read[made].members.keys())
        return made

    def _base(self, expression: ast.expr, module: _Module) -> type:
        match expression:
            case ast.Subscript(value=value):
                return self._base(value, module)
            case ast.Name(id=name):
                found = self._lookup(name, module)
            case ast.Attribute(value=ast.Name(id=owner), attr=name):
                home = self._lookup(owner, module)
                if isinstance(home, str):
                    found = home if name == home else name
                    if name not in (BASE, *_HARMLESS):
                        raise _Open
                elif isinstance(home, _Module):
                    found = self._lookup(name, home)
                else:
                    raise _Open
            case _:
                raise _Open
        match found:
            case str() if found == BASE:
                return _GENERIC
            case str() if found in _HARMLESS:
                return object
            case (ast.ClassDef(), _Module(path=path)) if path == self._files.folder / "generic" / "genericworker.py":
                return _GENERIC
            case (ast.ClassDef() as node, _Module() as home):
                return self._make(node, home)
            case _:
                raise _Open

    def _lookup(self, name: str, module: _Module, depth: int = 0) -> tuple[ast.ClassDef, _Module] | _Module | str:
        """What a name means: a class, a module of the component, or something from elsewhere, by its name there."""
        bound = module.names.get(name)
        if depth > _MOST_FILES or (bound and len(bound) > 1):
            raise _Open
        if not bound:
            return self._starred(name, module, depth)
        match bound[0]:
            case ast.ClassDef() as node:
                return node, module
            case _Import(dotted, level, ""):
                found = self._files.imported(dotted, level, module.path)
                return found or dotted.rpartition(".")[2]
            case _Import(dotted, level, original):
                home = self._files.imported(dotted, level, module.path)
                if home is None and original == BASE:
                    return BASE  # it is not generated yet
                if home is None:
                    whole = f"{dotted}.{original}".lstrip(".")
                    return self._files.imported(whole, level, module.path) or original
                if original in home.names or "*" in home.names:
                    return self._lookup(original, home, depth + 1)
                return self._files.imported(f"{dotted}.{original}".lstrip("."), level, module.path) or original
            case None:
                raise _Open

    def _starred(self, name: str, module: _Module, depth: int) -> tuple[ast.ClassDef, _Module] | _Module | str:
        """What a name means that a `from … import *` may have imported; otherwise a builtin of Python."""
        for each in module.names.get("*", ()):
            home = self._files.imported(each.module, each.level, module.path) if isinstance(each, _Import) else None
            if home is None and name == BASE:
                continue  # that of the generic part, most likely
            if home is None:
                raise _Open
            if name in home.names or "*" in home.names:
                return self._lookup(name, home, depth + 1)
        return name

    def _class(self, node: ast.ClassDef, module: _Module) -> Class:
        members: dict[str, Method] = {}
        for name, definition in _members(node.body):
            at = module.span(definition) if definition else module.span(node)
            ordinary = definition if name not in members and definition in node.body else None
            if ordinary and any(ast.unparse(each) not in _TRANSPARENT for each in ordinary.decorator_list):
                ordinary = None
            members[name] = Method(name, at, ordinary)
        for name in _set_elsewhere(node, module):
            members[name] = Method(name, members[name].at if name in members else module.span(node))
        return Class(node, module.span(node), members)


def _set_elsewhere(node: ast.ClassDef, module: _Module) -> Iterator[str]:
    """Names that are set by assignment: `self.name = …` in its methods, `Class.name = …` anywhere."""
    for scope, owner in ((node, "self"), (module.tree, node.name)):
        for each in ast.walk(scope):
            match each:
                case ast.Attribute(value=ast.Name(id=of), attr=name, ctx=ast.Store()) if of == owner:
                    yield name
                case _:
                    pass


def _bindings(body: Iterable[ast.stmt]) -> Iterator[tuple[str, ast.ClassDef | _Import | None]]:
    """The names that the statements of a module bind, `*` for what a star brings."""
    for node in _statements(body):
        match node:
            case ast.ClassDef(name=name):
                yield name, node
            case ast.Import(names=aliases):
                for alias in aliases:
                    if alias.asname:
                        yield alias.asname, _Import(alias.name, 0, "")
                    else:
                        first = alias.name.partition(".")[0]
                        yield first, _Import(first, 0, "")
            case ast.ImportFrom(module=dotted, names=aliases, level=level):
                for alias in aliases:
                    name = "" if alias.name == "*" else alias.name
                    yield alias.asname or alias.name, _Import(dotted or "", level, name)
            case _:
                yield from ((name, None) for name in _names(node))


def _members(body: Iterable[ast.stmt]) -> Iterator[tuple[str, Definition | None]]:
    """The names that the statements of a class bind, with the function where it is one."""
    for node in _statements(body):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield name, node
            case ast.ClassDef(name=name):
                yield name, None
            case ast.Import(names=aliases) | ast.ImportFrom(names=aliases):
                yield from (((alias.asname or alias.name).partition(".")[0], None) for alias in aliases)
            case _:
                yield from ((name, None) for name in _names(node))


def _statements(body: Iterable[ast.stmt]) -> Iterator[ast.stmt]:
    """These statements and those in their blocks, but not what functions and classes hold."""
    for node in body:
        yield node
        if isinstance(node, ast.ClassDef | Definition):
            continue
        for block in ("body", "orelse", "finalbody"):
            yield from _statements(getattr(node, block, ()))
        for part in (*getattr(node, "handlers", ()), *getattr(node, "cases", ())):
            yield from _statements(part.body)


def _names(node: ast.stmt) -> Iterator[str]:
    """The names that a statement itself gives to something."""
    if isinstance(node, Definition):
        yield node.name
        return
    if isinstance(node, ast.AnnAssign) and node.value is None:
        return
    waiting: list[Any] = [node]
    while waiting:
        each = waiting.pop()
        if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store):
            yield each.id
        waiting += [child for child in ast.iter_child_nodes(each) if not isinstance(child, ast.stmt)]
