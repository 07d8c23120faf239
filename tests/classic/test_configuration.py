"""RoboComp's own configuration files: what they mean here, and what becomes of the rest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robocomp_py import plugins
from robocomp_py.classic import configuration
from robocomp_py.contract.component import Component
from robocomp_py.contract.parameters import Parameter, ParameterKind, ParameterList, ParameterSet
from robocomp_py.errors import ConfigurationError
from robocomp_py.runtime import settings
from robocomp_py.runtime.document import Document

INT, FLOAT, STRING = ParameterKind.INT, ParameterKind.FLOAT, ParameterKind.STRING
BOOL, ENUM = ParameterKind.BOOL, ParameterKind.ENUM

GAINS = ParameterList("gains", ParameterSet("gains", (Parameter("kp", FLOAT, 1.0),)))
MOTORS = ParameterList(
    "motors",
    ParameterSet("motors", (Parameter("name", STRING, ""), Parameter("max_speed", FLOAT, 1.0, 0.0, 9.0)), (GAINS,)),
)
CAMERAS = ParameterList("cameras", ParameterSet("cameras", (Parameter("name", STRING, ""), Parameter("fps", INT, 30))))
PARAMS = ParameterSet(
    "base",
    (
        Parameter("device", STRING, ""),
        Parameter("rate", INT, 10, 1, 1000),
        Parameter("speed", FLOAT, 0.5),
        Parameter("display", BOOL, False),
        Parameter("mode", ENUM, "slow", choices=("slow", "fast")),
        Parameter("Arm_Reach", FLOAT, 1.0),
        Parameter("lidar_3", STRING, ""),
    ),
    (MOTORS, CAMERAS),
)


READER: plugins.ConfigurationReader = configuration


def read(tmp_path: Path, text: str, params: ParameterSet = PARAMS, name: str = "config") -> Document:
    return READER.read(text, tmp_path / name, params, ())


def params_of(document: Document) -> Any:
    return document.data["params"]


def said(document: Document, params: ParameterSet = PARAMS) -> list[str]:
    """What is wrong, as it is said when the component starts."""
    try:
        settings.check(Component("base", params=params), document)
    except ConfigurationError as exc:
        return [line.rpartition("/")[2] for line in str(exc).splitlines()]
    return []


# The classic form.


@pytest.mark.parametrize(
    ("line", "key", "value"),
    [
        ("device = /dev/ttyUSB0", "device", "/dev/ttyUSB0"),
        ("device=/dev/ttyUSB0 # the base", "device", "/dev/ttyUSB0"),
        ("  device   =   two words\t", "device", "two words"),
        (r"device = a\#b", "device", "a#b"),
        (r"device = a\=b", "device", "a=b"),
        ("device = a=b", "device", "a=b"),
        ('device = "# no comment"  # a comment', "device", "# no comment"),
        ("device =", "device", ""),
        ("device = 0042", "device", "0042"),
        ("base.device = x", "device", "x"),
        ("Base.Device = x", "device", "x"),
        ("rate = 20", "rate", 20),
        ("rate = 0x10", "rate", 16),
        ('rate = "20"', "rate", 20),
        ("speed = 1.", "speed", 1.0),
        ("speed = 2", "speed", 2.0),
        ("display = True", "display", True),
        ("display=false", "display", False),
        ("mode = fast", "mode", "fast"),
        ("Arm.Reach = 3", "Arm_Reach", 3.0),
        ("arm-reach = 3", "Arm_Reach", 3.0),
        ("lidar_3 = helios", "lidar_3", "helios"),
    ],
)
def test_a_key_sets_the_parameter_of_its_name_as_its_type(tmp_path: Path, line: str, key: str, value: Any) -> None:
    document = read(tmp_path, line)
    assert params_of(document) == {key: value}
    assert type(params_of(document)[key]) is type(value)
    assert said(document) == []


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("\nrate = 2000", "config:2: `rate` is 2000; allowed: int, 1 to 1000"),
        ("speed = 0,5", "config:1: `speed` is '0,5'; allowed: float"),
        ("display = yes", "config:1: `display` is 'yes'; allowed: bool"),
        ("mode = fats", "config:1: `mode` is 'fats'; allowed: one of slow, fast; did you mean `fast`?"),
        ("# x\n\ndevize = x", "config:3: unknown parameter `devize`; did you mean `device`?"),
        (
            "name_0 = left",
            "config:1: unknown parameter `name_0`; known: device, rate, speed, display, mode, Arm_Reach, "
            "lidar_3, motors, cameras",
        ),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, text: str, wrong: str) -> None:
    assert said(read(tmp_path, text)) == [wrong]


# The form of 2025.

SECTIONS = """
speed = 2

[Proxies]
Laser = "laser:tcp -h localhost -p 10003"

[Endpoints]
LaserPubTopic = "tcp -p 0"
LaserPubPrefix = ""

[Period]
Compute = 50
Emergency = 500

