"""Configuration: what it means, and what is said when it is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.middleware import carrier, is_auto
from robocomp_py.contract.parameters import Parameter, ParameterKind, ParameterList, ParameterSet
from robocomp_py.contract.qos import Durability, QoS, Reliability
from robocomp_py.errors import ConfigurationError
from robocomp_py.runtime.settings import (
    DEADLINE,
    Document,
    Settings,
    Way,
    check,
    environment,
    middlewares,
    override,
    read,
    settle,
)
from robocomp_py.testing import everything as e

MOTORS = ParameterList(
    "motors",
    ParameterSet("motors", (Parameter("name", ParameterKind.STRING, ""), Parameter("id", ParameterKind.INT, 0, 0, 9))),
    1,
    2,
)
PARAMS = ParameterSet(
    "robot",
    (
        Parameter("max_speed", ParameterKind.FLOAT, 0.5, 0.0, 2.0),
        Parameter("device", ParameterKind.STRING, "", mandatory=True),
        Parameter("mode", ParameterKind.ENUM, "slow", choices=("slow", "fast")),
        Parameter("verbose", ParameterKind.BOOL, False),
    ),
    (MOTORS,),
)
REQUIRES = Port(Verb.REQUIRES, e.EVERYTHING)
ROBOT = Component("Robot", (REQUIRES, Port(Verb.SUBSCRIBES, e.EVERYTHING)), PARAMS, 0.1)
GOOD = 'params.device = "x"\nparams.motors = [{ name = "left" }]\n'


def document_of(tmp_path: Path, text: str) -> Document:
    path = tmp_path / "config.toml"
    path.write_text(text)
    return read(path)


def load(tmp_path: Path, text: str, *sets: str, component: Component = ROBOT) -> Settings:
    document = document_of(tmp_path, text)
    for assignment in sets:
        override(document, assignment)
    return check(component, document)


def test_without_a_word_everything_has_its_default() -> None:
    settings = check(Component("Robot", (REQUIRES,), period=0.2), Document())
    assert settings == Settings("robot", period=0.2)
    found = settings.port(REQUIRES, "work")
    assert (found.source, found.deadline, found.middleware, found.qos) == ("", DEADLINE, None, QoS())


def test_what_the_file_says_holds(tmp_path: Path) -> None:
    settings = load(
        tmp_path,
        """
