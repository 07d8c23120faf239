"""Programs with Ice and the output of slice2py alone ask our components, and are asked by them."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.testing.patience import SOON

pytestmark = pytest.mark.tool

HERE = Path(__file__).parent
GUARD = "import runpy, sys; sys.modules['robocomp_py'] = None; del sys.argv[0]; runpy.run_path(sys.argv[0])"
"""An import of ours is an error."""

HAMMER, SAW = ["hammer", "good", 1.5], ["Säge", "bad", 0.25]
TOLD = {
    "divide": [3, 2],
    "divide by zero": ["Trouble", "division by zero"],
    "tools": [[HAMMER, SAW], {"hammer": 1, "Säge": 1}, [1.5, 0.25]],
    "good tools": [[HAMMER], {"hammer": 1}, [1.5]],
    "borrow": None,
    "borrow what is missing": ["Missing", "not there", SAW, 7],
    "a megabyte": True,
    "tidied": 2,
}

Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both components, and what slice2py makes of their interface."""
    folder = tmp_path_factory.mktemp("calls")
    for name in ("workshop", "customer"):
        run("rcgen", str(HERE / f"{name}.cdsl"), "-o", str(folder / name), "--middleware", "ice")
        (folder / name / "specificworker.py").write_bytes((HERE / f"{name}_part.py").read_bytes())
    run("rcgen", str(HERE / "Workshop.idsl"), "--to", "slice", "-o", str(folder))
    run("slice2py", "--output-dir", str(folder), str(folder / "Workshop.ice"))
    return folder


@pytest.fixture
def start(folder: Path) -> Iterator[Start]:
    with contextlib.ExitStack() as running:

        def begin(*command: str) -> subprocess.Popen[str]:
            pipe = subprocess.PIPE
            program = subprocess.Popen([here(command[0]), *command[1:]], cwd=folder, text=True, stdin=pipe, stdout=pipe)
            running.enter_context(program)
            running.callback(program.terminate)
            return program

        yield begin


def here(program: str) -> str:
    """Ours are those of the environment that the tests run in."""
    ours = Path(sys.executable).parent / program
    return str(ours) if ours.exists() else program


def run(*command: str) -> None:
    done = subprocess.run([here(command[0]), *command[1:]], capture_output=True, text=True, timeout=SOON * 6)
    assert done.returncode == 0, done.stdout + done.stderr


def foreign(*arguments: str) -> list[str]:
    return [sys.executable, "-I", "-c", GUARD, str(HERE / "tools.py"), *arguments]


def told(program: subprocess.Popen[str]) -> dict[str, Any]:
    output, _ = program.communicate(timeout=SOON * 3)
    assert program.returncode == 0, output
    return dict(map(json.loads, output.splitlines()))


def serving(start: Start, port: int) -> str:
    """Start the component, and wait until it serves; its proxy."""
    endpoint = f"tcp -h 127.0.0.1 -p {port}"
    start("rc", "run", "workshop", "--set", f"transports.ice.endpoints.Workshop={endpoint}")
    proxy = f"workshop:{endpoint}"
    waiting = start("rc", "run", "customer", "--set", f"transports.ice.proxies.Workshop={proxy}")
    assert told(waiting)["divide"] == [3, 2]
    return proxy


def test_a_program_of_ices_own_asks_a_component(start: Start, free_port: int) -> None:
    proxy = serving(start, free_port)
    answers = told(start(*foreign("ask", proxy)))
    assert answers.pop("polish") == [4, 3, 2, 1, 0] * 2
    assert answers.pop("fail") == ["UnknownException", "RuntimeError", "on purpose"]
    assert answers == TOLD | {"tidied": 4}


def test_a_component_asks_a_program_of_ices_own(start: Start) -> None:
    program = start(*foreign("serve", "tcp"))
    assert program.stdout
    ready, _, proxy = program.stdout.readline().strip().partition(" ")
    assert ready == "ready"
    answers = told(start("rc", "run", "customer", "--set", f"transports.ice.proxies.Workshop={proxy}"))
    assert answers.pop("polish") == "0403020100" * 2
    assert answers.pop("fail") == ["RuntimeError", "on purpose"]
    assert answers == TOLD
    assert told(program) == {"tidied": [1, 2]}


def test_what_ice_has_beside_calls_does_no_harm(start: Start, free_port: int) -> None:
    answers = told(start(*foreign("probe", serving(start, free_port))))
    assert answers.pop("nonsense")[:2] == ["UnknownException", "DecodeError"]
    assert answers == {
        "ids": ["::Ice::Object", "::RoboCompWorkshop::Workshop"],
        "is a workshop": True,
        "is another": False,
        "id": "::RoboCompWorkshop::Workshop",
        "by a facet": [3, 1],
        "with a context": [3, 1],
        "fails with a context": ["UnknownException", "RuntimeError", "odd"],
        "idempotent as normal": True,
        "one way": True,
        "another name": ["ObjectNotExistException"],
        "another operation": ["OperationNotExistException"],
        "divide": [3, 2],
    }
