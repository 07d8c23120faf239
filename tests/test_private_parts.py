"""Only a file called `unsafe.py` touches what others keep to themselves, calls C, or changes modules of others."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import robocomp_py

PACKAGE = Path(robocomp_py.__file__).parent
ALLOWED = {"os._exit", "sys.excepthook", "sys._current_frames"}
"""Documented: in spite of the underscore, and to be assigned to."""

DOCUMENTED = {"_asdict", "_actions"}
"""Of named tuples; and of parsers, in the class that derives from them: argparse has no other list of its options."""

BY_NAME = {"getattr", "setattr", "hasattr", "delattr", "attrgetter", "methodcaller"}
"""Functions that reach an attribute by its name as text."""

SEARCHES = {"gc.get_objects", "gc.get_referrers", "gc.get_referents"}
"""What finds objects that belong to others."""


def touched(path: Path) -> Iterator[str]:
    """Private names of other packages, imports of ctypes, assignments to attributes of imported modules.

    Also, private names that are given as text, and searches for all objects.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    foreign: set[str] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names):
                foreign |= {(each.asname or each.name).partition(".")[0] for each in names}
                yield from (each.name for each in names if each.name.partition(".")[0] == "ctypes")
            case ast.ImportFrom(module=str(module), names=names, level=0) if not module.startswith("robocomp_py"):
                foreign |= {each.asname or each.name for each in names}
                whole = [f"{module}.{each.name}" for each in names]
                yield from (each for each in whole if any(part.startswith("_") for part in each.split(".")[1:]))
                yield from (each for each in whole if module.partition(".")[0] == "ctypes")
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=given) if name in BY_NAME:
                texts = [each.value for each in given if isinstance(each, ast.Constant) and isinstance(each.value, str)]
                yield from (f"{name} {text}" for text in texts if any(map(is_private, text.split("."))))
            case ast.Attribute(value=ast.Name(id="gc")) if ast.unparse(node) in SEARCHES:
                yield ast.unparse(node)
            case _:
                pass
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and root(node) in foreign:
            is_changed = isinstance(node.ctx, ast.Store) and ast.unparse(node) != "sys.argv"
            if (is_private(node.attr) or is_changed) and ast.unparse(node) not in ALLOWED:
                yield ast.unparse(node)


def own_names() -> set[str]:
    """The private names that files of ours define."""
    found: set[str] = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            match node:
                case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                    found.add(name)
                case ast.Name(id=name, ctx=ast.Store()):
                    found.add(name)
                case ast.Attribute(attr=name, ctx=ast.Store(), value=ast.Name(id="self" | "cls")):
                    found.add(name)
    return found


def of_instances(path: Path, own: set[str]) -> Iterator[str]:
    """Private attributes that are not among `own`."""
    text = path.read_text(encoding="utf-8")
    if own.issuperset(re.findall(r"\.\s*(_\w*)", text)):
        return  # there are none, and parsing takes a while
    for node in ast.walk(ast.parse(text)):
        is_foreign = isinstance(node, ast.Attribute) and is_private(node.attr) and node.attr not in own
        if is_foreign and ast.unparse(node) not in ALLOWED:
            yield ast.unparse(node)


def is_private(name: str) -> bool:
    return name.startswith("_") and not name.endswith("_")  # names with one at both ends are those of enumerations


def root(node: ast.expr) -> str:
    while isinstance(node, ast.Attribute):
        node = node.value
    return node.id if isinstance(node, ast.Name) else ""


def files() -> list[Path]:
    return [path for path in sorted(PACKAGE.rglob("*.py")) if path.name != "unsafe.py"]


def test_no_file_but_unsafe_touches_private_parts() -> None:
    found = {path.relative_to(PACKAGE).as_posix(): list(touched(path)) for path in files()}
    assert {name: parts for name, parts in found.items() if parts} == {}


def test_no_file_but_unsafe_touches_private_parts_of_instances() -> None:
    own = own_names() | DOCUMENTED
    found = {path.relative_to(PACKAGE).as_posix(): list(of_instances(path, own)) for path in files()}
    assert {name: parts for name, parts in found.items() if parts} == {}


@pytest.mark.parametrize(
    "code",
    [
        "import threading\nthreading._shutdown()",
        "import ctypes",
        "from ctypes import CDLL",
        "from cyclonedds._clayer import ddspy_take",
        "import sys\nsys.exit = print",
        "def f(port):\n    return getattr(port, '__loan_slice_uninit')",
        "import threading\nshutdown = getattr(threading, '_shutdown', None)",
        "import operator\nsize = operator.attrgetter('header._size')",
        "import gc\nfound = gc.get_objects()",
        "import concurrent.futures.thread\nconcurrent.futures.thread._threads_queues.clear()",
    ],
)
def test_each_way_to_do_it_is_found(code: str, tmp_path: Path) -> None:
    file = tmp_path / "some.py"
    file.write_text(code)
    assert list(touched(file))


def test_what_is_ones_own_may_be_private(tmp_path: Path) -> None:
    file = tmp_path / "some.py"
    file.write_text("import os\nfrom .base import Link\nclass A:\n    def f(self):\n        self._a = os._exit\n")
    assert list(touched(file)) == []
