"""`rc top` shows what components do."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli.top import _live, lines
from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.qos import PRESETS
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools import asking
from robocomp_py.tools.census import take_census
from robocomp_py.tools.measure import Load, Operation
from robocomp_py.transports.base import find_transport

from ..runtime.components import Calculator, Diary, EverythingPublisher, Pupil
from ..runtime.running import make, running
from .commands import complained, said


class Asking(Pupil):
    def compute(self) -> None:
        super().compute()
        self.everything_proxy.divide(7, 2)


@pytest.fixture(scope="module")
def pair() -> Iterator[Any]:
    over = ("middleware=shm", "namespace=desk")
    with (
        running(make(Calculator, find_transport, *over)),
        running(make(Asking, find_transport, *over, name="pupil")) as pupil,
    ):
        wait_until(lambda: {"desk/calculator", "desk/pupil"} <= set(asking.components(take_census(["shm"]))))
        wait_until(lambda: pupil.entries.count("compute") > 3)
        yield pupil


def test_components_and_operations_are_shown(pair: Any, capsys: pytest.CaptureFixture[str]) -> None:
    lines = said(capsys, "top", "--once", "--middleware", "shm").splitlines()
    assert lines[0].split() == [
        *("component", "state", "process", "cpu", "%", "MB", "compute/s", "msg/s"),
        *("failed", "lost", "queue", "suspended", "overruns"),
    ]
    (row,) = [line.split() for line in lines if line.startswith("desk/pupil  ")]
    assert (row[1], row[2]) == ("compute", str(os.getpid()))
    (row,) = [line.split() for line in lines if line.startswith("desk/pupil → desk/*/Everything/divide")]
    assert row[3] == "shm"
    assert all(float(each) > 0 for each in row[4:8])
    assert any(line.startswith("desk/calculator ← desk/calculator/Everything/divide") for line in lines)
    assert not any("Everything/work" in line for line in lines)


class Silent(Diary):
    component = Component(
        "silent", (Port(Verb.PUBLISHES, e.EVERYTHING, proxy=EverythingPublisher, qos=PRESETS["services_default"]),)
    )


def test_a_topic_that_nothing_hears_is_told(pair: Any, capsys: pytest.CaptureFixture[str]) -> None:
    with running(make(Silent, find_transport, "middleware=shm", "namespace=desk")):
        wait_until(lambda: "desk/silent" in asking.components(take_census(["shm"])))
        lines = said(capsys, "top", "--all", "--once", "--middleware", "shm").splitlines()
    (row,) = [line.split() for line in lines if line.startswith("desk/silent → ") and "/news" in line]
    assert row[3:6] == ["shm", "not", "heard"]
    assert [line.split()[1] for line in lines if "not heard" in line] == ["→"]


def test_json_has_all_operations(pair: Any, capsys: pytest.CaptureFixture[str]) -> None:
    (line,) = said(capsys, "top", "pupil", "--once", "--json", "--middleware", "shm").splitlines()
    told = json.loads(line)
    by_name = {each["operation"]: each for each in told["operations"]}
    assert (told["component"], told["host"], told["pid"]) == ("desk/pupil", "", os.getpid())
    assert by_name["divide"]["count"] > 3
    assert by_name["work"]["p50"] is None


def test_looks_are_repeated(pair: Any, capsys: pytest.CaptureFixture[str]) -> None:
    told: list[Any] = []

    def repeated() -> bool:
        """In so short a time, a busy machine may look only once."""
        arguments = ("top", "calculator", "--json", "--every", "0.1", "--for", "0.3", "--middleware", "shm")
        told[:] = [json.loads(line) for line in said(capsys, *arguments).splitlines()]
        return len(told) >= 2

    wait_until(repeated, 3 * SOON)
    assert told[-1]["operations"]


def test_a_component_that_is_not_there_is_named(pair: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert "unknown component `pupl`; did you mean `pupil`?" in complained(
        capsys, "top", "pupl", "--once", "--middleware", "shm"
    )


def test_nothing_to_show_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert "no component here tells what it does" in complained(capsys, "top", "--once", "--middleware", "zeromq")


def test_a_component_that_does_not_answer_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    speech = Path(__file__).parents[2] / "components" / "speech"
    command = [sys.executable, "-m", "robocomp_py.cli.rc", "run", str(speech), "--set", "middleware=shm"]
    with subprocess.Popen([*command, "--name", "stopped"], stderr=subprocess.DEVNULL) as process:
        try:
            wait_until(lambda: "stopped" in asking.components(take_census(["shm"])))
            process.send_signal(signal.SIGSTOP)
            (_, row) = said(capsys, "top", "stopped", "--once", "--middleware", "shm").splitlines()
            told = json.loads(said(capsys, "top", "stopped", "--once", "--json", "--middleware", "shm"))
        finally:
            process.kill()
    assert row.split() == ["stopped", "no", "answer", str(process.pid)]
    assert (told["component"], told["state"], told["computes"]) == ("stopped", "no answer", None)


def pupil_load() -> Load:
    divide = Operation(
        *("everything", "requires", "divide", "desk/calculator/Everything/divide", "shm", 7),
        *(20.0, 0.001, 0.002, 0.003, math.nan),
        *(3, 0, 0),
    )
    return Load("desk/pupil", "compute", "here", 17, 0.02, 50_000_000, 100.0, 0.01, 0, 0, 0, (divide,))


def test_the_last_table_stays_after_the_end_by_ctrl_c(capsys: pytest.CaptureFixture[str]) -> None:
    def looks() -> Iterator[list[Load]]:
        yield [pupil_load()]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _live(looks(), Namespace(all=False), with_hosts=False)
    assert "desk/pupil → desk/calculator/Everything/divide" in capsys.readouterr().out.splitlines()[-1]


def test_a_narrow_terminal_shows_what_has_failed() -> None:
    """Of wider lines, empty columns are left out, and names lose their beginnings."""
    load = pupil_load()
    wide, narrow = ([each.plain for each in lines([load], Namespace(all=False), most=most)] for most in (None, 80))
    assert "desk/pupil → desk/calculator/Everything/divide" in wide[3]
    assert max(map(len, narrow)) <= 80
    assert narrow[2].split()[-1] == "failed"
    assert narrow[3].startswith("desk/pupil → …")
    assert narrow[3].endswith("  3")
