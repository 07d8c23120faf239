"""Arrows point one way: what a robot runs must not drag in what a workstation builds with."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Container, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from importlib.util import resolve_name
from pathlib import Path

import pytest

import robocomp_py

BUILD = {"lark", "jinja2", "rich", "robocomp_py.dsl", "robocomp_py.codegen", "robocomp_py.deploy", "robocomp_py.cli"}
MIDDLEWARES = {"zmq", "cyclonedds", "zenoh", "iceoryx2"}

FORBIDDEN: dict[str, set[str]] = {
    "robocomp_py": {"numpy", "typing", "robocomp_py.client", "robocomp_py.errors"},
    "robocomp_py.errors": {"numpy", "robocomp_py.contract"},
    "robocomp_py.spelling": {"numpy", "robocomp_py.contract"},
    "robocomp_py.installed": BUILD | MIDDLEWARES | {"numpy", "robocomp_py.contract", "importlib.metadata"},
    "robocomp_py.contract.module": BUILD
    | MIDDLEWARES
    | {"numpy", "robocomp_py.wire", "robocomp_py.transports", "msgpack"},
    "robocomp_py.wire.cdr": BUILD | MIDDLEWARES | {"robocomp_py.transports", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.wire.ice": BUILD | MIDDLEWARES | {"Ice", "robocomp_py.transports", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.wire.messagepack": BUILD | MIDDLEWARES | {"robocomp_py.transports", "robocomp_py.runtime"},
    "robocomp_py.transports.base": BUILD | MIDDLEWARES | {"numpy", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.transports.inproc": BUILD | MIDDLEWARES | {"numpy", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.transports.inproc_deployment": BUILD | MIDDLEWARES | {"numpy", "robocomp_py.transports.base"},
    "robocomp_py.transports.zeromq.transport": BUILD | (MIDDLEWARES - {"zmq"}) | {"numpy", "robocomp_py.runtime"},
    "robocomp_py.transports.dds.transport": BUILD | (MIDDLEWARES - {"cyclonedds"}) | {"robocomp_py.runtime", "msgpack"},
    "robocomp_py.transports.dds.census": BUILD
    | (MIDDLEWARES - {"cyclonedds"})
    | {"numpy", "robocomp_py.runtime", "robocomp_py.transports.dds.types", "msgpack"},
    "robocomp_py.transports.exclusive": BUILD | MIDDLEWARES | {"robocomp_py.runtime", "msgpack", "numpy"},
    "robocomp_py.transports.zenoh.transport": BUILD | (MIDDLEWARES - {"zenoh"}) | {"robocomp_py.runtime", "msgpack"},
    "robocomp_py.transports.shm.transport": BUILD | (MIDDLEWARES - {"iceoryx2"}) | {"robocomp_py.runtime", "msgpack"},
    **{
        f"robocomp_py.transports.{name}.deployment": BUILD | MIDDLEWARES | {"Ice", "numpy", "robocomp_py.runtime"}
        for name in ("zeromq", "dds", "zenoh", "shm", "ice")
    },
    "robocomp_py.transports.iceoptions": BUILD | MIDDLEWARES | {"Ice", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.transports.ice.ports": BUILD
    | MIDDLEWARES
    | {"Ice", "msgpack", "robocomp_py.runtime", "robocomp_py.classic"},
    "robocomp_py.runtime.clock": BUILD | MIDDLEWARES | {"numpy", "robocomp_py.contract", "robocomp_py.transports"},
    "robocomp_py.runtime.timers": BUILD | MIDDLEWARES | {"robocomp_py.wire", "robocomp_py.transports"},
    "robocomp_py.runtime.statechart": BUILD | MIDDLEWARES | {"numpy", "robocomp_py.wire", "robocomp_py.transports"},
    "robocomp_py.graph.statemachine": BUILD | MIDDLEWARES | {"numpy", "xml", "robocomp_py.wire", "robocomp_py.runtime"},
    "robocomp_py.graph.netsvg": BUILD | MIDDLEWARES | {"numpy", "xml", "robocomp_py.wire", "robocomp_py.runtime"},
    "robocomp_py.runtime.api": BUILD | MIDDLEWARES | {"robocomp_py.actions", "xml", "pyexpat", "msgpack", "argparse"},
    "robocomp_py.runtime.run": BUILD
    | MIDDLEWARES
    | {"robocomp_py.actions", "robocomp_py.runtime.diary", "robocomp_py.tools", "msgpack", "robocomp_py.classic"},
    "robocomp_py.runtime.diary": BUILD | MIDDLEWARES | {"robocomp_py.tools", "mcap", "msgpack"},
    "robocomp_py.tools.diary.note": BUILD | MIDDLEWARES | {"mcap", "msgpack"},
    "robocomp_py.virtual.simulation": BUILD | MIDDLEWARES | {"msgpack", "robocomp_py.classic"},
    "robocomp_py.lockstep.lockstep": BUILD | MIDDLEWARES | {"msgpack", "robocomp_py.classic", "robocomp_py.virtual"},
    "robocomp_py.contract.told": BUILD | MIDDLEWARES | {"robocomp_py.wire", "robocomp_py.transports", "msgpack"},
    "robocomp_py.wire.json": BUILD | MIDDLEWARES | {"robocomp_py.transports", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.tools.census": BUILD
    | MIDDLEWARES
    | {"numpy", "importlib.metadata", "robocomp_py.runtime", "robocomp_py.transports.network", "msgpack"},
    "robocomp_py.tools.doctor.checks": BUILD | MIDDLEWARES | {"msgpack"},
    "robocomp_py.tools.doctor.collect": BUILD | MIDDLEWARES | {"msgpack"},
    "robocomp_py.tools.drift": BUILD | MIDDLEWARES | {"robocomp_py.runtime", "msgpack"},
    "robocomp_py.tools.monitor.watching": BUILD | MIDDLEWARES | {"msgpack"},
    "robocomp_py.tools.tap": BUILD | MIDDLEWARES | {"msgpack"},
    "robocomp_py.innermodel.tree": BUILD
    | MIDDLEWARES
    | {"robocomp_py.contract", "robocomp_py.wire", "robocomp_py.transports", "robocomp_py.runtime", "mujoco"},
    "robocomp_py.innermodel.mesh": BUILD | MIDDLEWARES | {"trimesh", "robocomp_py.runtime"},
    "robocomp_py.sim.world": BUILD
    | MIDDLEWARES
    | {"robocomp_py.contract", "robocomp_py.wire", "robocomp_py.transports", "robocomp_py.runtime", "trimesh"},
    "robocomp_py.sim.view.shapes": BUILD
    | MIDDLEWARES
    | {"viser", "mujoco", "trimesh", "robocomp_py.contract", "robocomp_py.transports", "robocomp_py.runtime"},
    "robocomp_py.sim.view.viewing": BUILD - {"rich"}
    | MIDDLEWARES
    | {"mujoco", "robocomp_py.contract", "robocomp_py.transports", "robocomp_py.runtime"},
    "robocomp_py.gym": MIDDLEWARES | {"mujoco", "jinja2", "robocomp_py.codegen", "robocomp_py.cli"},
    "robocomp_py.virtual.outside": BUILD | MIDDLEWARES | {"msgpack", "gymnasium", "robocomp_py.gym"},
    "robocomp_py.client": BUILD | MIDDLEWARES | {"msgpack", "matplotlib", "robocomp_py.actions"},
    "robocomp_py.wire.schema": BUILD | MIDDLEWARES | {"robocomp_py.transports", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.tools.recording.reader": BUILD | MIDDLEWARES | {"mcap", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.tools.recording.series": BUILD
    | MIDDLEWARES
    | {"mcap", "matplotlib", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.tools.drawing": BUILD | MIDDLEWARES | {"matplotlib", "mcap", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.tools.recording.writer": BUILD | MIDDLEWARES | {"mcap", "msgpack"},
    "robocomp_py.tools.mcp.requests": BUILD | MIDDLEWARES | {"mcp", "anyio", "msgpack", "robocomp_py.deploy"},
    "robocomp_py.runtime.load": BUILD | MIDDLEWARES | {"robocomp_py.classic", "lib2to3"},
    "robocomp_py.tools.announced": BUILD | MIDDLEWARES | {"numpy", "robocomp_py.contract", "robocomp_py.runtime"},
    "robocomp_py.cli.candidates": MIDDLEWARES | {"numpy", "dataclasses", "robocomp_py.dsl", "robocomp_py.deploy"},
    "robocomp_py.cli.rc": MIDDLEWARES
    | {
        "numpy",
        "pygls",
        "lark",
        "libcst",
        "jinja2",
        "rich",
        "robocomp_py.codegen",
        "robocomp_py.deploy",
        "robocomp_py.usercode",
    },
    "robocomp_py.usercode.check": MIDDLEWARES | {"libcst", "jinja2", "robocomp_py.codegen", "robocomp_py.runtime"},
    "robocomp_py.dsl.workspace": MIDDLEWARES
    | {
        "robocomp_py.dsl.ddsl",
        "robocomp_py.dsl.smdsl",
        "robocomp_py.innermodel",
        "numpy",
        "jinja2",
        "robocomp_py.codegen",
        "robocomp_py.runtime",
        "msgpack",
    },
    "robocomp_py.codegen.generate": MIDDLEWARES
    | {"numpy", "lark", "robocomp_py.dsl", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.lsp.rename": MIDDLEWARES
    | {"pygls", "lsprotocol", "jinja2", "robocomp_py.codegen", "robocomp_py.deploy"},
    "robocomp_py.lsp.fixes": MIDDLEWARES
    | {"pygls", "lsprotocol", "jinja2", "robocomp_py.codegen", "robocomp_py.deploy"},
    "robocomp_py.lsp.complete": MIDDLEWARES | {"pygls", "lsprotocol", "jinja2", "robocomp_py.codegen"},
    "robocomp_py.lsp.session": MIDDLEWARES | {"libcst", "jinja2", "robocomp_py.codegen", "robocomp_py.deploy"},
    "robocomp_py.deploy.agent": MIDDLEWARES
    | {"lark", "jinja2", "rich", "numpy", "asyncssh", "robocomp_py.dsl", "robocomp_py.codegen", "robocomp_py.cli"},
    "robocomp_py.deploy.client": MIDDLEWARES | {"asyncio", "lark", "rich", "numpy", "robocomp_py.dsl"},
    "robocomp_py.deploy.launcher.keeper": MIDDLEWARES | {"asyncio", "lark", "numpy", "robocomp_py.contract"},
    "robocomp_py.deploy.launcher.forkserver": MIDDLEWARES | {"asyncio", "lark", "rich", "robocomp_py.deploy.plan"},
    "robocomp_py.deploy.policy": {"subprocess", "asyncio", "lark", "numpy", "robocomp_py.dsl"},
    "robocomp_py.deploy.planner": MIDDLEWARES
    | {"numpy", "asyncio", "subprocess", "jinja2", "robocomp_py.codegen", "msgpack"},
}


def test_imports_stay_within_their_layer() -> None:
    assert left_layers(FORBIDDEN) == {}


def test_an_import_that_leaves_its_layer_is_found() -> None:
    assert left_layers({"msgpack": {"numpy"}, "numpy": {"numpy", "msgpack"}}) == {"numpy": {"numpy"}}


def left_layers(forbidden: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """By module, what is there once it is imported and must not be."""
    loaded = loaded_with(forbidden)
    assert loaded.keys() == forbidden.keys()
    return {module: found for module, them in forbidden.items() if (found := them & loaded[module])}


PROBE = """
import os, sys