namespace = "robot1/arm"
middleware = "zeromq"
[component]
period = 0.05
log = "debug"
startup_timeout = 3
[params]
device = "/dev/tty"
max_speed = 1
[[params.motors]]
name = "left"
[[params.motors]]
name = "right"
id = 7
[ports.everything]
from = "world"
deadline = 0.5
[ports.everything.work]
middleware = "inproc"
deadline = 9
[ports.Everything]
qos = { reliability = "reliable", depth = 1 }
[transports.zeromq]
bind = "tcp://127.0.0.1:5555"
""",
    )
    assert (settings.namespace, settings.middleware, settings.period) == ("robot1/arm", "zeromq", 0.05)
    assert (settings.log, settings.startup_timeout) == ("debug", 3.0)
    assert settings.params["max_speed"] == 1.0
    assert isinstance(settings.params["max_speed"], float)
    assert settings.params["motors"] == [{"name": "left", "id": 0}, {"name": "right", "id": 7}]
    work, divide = settings.port(REQUIRES, "work"), settings.port(REQUIRES, "divide")
    assert (work.source, work.middleware, work.deadline) == ("world", "inproc", 9.0)
    assert (divide.source, divide.middleware, divide.deadline) == ("world", "zeromq", 0.5)
    assert settings.port(ROBOT.ports[1], "news").qos == QoS(Reliability.RELIABLE, depth=1)
    assert settings.transports == {"zeromq": {"bind": "tcp://127.0.0.1:5555"}}


def test_a_qos_may_be_a_preset(tmp_path: Path) -> None:
    settings = load(tmp_path, GOOD + 'ports.Everything.qos = "latched"')
    qos = settings.port(ROBOT.ports[1], "news").qos
    assert qos == QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=1)


def test_set_overrides_the_file_in_toml_or_as_plain_text(tmp_path: Path) -> None:
    settings = load(
        tmp_path,
        GOOD,
        "params.max_speed=1.5",
        "params.motors[0].id=3",
        "middleware=inproc",
        "params.verbose=true",
        "component.period = 2",
        "ports.everything.work.deadline=0.1",
        "params.device=/dev/a=b",
    )
    assert (settings.params["max_speed"], settings.params["motors"][0]["id"]) == (1.5, 3)
    assert (settings.middleware, settings.params["verbose"], settings.period) == ("inproc", True, 2.0)
    assert settings.port(REQUIRES, "work").deadline == 0.1
    assert settings.params["device"] == "/dev/a=b"


WRONG = {
    "params.max_speed = 3": r":4: `max_speed` is 3; allowed: float, 0.0 to 2.0",
    "params.max_speed = nan": r":4: `max_speed` is nan; allowed",
    'params.max_speed = "fast"': r":4: `max_speed` is 'fast'; allowed: float",
    "params.max_sped = 1": r":4: unknown parameter `max_sped`; did you mean `max_speed`",
    'params.mode = "fats"': r":4: `mode` is 'fats'; allowed: one of slow, fast; did you mean `fast`",
    "params.verbose = 1": r":4: `verbose` is 1; allowed: bool",
    "component.period = 0": r":4: `period` is 0; allowed: a positive number of seconds",
    "component.period = inf": r":4: `period` is inf; allowed",
    "component.perod = 1": r":4: unknown key `perod`; did you mean `period`",
    'component.log = "loud"': r":4: `log`: unknown value `loud`; known: debug, info, warning, error",
    "component = 3": r":4: `component` must be a table, not 3",
    "middleware = 3": r":4: `middleware` must be a string, not 3",
    'namespace = "a b"': r":4: 'a b' is not a namespace",
    'ports.lasr = { from = "x" }': r":4: unknown port `lasr`; known: everything, Everything",
    'ports.everything.from = "a/b/c"': r":4: 'a/b/c' has too many parts",
    "ports.everything.deadline = -1": r":4: `deadline` is -1; allowed",
    "ports.everything.wrok = {}": r":4: unknown key `wrok`; did you mean `work`",
    "ports.Everything.qos = { depth = 0 }": r":4: `depth` is 0; allowed: 1 to",
    "ports.Everything.qos = { reliable = true }": r":4: unknown key `reliable`; did you mean `reliability`",
    'ports.everything.also = ["shm"]': r":4: `also` has no meaning for a required interface",
    'ports.Everything.also = "zeromq"': r":4: `also` must be a list of middlewares, as in",
    "ports.Everything.also = [3]": r":4: an item must be a middleware or a table, not 3",
    'ports.Everything.also = [{ form = "x" }]': r":4: unknown key `form`; did you mean `from`",
    'ports.Everything.also = [{ from = "a/b/c" }]': r":4: 'a/b/c' has too many parts",
    'ports.Everything.qos = "sensordata"': r":4: unknown QoS preset `sensordata`; did you mean `sensor_data`",
    "ports.Everything.qos = 3": r":4: `qos` must be a table or the name of a preset",
    "component.period = 1e300": r":4: `period` is 1e[+]300; allowed: a positive number of seconds, at most 1e[+]06",
    "transports.zermq = {}": r":4: unknown key `zermq`; did you mean `zeromq`",
    "surprise = 1": r":4: unknown key `surprise`",
}


@pytest.mark.parametrize("line", WRONG)
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, line: str) -> None:
    with pytest.raises(ConfigurationError, match=r"config\.toml" + WRONG[line]):
        load(tmp_path, f"{GOOD}\n{line}\n")


def test_all_complaints_come_at_once_each_with_its_line(tmp_path: Path) -> None:
    text = """
[component]
period = -1

