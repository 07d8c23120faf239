"""No code outside of `transports/` knows a transport by name: what it has to know, deployment sides declare."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from robocomp_py import installed

PACKAGE = Path(__file__).parents[1] / "robocomp_py"
ROOMS = ("cli", "codegen", "deploy", "graph", "lsp", "runtime", "tools")

NAMES = {*installed.transports(), "cyclonedds", "iceoryx", "iceoryx2", "icestorm", "zmq"}
"""The transports, and the libraries that they stand on."""

LEFT = {
    "codegen/write.py": "removes files that earlier versions generated, by the endings of their names",
    "deploy/exporters/kubernetes.py": "/dev/shm is Linux's name of a folder",
}
"""The files that still name one, and why."""


def words(text: str) -> set[str]:
    """The words of an identifier, path or key; of `ZeroMQTransport` also those that two capitals divide."""
    apart = re.sub(r"([a-z0-9])([A-Z])|([A-Z])([A-Z][a-z])", r"\1\3 \2\4", text)
    found = re.findall(r"[a-z0-9]+", apart.lower())
    return {*found, *map("".join, pairwise(found)), *re.findall(r"[a-z0-9]+", text.lower())}


def named(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """The identifiers, imports and string constants of a module that name a transport. Prose has spaces."""
    docstrings = {id(each.value) for each in ast.walk(tree) if isinstance(each, ast.Expr)}
    for node in ast.walk(tree):
        match node:
            case ast.Constant(value=str(text)) if id(node) not in docstrings and not re.search(r"\s", text.strip()):
                found = [text]
            case ast.Name(id=text) | ast.Attribute(attr=text) | ast.arg(arg=text) | ast.keyword(arg=str(text)):
                found = [text]
            case ast.FunctionDef(name=text) | ast.AsyncFunctionDef(name=text) | ast.ClassDef(name=text):
                found = [text]
            case ast.ImportFrom(module=module, names=aliases):
                found = [module or "", *(each.name for each in aliases)]
            case ast.Import(names=aliases):
                found = [each.name for each in aliases]
            case _:
                found = []
        yield from ((getattr(node, "lineno", 0), text) for text in found if words(text) & NAMES)


@pytest.mark.parametrize("room", ROOMS)
def test_no_room_knows_a_transport_by_name(room: str) -> None:
    found = {
        str(path.relative_to(PACKAGE)): names
        for path in sorted((PACKAGE / room).rglob("*.py"))
        if (names := list(named(ast.parse(path.read_text(encoding="utf-8")))))
    }
    allowed = {path for path in LEFT if path.startswith(f"{room}/")}
    assert found.keys() == allowed, {path: names for path, names in found.items() if path not in allowed}


@pytest.mark.parametrize(
    "code",
    [
        'COLOURS = {"zenoh": "#fff"}', "import zmq", "from .icefiles import ICE", "def _over_dds(): ...",
        'x = f"transports.zeromq.bind={y}"', "ZeroMQTransport", "DDSDeployment()", "from ..transports.shm import room",
        "f(shm=1)", "def f(shm): ...",
    ],
)  # fmt: skip
def test_code_that_names_one_is_found(code: str) -> None:
    assert list(named(ast.parse(code)))


@pytest.mark.parametrize(
    "code",
    ['"""Over zenoh."""', 'say("over zenoh, or dds")', "# dds", "service = notice(device)", "from ..services import x"],
)
def test_prose_is_not(code: str) -> None:
    assert not list(named(ast.parse(code)))
