"""`rc param` and `rc log` show and change parameters and levels of components that run."""

from __future__ import annotations

import itertools
import json
import logging
import threading
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli.param import _At, _watch
from robocomp_py.errors import Unreachable
from robocomp_py.runtime.RoboCompIntrospection import Setting
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools import asking, params
from robocomp_py.tools.access import Access
from robocomp_py.tools.census import take_census
from robocomp_py.transports.base import find_transport

from ..runtime.components import Calculator, Tuned
from ..runtime.running import make, running
from .commands import complained, said

OVER = ("--middleware", "shm")


@pytest.fixture
def tuned() -> Iterator[Any]:
    with running(make(Tuned, find_transport, "middleware=shm", "namespace=robot1", "params.device=here")) as worker:
        wait_until(lambda: "robot1/tuned" in asking.components(take_census(["shm"])))
        yield worker


def test_parameters_are_listed(tuned: Any, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [json.loads(line) for line in said(capsys, "param", "list", "--json", *OVER).splitlines()]
    assert {"component": "robot1/tuned", "name": "max_speed", "value": 0.5} in lines
    assert "max_speed" in said(capsys, "param", "list", "tuned", *OVER)


def test_components_are_asked_at_the_same_time(
    own_runtime_folder: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    both, read = threading.Barrier(2, timeout=SOON), params.read

    def wait_and_read(*arguments: Any) -> list[Setting]:
        both.wait()
        return read(*arguments)

    monkeypatch.setattr(params, "read", wait_and_read)
    made = [make(Tuned, find_transport, "middleware=shm", "params.device=here", name=name) for name in ("one", "two")]
    with running(made[0]), running(made[1]):
        wait_until(lambda: params.components(take_census(["shm"])) == ["one", "two"])
        lines = [json.loads(line) for line in said(capsys, "param", "list", "--json", *OVER).splitlines()]
        assert list(dict.fromkeys(line["component"] for line in lines)) == ["one", "two"]
        assert said(capsys, "param", "dump", "one", "two", *OVER).count("ros__parameters") == 2


def test_a_value_is_set_and_read(tuned: Any, capsys: pytest.CaptureFixture[str]) -> None:
    told = json.loads(said(capsys, "param", "set", "tuned", "max_speed=1.5", "--json", *OVER))
    assert told == {"component": "robot1/tuned", "name": "max_speed", "value": 1.5}
    assert said(capsys, "param", "get", "robot1/tuned", "max_speed", *OVER) == "1.5\n"
    told = json.loads(said(capsys, "param", "get", "tuned", "max_speed", "--json", *OVER))
    assert told == {"component": "robot1/tuned", "name": "max_speed", "value": 1.5}
    assert tuned.params.max_speed == 1.5


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ("max_speed=9", "rc param set: robot1/tuned: max_speed: `max_speed` is 9.0; allowed: float, 0.0 to 2.0"),
        ("device=there", "`device` is not dynamic"),
        ("max_sped=1", "did you mean `max_speed`"),
    ],
)
def test_a_wrong_change_is_refused_with_the_reason(
    given: str, why: str, tuned: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    assert why in complained(capsys, "param", "set", "tuned", given, *OVER)


def test_a_change_without_a_value_is_a_wrong_usage(tuned: Any, capsys: pytest.CaptureFixture[str]) -> None:
    why = "rc param set: `max_speed` is no NAME=VALUE"
    assert complained(capsys, "param", "set", "tuned", "max_speed", *OVER, code=2) == f"{why}\n"
    told = complained(capsys, "param", "set", "tuned", "max_speed", "1", *OVER, code=2)
    assert told == f"{why}; write max_speed=1\n"


def test_ranges_and_comments_are_described(tuned: Any, capsys: pytest.CaptureFixture[str]) -> None:
    told = json.loads(said(capsys, "param", "describe", "tuned", "max_speed", "--json", *OVER))
    assert (told["component"], told["name"], told["type"]) == ("robot1/tuned", "max_speed", "float")
    assert (told["value"], told["minimum"], told["maximum"], told["editable"]) == (0.5, 0.0, 2.0, True)
    assert "float, 0.0 to 2.0" in said(capsys, "param", "describe", "tuned", *OVER)
    assert "did you mean `device`" in complained(capsys, "param", "describe", "tuned", "devise", *OVER)


def test_what_is_dumped_can_be_loaded(tuned: Any, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "tuned.yaml"
    file.write_text(said(capsys, "param", "dump", "tuned", *OVER))
    assert file.read_text().startswith("/robot1/tuned:\n  ros__parameters:\n")
    assert said(capsys, "param", "load", "tuned", str(file), *OVER) == ""
    file.write_text("/**:\n  ros__parameters:\n    max_speed: 1\n    device: here\n")
    assert said(capsys, "param", "load", "tuned", str(file), *OVER) == "max_speed = 1\n"
    assert tuned.params.max_speed == 1.0


def test_changes_are_watched(tuned: Any, capsys: pytest.CaptureFixture[str]) -> None:
    over = threading.Event()

    def change() -> None:
        with Access() as access:
            network = take_census(["shm"])
            for number in itertools.count():
                params.change(access, network, "robot1/tuned", {"max_speed": str(0.25 + 0.5 * (number % 2))}, 5.0)
                if over.wait(0.03):
                    return

    changing = threading.Thread(target=change)
    changing.start()
    try:
        printed = said(capsys, "param", "watch", "tuned", "-n", "2", "--for", f"{SOON}", *OVER)
    finally:
        over.set()
        changing.join()
    assert sorted(printed.splitlines()) == ["max_speed = 0.25", "max_speed = 0.75"]


def test_a_component_is_watched_again_after_a_restart(tuned: Any) -> None:
    """It was there for one question, and not for the next one."""

    class Restarted(_At):
        asked = 0

        def settings(self, component: str) -> list[Setting]:
            self.asked += 1
            if self.asked == 2:
                raise Unreachable("its server left")
            return super().settings(component)

    with Access() as access:
        at = Restarted(access, take_census(["shm"]), ["robot1/tuned"], SOON)
        wait_until(lambda: _watch(at, Namespace(seconds=0.4, most=None, json=False)) == 0 and at.asked > 2)


def test_a_level_is_set(tuned: Any, capsys: pytest.CaptureFixture[str]) -> None:
    logger = "robocomp.test-level"
    told = json.loads(said(capsys, "log", "tuned", "debug", "--logger", logger, "--json", *OVER))
    assert told == {"component": "robot1/tuned", "logger": logger, "level": "debug"}
    assert logging.getLogger("robocomp.test-level").level == logging.DEBUG


def test_a_component_that_is_not_there_is_named(tuned: Any, capsys: pytest.CaptureFixture[str]) -> None:
    brief = ("--timeout", "0.1", *OVER)
    assert "did you mean `tuned`" in complained(capsys, "param", "get", "tunde", "x", *brief)
    assert "did you mean `tuned`" in complained(capsys, "log", "tunde", "debug", *brief)


def setting(name: str, kind: str, value: str) -> Setting:
    return Setting(name=name, type=kind, value=value)


def test_a_component_without_parameters_is_named(own_runtime_folder: Any, capsys: pytest.CaptureFixture[str]) -> None:
    with running(make(Calculator, find_transport, "middleware=shm", name="sums")):
        for part in ("list", "describe"):
            assert f"rc param {part}: sums has no parameters\n" == complained(capsys, "param", part, "sums", *OVER)
        assert "no component here has parameters" in complained(capsys, "param", "list", *OVER)


def test_a_file_of_ros_2_has_the_types_of_values() -> None:
    every = [setting("motors[0].limit", "int", "3"), setting("on", "bool", "True"), setting("text", "string", "on")]
    text = params.to_yaml({"robot1/wander": every})
    assert text == (
        "/robot1/wander:\n  ros__parameters:\n    motors[0]:\n      limit: 3\n    'on': true\n    text: 'on'\n"
    )
    assert params.from_yaml(text, "robot1/wander") == {"motors[0].limit": "3", "on": "True", "text": "on"}


@pytest.mark.parametrize(
    "text",
    [
        "/robot1/wander:\n  ros__parameters: {a: 1}",
        "robot1:\n  wander:\n    ros__parameters: {a: 1}",
        "wander:\n  ros__parameters: {a: 1}",
        "/robot1/*:\n  ros__parameters: {a: 1}",
        "/**:\n  ros__parameters: {a: 2}\n/robot1/wander:\n  ros__parameters: {a: 1}",
    ],
)
def test_nodes_are_named_as_in_ros_2(text: str) -> None:
    assert params.from_yaml(text, "robot1/wander") == {"a": "1"}


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("a: 1", "it has no `ros__parameters`"),
        ("other:\n  ros__parameters: {a: 1}", "it has parameters of /other, but none of /robot1/wander"),
        ("wander: [", "no YAML"),
        ("wander:\n  ros__parameters: {a: }", "`a` has no value"),
        ("wander: &a\n  ros__parameters: &b\n    x: *b", "is nested too deep"),
        ("wander: !!python/object:os.system {}", "no YAML"),
    ],
)
def test_a_wrong_file_is_explained(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        params.from_yaml(text, "robot1/wander")