[params]
max_speed = 9
[[params.motors]]
id = 99
[[params.motors]]
id = 5
nam = "x"
[[params.motors]]
"""
    with pytest.raises(ConfigurationError) as caught:
        load(tmp_path, text)
    lines = sorted(line.removeprefix(f"{tmp_path}/config.toml:") for line in str(caught.value).splitlines())
    assert [line.split(":")[0] for line in lines] == ["11", "3", "5", "6", "7", "8"]
    assert "`device` is mandatory: give it (string)" in str(caught.value)
    assert "3 items of `motors`; allowed: 1 to 2" in str(caught.value)


def test_parameters_that_are_no_table_are_not_missed_one_by_one(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"^--set params=3: `params` must be a table, not 3$"):
        load(tmp_path, GOOD, "params=3")


def test_a_wrong_set_is_said_as_it_was_written(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"^--set params\.max_speed=7: `max_speed` is 7"):
        load(tmp_path, GOOD, "params.max_speed=7")


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("params.max_speed", "not key=value"),
        ("=3", "not key=value"),
        ("params.motors[5].id=1", r"there is no item params\.motors\[5\]"),
        ("params.device.x=1", r"params\.device is not a table"),
        ("a b=1", "`a b` is not a valid key"),
    ],
)
def test_a_set_that_makes_no_sense_is_refused(tmp_path: Path, assignment: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        load(tmp_path, GOOD, assignment)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"a = 1\nb = = 2\n", r"config\.toml:2:5: invalid value"),
        (b"a = 'x", r"config\.toml:1"),
        (b"a = 1\na = 2\n", r"config\.toml:2:6: `a` is set twice"),
        (b"[a]\nb.c = 1\n[a.b]\n", r"config\.toml:3:5: the table `a\.b` is defined twice"),
        (b"\xff\xfe", "is not UTF-8 text"),
    ],
)
def test_invalid_toml_is_reported_with_its_place(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "config.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match=message):
        read(path)


@pytest.mark.parametrize(
    ("value", "hint"),
    [
        ("Hello you  # or me", '    text needs quotes: "Hello you"'),
        ("/dev/ttyUSB0", '    text needs quotes: "/dev/ttyUSB0"'),
        ("[slow, fast]", '    text needs quotes: "slow"'),
        ("True", "    did you mean `true`?"),
        ("= 2", ""),
    ],
)
def test_a_text_without_quotes_is_shown_with_its_quotes(tmp_path: Path, value: str, hint: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(f"[params]\ngreeting = {value}\n")
    with pytest.raises(ConfigurationError) as caught:
        read(path)
    place, line, caret, *told = str(caught.value).split("\n")
    assert line == f"    greeting = {value}"
    assert line[caret.index("^") :].startswith(value.lstrip("["))
    assert place == f"{path}:2:{caret.index('^') - 3}: invalid value"
    assert told == ([hint] if hint else [])


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"nothing\.toml: cannot be read: No such file"):
        read(tmp_path / "nothing.toml")
    with pytest.raises(ConfigurationError, match="cannot be read: Is a directory"):
        read(tmp_path)


def test_an_instance_name_has_to_fit_into_channels() -> None:
    with pytest.raises(ConfigurationError, match="'two words' is not a name for an instance"):
        check(Component("Robot"), Document(), "two words")


@pytest.mark.parametrize(
    ("named", "carried"),
    [(None, "zeromq"), ("auto", "zeromq"), ("auto(dds)", "dds"), ("auto( zenoh )", "zenoh"), ("dds", "dds")],
)
def test_what_is_left_to_the_deployment_is_carried_by_what_can_always_be_reached(
    named: str | None, carried: str
) -> None:
    assert carrier(named, "zeromq") == carried
    assert is_auto(named) == (named != "dds")


def test_further_ways_are_beside_the_first(tmp_path: Path) -> None:
    port = ROBOT.ports[1]
    text = GOOD + 'ports.Everything.also = ["dds", { from = "other" }, { middleware = "inproc", from = "third" }]'
    settings = load(tmp_path, text, "middleware=auto(zenoh)")
    assert settings.port(port, "work").also == (Way("dds"), Way(None, "other"), Way("inproc", "third"))
    assert settings.middlewares(port, "work", "zeromq") == ["zenoh", "dds", "zenoh", "inproc"]


def test_every_middleware_that_is_named_can_be_checked(tmp_path: Path) -> None:
    text = 'middleware = "auto"\n' + GOOD + 'ports.Everything.also = ["dsd"]\nports.Everything.middleware = "auto(x)"'
    named = middlewares(load(tmp_path, text))
    assert named == {("ports", "Everything", "middleware"): "x", ("ports", "Everything", "also", 0): "dsd"}


def test_an_older_name_of_a_key_is_accepted_and_told(tmp_path: Path) -> None:
    document = document_of(tmp_path, GOOD + "component.patience = 3\n")
    settle(document, ROBOT, "inproc")
    assert check(ROBOT, document).startup_timeout == 3.0
    assert [each.message for each in document.renamed] == ["`patience` is called `startup_timeout` now"]
    assert document.line(("component", "startup_timeout")) == document.text.count("\n")


def test_the_present_name_of_a_key_holds_over_the_older_one(tmp_path: Path) -> None:
    document = document_of(tmp_path, GOOD + "component = { patience = 3, startup_timeout = 4 }\n")
    settle(document, ROBOT, "inproc")
    assert check(ROBOT, document).startup_timeout == 4.0


def test_a_key_set_under_its_older_name_holds_over_the_file(tmp_path: Path) -> None:
    document = document_of(tmp_path, GOOD + "component.startup_timeout = 4\n")
    override(document, "component.patience=3")
    environment(document, ROBOT, {"ROBOCOMP__COMPONENT__PATIENCE": "2"})
    settle(document, ROBOT, "inproc")
    assert check(ROBOT, document).startup_timeout == 2.0
    assert [each.origin for each in document.renamed] == [
        "--set component.patience=3",
        "environment variable ROBOCOMP__COMPONENT__PATIENCE",
    ]
