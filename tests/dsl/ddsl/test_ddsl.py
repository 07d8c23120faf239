"""What DDSL files say. What their networks come to is tested with the plan."""

from __future__ import annotations

import pytest

from robocomp_py.dsl.ddsl import model as m
from robocomp_py.dsl.ddsl.order import process_dependences, processes_of
from robocomp_py.dsl.ddsl.restarts import read_restart
from robocomp_py.dsl.ddsl.scope import host_of, meanings, restart_of
from robocomp_py.dsl.diagnostics import Report

from ..texts import FOLDER, rendered, workspace

NETWORK = """
import "camera.cdsl"; import "sub/base.cdsl";
Deployment house
{
    middleware zeromq;
    namespace robot/left;
    Component camera { };
    Component cam2 : camera
    {
        ip localhost;
        port 0x2710;
        config "etc/cam2.toml";
        dependences camera, base,;
        dependences other;
        middleware inproc;
        env DISPLAY ":0";
        env HOME "/root";
        args "--fast", "1";
        requires Laser1 from base;
        subscribesTo LaserPub from base;
        process vision;
        qos LaserPub(best_effort, depth 1,);
        qos publishes LaserPub1(sensor_data, deadline 0.5 s, liveliness automatic);
    };
    Component base { path "bin/base"; };
    Component other { };
};
"""


def deployment(text: str) -> m.Deployment:
    found = workspace(**{"net.ddsl": text})
    model = found.deployment(FOLDER / "net.ddsl")
    assert model is not None
    assert not found.report.diagnostics, rendered(found)
    return model


def instance(clauses: str) -> m.Instance:
    [only] = deployment(f"Deployment net {{ Component a {{ {clauses} }}; }};").instances
    return only


def test_a_deployment_is_read() -> None:
    model = deployment(NETWORK)
    assert [str(name) for name in model.imports] == ["camera.cdsl", "sub/base.cdsl"]
    assert (str(model.name), str(model.middleware), model.namespace) == ("house", "zeromq", "robot/left")
    camera, second, *_ = model.instances
    assert (str(camera.name), str(camera.component), camera.kind) == ("camera", "camera", None)
    assert (str(second.name), str(second.component)) == ("cam2", "camera")
    assert [str(x) for x in (second.ip, second.port, second.config, second.middleware, second.process)] == [
        *("localhost", "0x2710", "etc/cam2.toml", "inproc", "vision"),
    ]
    assert [str(each.path) for each in model.instances[2:]] == ["bin/base", "None"]
    assert [str(name) for name in second.dependences] == ["camera", "base", "other"]
    assert [(str(each.name), str(each.value)) for each in second.env] == [("DISPLAY", ":0"), ("HOME", "/root")]
    assert [str(name) for name in second.args] == ["--fast", "1"]
    assert [(str(each.verb), str(each.port), str(each.instance)) for each in second.wirings] == [
        ("requires", "Laser1", "base"),
        ("subscribesTo", "LaserPub", "base"),
    ]


@pytest.mark.parametrize(
    "address", ["localhost", "10.0.0.1", "::1", "fe80::1", "192.168.1.10", '"robot.local"', "robot", "abc::def:1"]
)
def test_an_address_is_a_name_or_a_number(address: str) -> None:
    assert str(instance(f"ip {address}; port 1;").ip) == address.strip('"')


def test_a_host_is_read() -> None:
    text = """
    host onboard
    { address "192.168.1.10"; user robot; port 22; workdir "/home/robot"; python "python3.12"; lost keep; };
    host base { address fe80::1; user "first.last"; };
    Component a { host onboard; };
    """
    model = deployment(f"Deployment net {{ {text} }};")
    onboard, base = model.hosts
    said = (onboard.address, onboard.user, onboard.port, onboard.workdir, onboard.python, onboard.lost)
    assert list(map(str, said)) == ["192.168.1.10", "robot", "22", "/home/robot", "python3.12", "keep"]
    assert (str(base.name), str(base.address), str(base.user), base.port, base.lost) == (
        *("base", "fe80::1", "first.last", None, None),
    )
    assert onboard.span.text.startswith("host onboard\n")
    assert str(model.instances[0].host) == "onboard"


