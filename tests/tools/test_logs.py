"""`rc logs` shows what components have logged, from those that run them, or from the components themselves."""

from __future__ import annotations

import contextlib
import itertools
import json
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from robocomp_py.deploy.ring import Line
from robocomp_py.runtime.records import Record
from robocomp_py.testing.patience import wait_until
from robocomp_py.tools import asking
from robocomp_py.tools.census import take_census
from robocomp_py.tools.logs import entry_of
from robocomp_py.transports.base import find_transport

from ..deploy.networks import Standing, process
from ..deploy.test_control import Running
from ..runtime.components import Diary
from ..runtime.running import make, running
from .commands import complained, said

OVER = ("--middleware", "shm")


def record(text: str, level: str = "INFO", instance: str = "laser", **more: Any) -> Record:
    return Record(time.time(), level, instance, instance, "compute", "specificworker.py", 41, text, **more)


@pytest.fixture
def network() -> Iterator[Running]:
    """rcdeploy runs these, but nothing else is there of them."""
    made = Running(Standing(process("laser"), process("left/arm"), process("front", instances=("eye", "left/hand"))))
    try:
        yield made
    finally:
        made.close()


def write(network: Running, name: str, told: Record | str, at: float | None = None) -> None:
    found = told if isinstance(told, Record) else None
    text = f"{found.level}: {found.text}" if found else str(told)
    network.call(lambda: network.ring.write(Line(at or time.time(), name, text, found)))


def entries(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in said(capsys, "logs", "--json", *OVER, *arguments).splitlines()]


