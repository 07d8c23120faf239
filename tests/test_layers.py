"""Arrows point one way: what a robot runs must not drag in what a workstation builds with."""

from __future__ import annotations

import subprocess
import sys

import pytest

BUILD = {"lark", "jinja2", "rich", "robocomp_py.dsl", "robocomp_py.codegen", "robocomp_py.deploy", "robocomp_py.cli"}
MIDDLEWARES = {"zmq", "cyclonedds", "zenoh", "iceoryx2"}

FORBIDDEN: dict[str, set[str]] = {
    "robocomp_py": {"numpy", "robocomp_py.errors"},
    "robocomp_py.errors": {"numpy", "robocomp_py.contract"},
    "robocomp_py.spelling": {"numpy", "robocomp_py.contract"},
    "robocomp_py.installed": BUILD | MIDDLEWARES | {"numpy", "robocomp_py.contract"},
    "robocomp_py.contract.module": BUILD | MIDDLEWARES | {"robocomp_py.wire", "robocomp_py.transports", "msgpack"},
    "robocomp_py.wire.cdr": BUILD | MIDDLEWARES | {"robocomp_py.transports", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.wire.ice": BUILD | MIDDLEWARES | {"Ice", "robocomp_py.transports", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.wire.messagepack": BUILD | MIDDLEWARES | {"robocomp_py.transports", "robocomp_py.runtime"},
    "robocomp_py.transports.base": BUILD | MIDDLEWARES | {"robocomp_py.runtime", "msgpack"},
    "robocomp_py.transports.inproc": BUILD | MIDDLEWARES | {"robocomp_py.runtime", "msgpack"},
    "robocomp_py.transports.zeromq": BUILD | (MIDDLEWARES - {"zmq"}) | {"robocomp_py.runtime"},
    "robocomp_py.transports.dds": BUILD | (MIDDLEWARES - {"cyclonedds"}) | {"robocomp_py.runtime", "msgpack"},
    "robocomp_py.transports.exclusive": BUILD | MIDDLEWARES | {"robocomp_py.runtime", "msgpack", "numpy"},
    "robocomp_py.transports.zenoh": BUILD | (MIDDLEWARES - {"zenoh"}) | {"robocomp_py.runtime", "msgpack"},
    "robocomp_py.transports.shm": BUILD | (MIDDLEWARES - {"iceoryx2"}) | {"robocomp_py.runtime", "msgpack"},
    "robocomp_py.transports.iceoptions": BUILD | MIDDLEWARES | {"Ice", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.runtime.iceports": BUILD | MIDDLEWARES | {"Ice", "msgpack", "robocomp_py.runtime.classic"},
    "robocomp_py.runtime.statechart": BUILD | MIDDLEWARES | {"numpy", "robocomp_py.wire", "robocomp_py.transports"},
    "robocomp_py.graph.statemachine": BUILD | MIDDLEWARES | {"numpy", "xml", "robocomp_py.wire", "robocomp_py.runtime"},
    "robocomp_py.graph.netsvg": BUILD | MIDDLEWARES | {"numpy", "xml", "robocomp_py.wire", "robocomp_py.runtime"},
    "robocomp_py.runtime.api": BUILD | MIDDLEWARES | {"xml", "pyexpat", "msgpack", "argparse"},
    "robocomp_py.runtime.run": BUILD | MIDDLEWARES | {"msgpack", "robocomp_py.runtime.classic"},
    "robocomp_py.compat.qt": BUILD | MIDDLEWARES | {"PySide6", "robocomp_py.runtime.run", "robocomp_py.compat.qt.real"},
    "robocomp_py.runtime.load": BUILD | MIDDLEWARES | {"robocomp_py.compat", "lib2to3"},
    "robocomp_py.compat.existing": BUILD | MIDDLEWARES | {"PySide6", "Ice", "msgpack", "lib2to3"},
    "robocomp_py.compat.python2": BUILD | MIDDLEWARES | {"numpy", "robocomp_py.runtime", "lib2to3"},
    "robocomp_py.cli.rc": MIDDLEWARES
    | {"pygls", "lark", "jinja2", "rich", "robocomp_py.codegen", "robocomp_py.deploy"},
    "robocomp_py.dsl.workspace": MIDDLEWARES | {"jinja2", "robocomp_py.codegen", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.codegen.generate": MIDDLEWARES | {"lark", "robocomp_py.dsl", "robocomp_py.runtime", "msgpack"},
    "robocomp_py.lsp.rename": MIDDLEWARES
    | {"pygls", "lsprotocol", "jinja2", "robocomp_py.codegen", "robocomp_py.deploy"},
    "robocomp_py.lsp.fixes": MIDDLEWARES
    | {"pygls", "lsprotocol", "jinja2", "robocomp_py.codegen", "robocomp_py.deploy"},
    "robocomp_py.lsp.complete": MIDDLEWARES | {"pygls", "lsprotocol", "jinja2", "robocomp_py.codegen"},
    "robocomp_py.lsp.server": MIDDLEWARES | {"jinja2", "robocomp_py.codegen", "robocomp_py.deploy"},
    "robocomp_py.deploy.agent": MIDDLEWARES
    | {"lark", "jinja2", "rich", "numpy", "asyncssh", "robocomp_py.dsl", "robocomp_py.codegen", "robocomp_py.cli"},
    "robocomp_py.deploy.client": MIDDLEWARES | {"asyncio", "lark", "rich", "numpy", "robocomp_py.dsl"},
    "robocomp_py.deploy.launcher.keeper": MIDDLEWARES | {"asyncio", "lark", "numpy", "robocomp_py.contract"},
    "robocomp_py.deploy.launcher.zygote": MIDDLEWARES | {"asyncio", "lark", "rich", "robocomp_py.deploy.plan"},
    "robocomp_py.deploy.policy": {"subprocess", "asyncio", "lark", "numpy", "robocomp_py.dsl"},
    "robocomp_py.deploy.planner": MIDDLEWARES | {"subprocess", "jinja2", "robocomp_py.codegen", "msgpack"},
}


@pytest.mark.parametrize("module", FORBIDDEN)
def test_imports_stay_within_their_layer(module: str) -> None:
    code = f"import sys, {module}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert FORBIDDEN[module] & set(loaded) == set()