def test_what_becomes_of_a_network_when_something_ends_is_read() -> None:
    text = "security lan; restart on_failure; escalation rest_for_one; Component a { };"
    model = deployment(f"Deployment net {{ {text} }};")
    assert (str(model.security), str(model.escalation)) == ("lan", "rest_for_one")
    assert model.restart is not None
    assert (str(model.restart.policy), model.restart.settings) == ("on_failure", ())
    only = instance("restart always(intensity 3, period 1 min); grace 500 ms;")
    assert only.restart is not None
    assert [str(each.name) for each in only.restart.settings] == ["intensity", "period"]
    assert only.restart.span.text == "restart always(intensity 3, period 1 min);"
    assert only.grace is not None
    assert only.grace.seconds == 0.5


def test_the_settings_of_a_restart_are_seconds_and_numbers() -> None:
    only = instance("restart always(intensity 3, period 1 min, delay 200 ms, max_delay 7);")
    assert only.restart is not None
    report = Report()
    expected = {"intensity": 3, "period": 60, "delay": 0.2, "max_delay": 7}
    assert read_restart(only.restart, report) == expected
    assert report.diagnostics == []


def test_a_program_that_is_there_already_is_read_with_its_arguments() -> None:
    only = instance("existing \"urg_node --frame 'base link'\";")
    assert str(only.existing) == "urg_node --frame 'base link'"
    assert only.program is only.existing
    assert only.notifies is None


def test_a_program_may_be_said_to_tell_when_it_is_ready() -> None:
    only = instance('existing "urg_node"; notifies;')
    assert only.notifies is not None
    assert only.notifies.span.text == "notifies;"


def test_an_unparsed_program_is_not_reported_as_missing_too() -> None:
    found = workspace(**{"net.ddsl": "Deployment net { Component a { existing sleep; notifies; }; };"})
    found.check(FOLDER / "net.ddsl")
    assert [each.code for each in found.report.diagnostics] == ["syntax"]


NESTED = """
Deployment house
{
    Component camera { };
    System left
    {
        host onboard;
        restart always;
        escalation one_for_all;
        System wrist
        {
            restart never;
            Component hand : gripper { dependences arm, camera, /left/arm, wrist/eye; process p; };
            Component eye { requires Laser from camera; host base; };
        };
        Component arm { dependences wrist/hand2, left/wrist/hand3; ip localhost; port 1; };
        Component hand2 { };
    };
    System right { Component arm { dependences left/arm, arm2; process p; }; Component arm2 { process p; }; };
    host onboard { address "10.0.0.1"; };
    host base { address "10.0.0.2"; };
};
"""


@pytest.fixture
def nested() -> m.Deployment:
    found = workspace(**{"net.ddsl": NESTED})
    model = found.deployment(FOLDER / "net.ddsl")
    assert model is not None
    return model


def test_instances_in_systems_have_full_names_and_keep_their_own(nested: m.Deployment) -> None:
    assert [(str(each.name), each.local, each.system) for each in nested.instances] == [
        ("camera", "camera", ()),
        ("left/wrist/hand", "hand", ("left", "wrist")),
        ("left/wrist/eye", "eye", ("left", "wrist")),
        ("left/arm", "arm", ("left",)),
        ("left/hand2", "hand2", ("left",)),
        ("right/arm", "arm", ("right",)),
        ("right/arm2", "arm2", ("right",)),
    ]
    assert [str(each.component) for each in nested.instances[:3]] == ["camera", "gripper", "eye"]
    assert [str(each.name) for each in nested.systems] == ["left", "left/wrist", "right"]
    assert nested.instances[1].name.span.text == "hand"


