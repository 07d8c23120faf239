"""What is shown of a network: lines, and on a terminal a table below them."""

from __future__ import annotations

import asyncio
import io
import json
import logging
from collections.abc import Callable, Coroutine
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from robocomp_py.deploy.client import Connection, running_plan
from robocomp_py.deploy.place import Place
from robocomp_py.deploy.plan import Plan
from robocomp_py.deploy.policy import State
from robocomp_py.deploy.process import Process
from robocomp_py.deploy.streams import Output
from robocomp_py.deploy.terminal import Terminal
from robocomp_py.errors import DeploymentError
from robocomp_py.testing.patience import SOON

from .networks import Standing, process

PLAN = Plan("house", "auto", tuple(Process(name, "thing", ("true",), Path("/")) for name in ("laser", "arm")), ())

NOON = "12:00:00.250"


@pytest.fixture
def place() -> Any:
    made = Place("house")
    made.take("a test")
    yield made
    made.release()


def terminal(*, is_terminal: bool = False, leave: Callable[[Path], object] | None = None, lines: int = 24) -> Terminal:
    console = Console(file=io.StringIO(), force_terminal=is_terminal, width=80, height=lines, soft_wrap=True,
                      highlight=False, color_system=None, legacy_windows=False)  # fmt: skip
    return Terminal(PLAN, console, leave, clock=lambda: datetime(2026, 3, 1, 12, 0, 0, 250_000).timestamp())


def shown(made: Terminal) -> str:
    file = made._console.file
    assert isinstance(file, io.StringIO)
    return file.getvalue()


def watched(made: Terminal, network: Standing, deed: Callable[[], Coroutine[Any, Any, None]]) -> None:
    async def run() -> None:
        async with made.watching(network):
            await deed()

    asyncio.run(run())


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(SOON):
        while not condition():
            await asyncio.sleep(0.005)


def test_without_a_terminal_there_are_lines_with_names_and_nothing_else(place: Place) -> None:
    made = terminal()

    async def deed() -> None:
        made.line("laser", "INFO: ready")
        made.states({"laser": State.READY, "arm": State.READY})
        made.up()
        made.failed("arm", "ended with exit code 3")
        made.stopping("asked to")

    watched(made, Standing(process("laser"), process("arm")), deed)
    assert shown(made).splitlines() == [
        f"{NOON} laser │ ready",
        f"{NOON} rcdeploy │ both components of house are ready",
        f"{NOON} rcdeploy │ arm ended with exit code 3",
        f"{NOON} rcdeploy │ stopping: asked to",
    ]


def test_what_would_move_what_stands_on_a_terminal_is_left_out(place: Place) -> None:
    for made in terminal(), terminal(is_terminal=True):
        made.line("laser", "10 %\r20 %\b\b\a\v\f, \x1b[31mred\x1b[0m \x1b[2J\x1b]0;title\x07\x9b2J\x1bc")
        assert shown(made) == f"{NOON} laser │ 10 %20 %, \x1b[31mred\x1b[0m [2J]0;title2Jc\n"


def test_on_a_terminal_a_table_stands_below_the_lines(place: Place) -> None:
    made, network = terminal(is_terminal=True), Standing(process("laser", State.STARTING), process("arm"))

    async def deed() -> None:
        await until(lambda: "laser     starting" in shown(made))
        made.line("laser", "here I am")
        network.now = Standing(process("laser"), process("arm", State.FAILED, how="ended with exit code 3")).now
        made.states({"laser": State.READY, "arm": State.FAILED})
        await until(lambda: "laser     ready" in shown(made) and "ended with exit code 3" in shown(made))

    watched(made, network, deed)
    assert shown(made).index("laser │ here I am") < shown(made).rindex("laser     ready")


def test_a_flood_of_lines_is_shown_as_it_is_and_the_table_not_for_each_of_them(place: Place) -> None:
    made = terminal(is_terminal=True)

    async def deed() -> None:
        for number in range(5000):
            made.line("laser", f"line {number};")

    watched(made, Standing(process("laser"), process("arm")), deed)
    said = shown(made)
    assert all(f"line {number};" in said for number in range(5000))
    assert said.count("2 components, 2 ready") < 100


def test_the_table_leaves_half_of_the_terminal_to_the_lines(place: Place) -> None:
    made = terminal(is_terminal=True, lines=20)
    many = Standing(*(process(f"n{number}") for number in range(300)))

    async def deed() -> None:
        await until(lambda: "... and 292 more: 292 ready" in shown(made))

    watched(made, many, deed)


def test_while_it_is_watched_it_can_be_asked_and_its_plan_be_read(place: Place) -> None:
    made, network = terminal(), Standing(process("laser"))

    async def deed() -> None:
        made.line("laser", "hello")
        asked = asyncio.to_thread(_ask)
        assert await asked == (network.now, json.loads(json.dumps(PLAN.to_json())))

    watched(made, network, deed)


def _ask() -> tuple[object, object]:
    with Connection("house") as connection:
        return connection.status(), running_plan("house")


def test_a_network_that_begins_or_ends_has_no_plan_and_so_does_not_run_yet_or_any_more(place: Place) -> None:
    assert place.runner()
    assert running_plan("house") is None
    place.plan.write_text("half a pl")
    with pytest.raises(DeploymentError, match=r"network `house` runs, but its plan cannot be read: .*plan.json"):
        running_plan("house")


def test_after_detaching_nothing_is_shown_but_all_is_logged(place: Place) -> None:
    left: list[Path] = []
    made = terminal(is_terminal=True, leave=left.append)

    async def deed() -> None:
        made.states({"laser": State.READY, "arm": State.READY})
        made.up()
        assert left == [place.folder / "rcdeploy.err"]
        before = shown(made)
        made.line("laser", "unseen")
        made.stopping("asked to")
        assert shown(made) == before

    watched(made, Standing(process("laser"), process("arm")), deed)
    assert [line[1:3] for line in made._ring.last([], 2)] == [("laser", "unseen"), ("rcdeploy", "stopping: asked to")]


def test_what_is_logged_about_launching_is_said_and_kept_like_all_else(
    capsys: pytest.CaptureFixture[str],
) -> None:
    made, log = terminal(), logging.getLogger("robocomp.deploy")
    with made.showing_warnings():
        log.info("of no interest")
        log.warning("%d processes were left", 2)
    log.warning("later")
    assert shown(made) == f"{NOON} rcdeploy │ 2 processes were left\n"
    assert [line[1:3] for line in made._ring.last([], 9)] == [("rcdeploy", "2 processes were left")]
    assert "left" not in capsys.readouterr().err


def test_an_output_that_cannot_be_written_is_given_up_once() -> None:
    complaints = io.StringIO()
    with open("/dev/full", "w") as full:
        output = Output(full, complaints)
        for _ in range(3):
            assert output.write("x" * 10000) == 10000
            output.flush()
    assert complaints.getvalue() == (
        "rcdeploy: output is lost from here on; the network keeps running: No space left on device\n"
    )