def texts(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[str]:
    return [each["text"] for each in entries(capsys, *arguments)]


def test_records_of_launched_components_are_shown(network: Running, capsys: pytest.CaptureFixture[str]) -> None:
    write(network, "laser", record("too close", "WARNING", trace="a1"))
    write(network, "laser", "printed")
    write(network, "left/arm", record("moved\nfar", instance="arm"))
    write(network, "rcdeploy", "WARNING: left/arm has ended")
    first, second = entries(capsys)
    assert (first["component"], first["level"], first["text"], first["trace"]) == (
        "laser",
        "WARNING",
        "too close",
        "a1",
    )
    assert (first["file"], first["line"]) == ("specificworker.py", 41)
    assert (second["component"], second["instance"]) == ("left/arm", "arm")
    lines = said(capsys, "logs", *OVER).splitlines()
    assert [line.partition(" ")[2] for line in lines] == [
        "WARNING laser: too close (trace a1)",
        "INFO left/arm: moved",
        "   far",
    ]


def test_records_are_chosen_by_component_level_time_and_text(
    network: Running, capsys: pytest.CaptureFixture[str]
) -> None:
    write(network, "laser", record("long ago"), time.time() - 3600)
    for number, level in enumerate(("DEBUG", "INFO", "WARNING", "ERROR")):
        write(network, "laser", record(f"beam {number}", level))
    write(network, "front", record("seen", instance="eye"))
    write(network, "front", record("held", instance="hand"))
    write(network, "front", record("both", instance=""))
    assert texts(capsys, "laser", "--since", "5m", "--level", "warning") == ["beam 2", "beam 3"]
    assert texts(capsys, "--grep", "beam [01]") == ["beam 0", "beam 1"]
    assert texts(capsys, "hand") == ["held", "both"]
    assert texts(capsys, "eye", "laser", "-n", "2") == ["seen", "both"]
    assert {each["component"] for each in entries(capsys, "hand")} == {"left/hand", "front"}


def test_lines_that_another_program_logged_as_text_have_a_level_too(
    network: Running, capsys: pytest.CaptureFixture[str]
) -> None:
    write(network, "laser", "ERROR: no beam")
    (found,) = entries(capsys)
    assert (found["component"], found["level"], found["text"]) == ("laser", "ERROR", "no beam")


def test_records_are_chosen_by_network_and_host(chatty: Any, capsys: pytest.CaptureFixture[str]) -> None:
    with contextlib.closing(Running(Standing(process("laser"), process("gripper", host="base")))) as network:
        write(network, "laser", record("scanned"))
        write(network, "gripper", record("closed", instance="gripper"))
        assert texts(capsys, "--network", "home") == ["scanned", "closed"]
        assert texts(capsys, "--host", "base") == ["closed"]
        assert texts(capsys, "--network", "home", "--host", "here") == ["scanned"]
        assert "unknown component `chatty`" in complained(
            capsys, "logs", "chatty", "--network", "home", "--timeout", "0.1", *OVER
        )
        assert "did you mean `base`?" in complained(capsys, "logs", "--host", "bose", *OVER)
        assert "network `hone` is not running" in complained(capsys, "logs", "--network", "hone", *OVER)


def test_control_characters_reach_no_terminal(network: Running, capsys: pytest.CaptureFixture[str]) -> None:
    write(network, "laser", record("\x1b[2J\x1b]0;title\x07 \u202e end\r", trace="\x1b[H"))
    (line,) = said(capsys, "logs", *OVER).splitlines()
    assert line.isprintable()
    assert "end" in line


@contextlib.contextmanager
def again_and_again(do: Callable[[int], object]) -> Iterator[None]:
    over = threading.Event()

    def go_on() -> None:
        for number in itertools.count():
            do(number)
            if over.wait(0.02):
                return

    thread = threading.Thread(target=go_on)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def followed(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[str]:
    """The new texts that are shown while they come, in as much time as that takes."""
    for seconds in (1, 4, 16):
        found = texts(capsys, "--follow", "--for", str(seconds), *arguments)
        if any(each.startswith("new") for each in found):
            return found
    raise AssertionError("nothing came")


def test_new_records_follow_the_past_each_once(network: Running, capsys: pytest.CaptureFixture[str]) -> None:
    write(network, "laser", record("past"))
    write(network, "laser", record("ignored", "DEBUG"))
    with again_and_again(lambda number: write(network, "laser", record(f"new {number}"))):
        found = followed(capsys, "laser", "--level", "info")
    numbers = [int(each.removeprefix("new ")) for each in found if each != "past"]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert "ignored" not in found


def test_following_ends_with_the_network(network: Running, capsys: pytest.CaptureFixture[str]) -> None:
    def end() -> None:
        wait_until(lambda: network.ring._sinks, what="it is followed")
        network.close()

    ending = threading.Thread(target=end)
    ending.start()
    assert texts(capsys, "--follow", "laser") == []
    ending.join()


@pytest.fixture
def chatty() -> Iterator[Any]:
    """A component that was started by hand."""
    with running(make(Diary, find_transport, "middleware=shm", "namespace=robot1", name="chatty")) as worker:
        wait_until(lambda: "robot1/chatty" in asking.components(take_census(["shm"])))
        yield worker


def test_components_that_nothing_runs_tell_their_records_themselves(
    chatty: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    with again_and_again(lambda number: chatty.log.warning("new %d", number)):
        found = followed(capsys, "chatty", "--level", "warning", "--grep", "new")
    assert all(each.startswith("new") for each in found)


def test_records_of_components_and_of_networks_are_followed_together(
    chatty: Any, network: Running, capsys: pytest.CaptureFixture[str]
) -> None:
    def speak(number: int) -> None:
        chatty.log.warning("new %d", number)
        write(network, "laser", record(f"new {number}"))

    with again_and_again(speak):
        found: set[str] = set()
        while found != {"robot1/chatty", "laser"}:
            found |= {each["component"] for each in entries(capsys, "--follow", "--for", "1", "--grep", "new")}


def test_what_keeps_no_records_is_said(chatty: Any, network: Running, capsys: pytest.CaptureFixture[str]) -> None:
    text = "rc logs: rcdeploy does not run robot1/chatty, so no past records are kept; --follow shows new ones\n"
    assert complained(capsys, "logs", "chatty", *OVER) == text
    assert complained(capsys, "logs", *OVER, code=0) == text


def test_an_unknown_component_is_named(network: Running, capsys: pytest.CaptureFixture[str]) -> None:
    text = complained(capsys, "logs", "lazer", "--timeout", "0.1", *OVER)
    assert text.startswith("rc logs: unknown component `lazer`; did you mean `laser`?")


@pytest.mark.parametrize(
    "message",
    [
        "not understood",
        {},
        {"entry": 3},
        {"entry": {"at": "soon"}},
        {"entry": {"at": 1, "level": "LOUD"}},
        {"entry": {}},
    ],
)
def test_what_is_no_record_is_left_out(message: Any) -> None:
    assert entry_of("laser", message)[0] is None