[base]
device = "/dev/ttyUSB0"
display = true
[Ice]
Warn.Connections = "0"
"""
DOTTED = """
speed = 2
Proxies.Laser = "laser:tcp -h localhost -p 10003"
Endpoints.LaserPubTopic = "tcp -p 0"
Endpoints.LaserPubPrefix = ""
Period.Compute = 50   # ms
Period.Emergency = 500
base.device = "/dev/ttyUSB0"
base.display = True
Ice.Warn.Connections = "0"
"""


@pytest.mark.parametrize(("text", "name"), [(SECTIONS, "config.toml"), (SECTIONS, "config"), (DOTTED, "config")])
def test_both_ways_of_writing_of_2025_mean_the_same(tmp_path: Path, text: str, name: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    document = settings.read(path, PARAMS)
    checked = settings.check(Component("base", params=PARAMS), document)
    assert checked.period == 0.05
    assert {**checked.params, "motors": 0, "cameras": 0} == {
        **{"device": "/dev/ttyUSB0", "speed": 2.0, "display": True, "motors": 0, "cameras": 0},
        **{"rate": 10, "mode": "slow", "Arm_Reach": 1.0, "lidar_3": ""},
    }
    idle = [note.key for note in document.notes if not note.became]
    assert idle == [
        *("Proxies.Laser", "Endpoints.LaserPubTopic", "Endpoints.LaserPubPrefix", "Period.Emergency"),
        "Ice.Warn.Connections",
    ]
    assert document.text.splitlines()[document.line(("component", "period")) - 1].endswith(("= 50", "# ms"))


def test_an_invalid_period_is_reported_with_its_line(tmp_path: Path) -> None:
    [wrong] = said(read(tmp_path, "\nPeriod.Compute = -1"))
    assert wrong.startswith("config:2: `period` is -0.001; allowed: a positive number of seconds")


def test_sections_that_are_no_toml_are_said_with_their_place(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"config:2:11: invalid value"):
        read(tmp_path, "[Period]\nCompute = many")


# What has no effect, and what is not understood.


@pytest.mark.parametrize(
    "line",
    [
        *("Ice.MessageSizeMax=20004800", "Laser.Endpoints=tcp -p 10003", "LaserTopic.Endpoints=tcp -p 0"),
        *("LaserProxy = laser:tcp -p 1", "LaserProxy1 = laser:tcp -p 1", "TopicManager.Proxy=IceStorm/TopicManager"),
        *("CommonBehavior.Endpoints=tcp -p 0", "LoggerTopic=LoggerTopic", "Joystick=Joystick", "agent_id = 3"),
        *("2d_view = true", "Agent.name = x", "InnerModelPath = x.xml", "Component.Debug.Verbose = true"),
    ],
)
def test_what_is_for_ice_or_robocomp_is_noted_and_has_no_effect(tmp_path: Path, line: str) -> None:
    document = read(tmp_path, f"# x\n{line}")
    [note] = document.notes
    assert (note.key, note.line, note.became, note.understood) == (line.split("=")[0].strip(), 2, (), True)
    assert note.why
    assert (document.data, said(document)) == ({}, [])


def test_a_parameter_that_is_called_like_a_setting_of_ice_is_a_parameter(tmp_path: Path) -> None:
    declared = ParameterSet("base", (Parameter("UseProxy", BOOL, False), Parameter("agent_id", INT, 0)))
    document = read(tmp_path, "UseProxy = true\nagent_id = 7", declared)
    assert params_of(document) == {"UseProxy": True, "agent_id": 7}


def test_a_line_that_is_no_key_is_noted_and_left_out(tmp_path: Path) -> None:
    document = read(tmp_path, "This property is used by clients.\nrate = 5")
    assert [(note.line, note.understood, note.became) for note in document.notes] == [
        (1, False, ()),
        (2, True, ("params", "rate")),
    ]
    assert params_of(document) == {"rate": 5}


def test_of_a_key_that_is_there_twice_the_last_one_counts(tmp_path: Path) -> None:
    document = read(tmp_path, "rate = 5\nspeed = 1\nrate = 6")
    assert params_of(document)["rate"] == 6
    assert [(note.line, note.why) for note in document.notes if not note.became] == [
        (1, "set again in line 3, which counts")
    ]


def test_a_component_without_parameters_ignores_them_and_says_so(tmp_path: Path) -> None:
    path = tmp_path / "config"
    path.write_text("whatever = 1\n")
    document = settings.read(path)
    assert settings.check(Component("bare"), document).params == {}
    assert [note.why for note in document.notes] == ["a parameter, and the component has none (params in its .cdsl)"]


def test_old_files_are_not_always_utf8(tmp_path: Path) -> None:
    path = tmp_path / "config"
    path.write_bytes("# Dirección\r\ndevice = ñ\r\n".encode("latin-1"))
    assert settings.read(path, PARAMS).data == {"params": {"device": "ñ"}}


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="nothing: cannot be read: No such file"):
        settings.read(tmp_path / "nothing")


# Which form a file has.


@pytest.mark.parametrize(
    ("name", "text", "data"),
    [
        ("config.toml", 'namespace = "x"', {"namespace": "x"}),
        ("robot.conf", 'namespace = "x"', {"namespace": "x"}),
        ("config", "component.period = 0.5", {"component": {"period": 0.5}}),
        ("config", "[params]\nrate = 5", {"params": {"rate": 5}}),
        ("config.toml", "[params]\nrate = 5\n[Ice]\n", {"params": {"rate": 5}, "Ice": {}}),
        ("config", "rate = 5", {"params": {"rate": 5}}),
        ("config", 'device = "x"\nrate = 5', {"params": {"device": "x", "rate": 5}}),
        ("config.toml", "[Period]\nCompute = 20", {"component": {"period": 0.02}}),
    ],
)
def test_the_form_of_a_file_is_seen_in_it(tmp_path: Path, name: str, text: str, data: dict[str, Any]) -> None:
    (tmp_path / name).write_text(text)
    assert settings.read(tmp_path / name, PARAMS).data == data


def test_a_component_without_config_toml_reads_robocomps_file(tmp_path: Path) -> None:
    etc = tmp_path / "etc"
    etc.mkdir()
    assert settings.find(tmp_path) is None
    (etc / "config").write_text("")
    assert settings.find(tmp_path) == etc / "config"
    (etc / "config.toml").write_text("")
    assert settings.find(tmp_path) == etc / "config.toml"