common, *lines = sys.stdin.read().splitlines()
__import__(common)
for module, *forbidden in map(str.split, lines):
    if common != "sys" and not sys.modules.keys().isdisjoint(forbidden):
        continue
    if not os.fork():
        __import__(module)
        print(module, *sys.modules, flush=True)
        os._exit(0)
    if os.wait()[1]:
        sys.exit(module)
"""
"""Imports modules, each in a process of its own; at first those that may load what takes longest to load."""


def loaded_with(forbidden: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """All modules that are there once one is imported, by its name; perhaps also some that may be there."""
    loaded: dict[str, set[str]] = {}
    for common in ("numpy", "dataclasses", "sys"):
        lines = [" ".join((module, *them)) for module, them in forbidden.items() if module not in loaded]
        command, text = [sys.executable, "-c", PROBE], "\n".join((common, *lines))
        done = subprocess.run(command, input=text, stdout=subprocess.PIPE, text=True, check=True)
        loaded |= {module: set(names) for module, *names in map(str.split, done.stdout.splitlines())}
    return loaded


PACKAGE = Path(robocomp_py.__file__).parent
BENCHMARKS = PACKAGE.parent / "benchmarks"
CORE = [path for path in sorted(PACKAGE.rglob("*.py")) if path.relative_to(PACKAGE).parts[0] != "classic"]


def named(path: Path, *, texts: bool = True) -> Iterator[str]:
    """The modules that a file imports, wherever in it, and all texts in it that may name one."""
    package = ".".join(path.relative_to(PACKAGE.parent).parts[:-1])
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        match node:
            case ast.Import(names=names):
                yield from (each.name for each in names)
            case ast.ImportFrom(module=module, names=names, level=level):
                origin = resolve_name("." * level + (module or ""), package)
                yield from (f"{origin}.{each.name}" for each in names)
            case ast.Constant(value=str(text)) if texts:
                yield text
            case _:
                pass


def test_the_core_names_nothing_of_classic() -> None:
    """Not in a function, not under TYPE_CHECKING, not as a text: it reaches plug-ins by their entry points only."""
    parts = ("robocomp_py.classic", ".classic", "classic/", "classic.")
    assert len(CORE) > 300
    for path in CORE:
        if "classic" in path.read_text(encoding="utf-8"):
            found = [name for name in named(path) if name == "classic" or name.startswith(parts)]
            assert (path.relative_to(PACKAGE), found) == (path.relative_to(PACKAGE), [])


def test_no_file_imports_itself_by_way_of_others() -> None:
    """Imports inside of functions count, and those for types alone: whoever reads a file reads those below it only."""
    known = {module_of(path): path for package in (PACKAGE, BENCHMARKS) for path in package.rglob("*.py")}
    graph = {name: set(imported(path, known)) - {name} for name, path in known.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as exc:
        pytest.fail(" <- ".join(exc.args[1]))


def module_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(path: Path, known: Container[str]) -> Iterator[str]:
    """The modules of ours that an import in a file names."""
    for name in named(path, texts=False):
        package = name.rpartition(".")[0]
        if name in known or package in known:
            yield name if name in known else package
