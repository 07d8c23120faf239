"""Only a file called `unsafe.py` touches what others keep to themselves, calls C, or changes modules of others."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import robocomp_py

PACKAGE = Path(robocomp_py.__file__).parent
ALLOWED = {"os._exit"}
"""Documented, in spite of the underscore."""

LEFT = {
    "classic/workers/qt/front.py", "classic/workers/waits.py", "transports/dds/bus.py",
    "transports/dds/endpoints.py", "transports/dds/library.py",
}  # fmt: skip
"""Files that still do. None may be added, and one that does no more is to be removed here."""


def touched(path: Path) -> Iterator[str]:
    """Private names of other packages, imports of ctypes, assignments to attributes of imported modules."""
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
            case _:
                pass
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and root(node) in foreign:
            is_private = node.attr.startswith("_") and not node.attr.endswith("__")
            is_changed = isinstance(node.ctx, ast.Store) and ast.unparse(node) != "sys.argv"
            if (is_private or is_changed) and ast.unparse(node) not in ALLOWED:
                yield ast.unparse(node)


def root(node: ast.expr) -> str:
    while isinstance(node, ast.Attribute):
        node = node.value
    return node.id if isinstance(node, ast.Name) else ""


def files() -> list[Path]:
    return [path for path in sorted(PACKAGE.rglob("*.py")) if path.name != "unsafe.py"]


def test_no_file_but_unsafe_touches_private_parts() -> None:
    found = {path.relative_to(PACKAGE).as_posix(): list(touched(path)) for path in files()}
    assert {name: parts for name, parts in found.items() if parts and name not in LEFT} == {}
    assert {name for name in LEFT if name in found and not found[name]} == set()


@pytest.mark.parametrize(
    "code",
    [
        "import threading\nthreading._shutdown()",
        "import ctypes",
        "from ctypes import CDLL",
        "from cyclonedds._clayer import ddspy_take",
        "import sys\nsys.exit = print",
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
