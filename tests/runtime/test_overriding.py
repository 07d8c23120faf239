"""File, then environment, then command line; and what holds in the end."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.parameters import Parameter, ParameterKind, ParameterList, ParameterSet
from robocomp_py.contract.qos import QoS, Reliability
from robocomp_py.errors import ConfigurationError
from robocomp_py.runtime import settings
from robocomp_py.runtime.document import Document
from robocomp_py.runtime.effective import as_json, as_toml, effective
from robocomp_py.runtime.settings import Settings
from robocomp_py.testing import everything as e

MOTORS = ParameterList(
    "motors",
    ParameterSet(
        "motors", (Parameter("name", ParameterKind.STRING, ""), Parameter("torque", ParameterKind.FLOAT, 1.0))
    ),
)
PARAMS = ParameterSet(
    "robot",
    (
        Parameter("max_speed", ParameterKind.FLOAT, 0.5, 0.0, 2.0),
        Parameter("device", ParameterKind.STRING, ""),
        Parameter("middleware", ParameterKind.STRING, ""),
        Parameter("quiet", ParameterKind.BOOL, False),
    ),
    (MOTORS, ParameterList("cameras", ParameterSet("cameras", (Parameter("id", ParameterKind.INT, 0),)))),
)
ROBOT = Component(
    "Robot",
    (
        Port(Verb.REQUIRES, e.EVERYTHING),
        Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=QoS(Reliability.RELIABLE, depth=3)),
    ),
    PARAMS,
)
FILE = """\
[component]
period = 0.3
[params]
max_speed = 1.0
[[params.motors]]
name = "left"
[ports.everything.work]
deadline = 9
"""


def document(tmp_path: Path, variables: dict[str, str], *sets: str, text: str = FILE) -> Document:
    path = tmp_path / "config.toml"
    path.write_text(text)
    made = settings.read(path, PARAMS)
    settings.environment(made, ROBOT, variables)
    for assignment in sets:
        settings.override(made, assignment)
    return made


def load(tmp_path: Path, variables: dict[str, str], *sets: str) -> Settings:
    return settings.check(ROBOT, document(tmp_path, variables, *sets))


# Who counts most.


def test_the_command_line_counts_more_than_the_environment_and_that_more_than_the_file(tmp_path: Path) -> None:
    speed = {"ROBOCOMP__PARAMS__MAX_SPEED": "1.5"}
    assert load(tmp_path, {}).params["max_speed"] == 1.0
    assert load(tmp_path, speed).params["max_speed"] == 1.5
    assert load(tmp_path, speed, "params.max_speed=2").params["max_speed"] == 2.0


@pytest.mark.parametrize(
    ("name", "text", "key", "value"),
    [
        ("ROBOCOMP__PARAMS__MAX_SPEED", "0.1", ("params", "max_speed"), 0.1),
        ("ROBOCOMP__params__max_speed", "0.1", ("params", "max_speed"), 0.1),
        ("robocomp__Params__Max_Speed", "0.1", ("params", "max_speed"), 0.1),
        ("ROBOCOMP__MAX_SPEED", "0.1", ("params", "max_speed"), 0.1),
        ("ROBOCOMP__PARAMS__MOTORS__0__TORQUE", "3", ("params", "motors", 0, "torque"), 3),
        ("ROBOCOMP__MOTORS__1__NAME", "right", ("params", "motors", 1, "name"), "right"),
        ("ROBOCOMP__COMPONENT__LOG", "debug", ("component", "log"), "debug"),
        ("ROBOCOMP__MIDDLEWARE", "inproc", ("middleware",), "inproc"),
        ("ROBOCOMP__PORTS__everything__FROM", "world", ("ports", "everything", "from"), "world"),
        ("ROBOCOMP__PORTS__Everything__QOS", "{ depth = 2 }", ("ports", "Everything", "qos"), {"depth": 2}),
        ("ROBOCOMP__PORTS__everything__WORK__DEADLINE", "2", ("ports", "everything", "work", "deadline"), 2),
        ("ROBOCOMP__TRANSPORTS__ZEROMQ__BIND", "tcp://x", ("transports", "zeromq", "bind"), "tcp://x"),
        ("ROBOCOMP__PARAMS__DEVICE", "42", ("params", "device"), "42"),
    ],
)
def test_any_key_can_be_set_in_the_environment(
    tmp_path: Path, name: str, text: str, key: tuple[str | int, ...], value: Any
) -> None:
    made = document(tmp_path, {name: text, "ROBOCOMP_RUNTIME_DIR": "elsewhere", "HOME": "x"})
    found: Any = made.data
    for part in key:
        found = found[part]
    assert found == value
    assert made.place(key) == f"environment variable {name}"


@pytest.mark.parametrize(
    ("name", "text", "wrong"),
    [
        ("ROBOCOMP__PARAMS__MAX_SPEED", "3", "`max_speed` is 3; allowed: float, 0.0 to 2.0"),
        ("ROBOCOMP__PARAMS__MAX_SPED", "3", "unknown parameter `max_sped`; did you mean `max_speed`?"),
        ("ROBOCOMP__MAX_SPED", "3", "unknown parameter `max_sped`; did you mean `max_speed`?"),
        ("ROBOCOMP__COMPONENT__PEROD", "3", "unknown key `perod`; did you mean `period`?"),
        (
            "ROBOCOMP__PORTS__EVERYTHING__FROM",
            "x",
            "`EVERYTHING` is ambiguous: write it exactly as `everything` or `Everything`",
        ),
        ("ROBOCOMP__PARAMS____X", "x", "a part of the key is empty; write it as in ROBOCOMP__COMPONENT__PERIOD"),
        ("ROBOCOMP__MOTORS__7__NAME", "x", "there is no item params.motors[7]"),
    ],
)
def test_what_is_wrong_in_the_environment_names_its_variable(tmp_path: Path, name: str, text: str, wrong: str) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(f"environment variable {name}: {wrong}")):
        load(tmp_path, {name: text})


# Short names.


def test_a_parameter_may_be_called_without_params(tmp_path: Path) -> None:
    checked = load(tmp_path, {}, "max_speed=1.5", "motors[0].torque=2", "device=0042")
    assert (checked.params["max_speed"], checked.params["device"]) == (1.5, "0042")
    assert checked.params["motors"] == [{"name": "left", "torque": 2.0}]


def test_a_key_of_ours_is_meant_rather_than_a_parameter_that_is_called_so(tmp_path: Path) -> None:
    assert load(tmp_path, {}, "middleware=inproc").params["middleware"] == ""
    assert load(tmp_path, {}, "params.middleware=inproc").params["middleware"] == "inproc"


def test_a_misspelt_short_name_is_said_to_be_a_parameter(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"--set max_sped=1: unknown parameter `max_sped`; did you mean `max_"):
        load(tmp_path, {}, "max_sped=1")
    with pytest.raises(ConfigurationError, match=r"--set midleware=x: unknown key `midleware`; did you mean `middlew"):
        load(tmp_path, {}, "midleware=x")


def test_an_item_behind_the_last_one_is_added(tmp_path: Path) -> None:
    checked = load(tmp_path, {}, "motors[1].name=right", "cameras[0].id=7")
    assert [motor["name"] for motor in checked.params["motors"]] == ["left", "right"]
    assert checked.params["cameras"] == [{"id": 7}]


def test_a_dozen_items_can_be_set_in_the_environment_in_any_order(tmp_path: Path) -> None:
    variables = {f"ROBOCOMP__{'Cameras' if i % 2 else 'CAMERAS'}__{i}__ID": str(i) for i in reversed(range(12))}
    assert load(tmp_path, variables).params["cameras"] == [{"id": i} for i in range(12)]


@pytest.mark.parametrize(
    ("assignment", "value"),
    [("max_speed=.5", 0.5), ("quiet=True", True), ("quiet=FALSE", False), ("cameras[0].id=07", 7)],
)
def test_what_is_no_toml_is_read_as_its_parameter_wants_it(tmp_path: Path, assignment: str, value: Any) -> None:
    params = load(tmp_path, {}, assignment).params
    assert value in (params["max_speed"], params["quiet"], *(each["id"] for each in params["cameras"]))


@pytest.mark.parametrize("text", ["1\nother = 2", "[" * 5000, "9" * 5000])
def test_text_that_toml_would_change_or_refuse_is_kept_as_it_is(tmp_path: Path, text: str) -> None:
    assert load(tmp_path, {"ROBOCOMP__DEVICE": text}).params["device"] == text


# What holds.


def shown(made: Document) -> list[str]:
    return as_toml(effective(ROBOT, settings.check(ROBOT, made), made, "zeromq")).splitlines()


def test_values_are_shown_with_their_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("config.toml").write_text(FILE)
    made = settings.read(Path("config.toml"), PARAMS)
    settings.environment(made, ROBOT, {"ROBOCOMP__MAX_SPEED": "1.5"})
    settings.override(made, "motors[1].name=right")
    assert [re.sub(" +# ", " # ", line) for line in shown(made)] == [
        'namespace = "" # default',
        'middleware = "zeromq" # what it was generated for',
        "",
        "[component]",
        "period = 0.3 # config.toml:2",
        'log = "info" # default',
        "startup_timeout = 60.0 # default",
        "",
        "[params]",
        "max_speed = 1.5 # environment variable ROBOCOMP__MAX_SPEED",
        'device = "" # default',
        'middleware = "" # default',
        "quiet = false # default",
        "cameras = [] # default",
        "",
        "[[params.motors]]",
        'name = "left" # config.toml:6',
        "torque = 1.0 # default",
        "",
        "[[params.motors]]",
        'name = "right" # --set motors[1].name=right',
        "torque = 1.0 # default",
        "",
        "[ports.everything]",
        'middleware = "zeromq" # what it was generated for',
        'from = "" # default',
        "deadline = 5.0 # default",
        'qos = "default" # default',
        "",
        "[ports.everything.work]",
        "deadline = 9.0 # config.toml:8",
        "",
        "[ports.Everything]",
        'middleware = "zeromq" # what it was generated for',
        'from = "" # default',
        'qos = { reliability = "reliable", depth = 3 } # its .cdsl',
    ]


def test_what_is_shown_can_be_read_again_and_means_the_same(tmp_path: Path) -> None:
    made = document(
        tmp_path,
        {"ROBOCOMP__DEVICE": 'a "quoted" \\ text'},
        "transports.zeromq.bind=tcp://127.0.0.1:0",
        'ports.Everything.also=["dds", { from = "other" }]',
    )
    first = settings.check(ROBOT, made)
    again = tmp_path / "again.toml"
    again.write_text("\n".join(shown(made)))
    second = settings.check(ROBOT, settings.read(again, PARAMS))
    assert (second.params, second.transports, second.period) == (first.params, first.transports, first.period)
    for port in ROBOT.ports:
        for operation, _ in port.interface.under(port.verb):
            before, after = first.port(port, operation.name), second.port(port, operation.name)
            assert (after.deadline, after.qos, after.source) == (before.deadline, before.qos, before.source)
            assert after.also == before.also


def test_machines_get_one_key_a_line(tmp_path: Path) -> None:
    made = document(tmp_path, {}, "motors[0].torque=2")
    lines = as_json(effective(ROBOT, settings.check(ROBOT, made), made, "zeromq")).splitlines()
    rows = {row["key"]: row for row in map(json.loads, lines)}
    assert rows["params.motors[0].torque"] == {
        **{"key": "params.motors[0].torque", "value": 2.0, "from": "--set motors[0].torque=2"},
    }
    assert rows["component.period"]["from"].endswith("config.toml:2")