def test_names_in_systems_are_looked_up_from_the_inside_out(nested: m.Deployment) -> None:
    named = {str(each.name): [str(name) for name in each.dependences] for each in nested.instances}
    assert named["left/wrist/hand"] == ["left/arm", "camera", "left/arm", "left/wrist/eye"]
    assert named["right/arm"] == ["left/arm", "right/arm2"]
    assert named["left/arm"] == ["wrist/hand2", "left/wrist/hand3"]  # nobody has these: as they are written
    assert str(nested.instances[2].wirings[0].instance) == "camera"


def test_an_inner_name_is_meant_rather_than_an_outer_one_unless_it_begins_with_a_slash() -> None:
    known = ["arm", "left/arm", "left/wrist/arm"]
    assert meanings("arm", ("left", "wrist"), known) == ["left/wrist/arm", "left/arm", "arm"]
    assert meanings("left/arm", ("left",), known) == ["left/arm"]
    assert meanings("/arm", ("left",), known) == ["arm"]
    assert meanings("/wrist/arm", ("left",), known) == []


def test_what_a_system_says_holds_for_all_in_it_that_do_not_say_otherwise(nested: m.Deployment) -> None:
    found = {str(each.name): each for each in nested.instances}
    hosts = {name: str(host_of(nested, each)) for name, each in found.items()}
    assert hosts == {
        "camera": "None",
        "left/wrist/hand": "onboard",
        "left/wrist/eye": "base",
        "left/arm": "localhost",
        "left/hand2": "onboard",
        "right/arm": "None",
        "right/arm2": "None",
    }
    restarts = {name: said.policy.text for name, each in found.items() if (said := restart_of(nested, each))}
    assert restarts == {
        "left/wrist/hand": "never",
        "left/wrist/eye": "never",
        "left/arm": "always",
        "left/hand2": "always",
    }


def test_a_process_is_one_of_its_system(nested: m.Deployment) -> None:
    together = {name: [str(each.name) for each in some] for name, some in processes_of(nested).items()}
    assert together["left/wrist/p"] == ["left/wrist/hand"]
    assert together["right/p"] == ["right/arm", "right/arm2"]


def test_a_qos_is_that_of_a_port_whatever_its_component_says() -> None:
    bare, told = deployment(NETWORK).instances[1].qos
    assert (bare.verb, str(bare.port), [str(each.name) for each in bare.settings]) == (
        *(None, "LaserPub", ["best_effort", "depth"]),
    )
    assert (str(told.verb), str(told.port)) == ("publishes", "LaserPub1")
    _, deadline, liveliness = told.settings
    assert deadline.amount is not None
    assert (deadline.amount.seconds, str(liveliness.word)) == (0.5, "automatic")


def test_instances_that_name_a_process_share_it() -> None:
    first, second = "Component a { process p; dependences c; };", "Component b { process p; };"
    model = deployment(f"Deployment net {{ {first} Component c {{}}; {second} }};")
    assert {name: [str(each.name) for each in together] for name, together in processes_of(model).items()} == {
        "p": ["a", "b"],
        "c": ["c"],
    }
    waits = {name: list(map(str, others)) for name, others in process_dependences(model).items()}
    assert waits == {"p": ["c"], "c": []}


def test_a_model_knows_where_everything_stands() -> None:
    model = deployment(NETWORK)
    second = model.instances[1]
    assert model.span.text.startswith("Deployment house")
    assert second.span.text.startswith("Component cam2 : camera")
    spans = [each.span for each in second.wirings]
    spans += [each.span for each in second.env]
    spans += [each.span for each in second.qos]
    assert [span.text for span in spans] == [
        "requires Laser1 from base;",
        "subscribesTo LaserPub from base;",
        'env DISPLAY ":0";',
        'env HOME "/root";',
        "qos LaserPub(best_effort, depth 1,);",
        "qos publishes LaserPub1(sensor_data, deadline 0.5 s, liveliness automatic);",
    ]


def test_the_components_of_a_network_are_the_files_it_imports() -> None:
    found = workspace(**{"net.ddsl": 'import "a.cdsl"; import "b"; Deployment net { };', "a.cdsl": "", "b.cdsl": ""})
    assert found.components_of(FOLDER / "net.ddsl") == [FOLDER / "a.cdsl", FOLDER / "b.cdsl"]
