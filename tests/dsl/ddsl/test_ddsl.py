"""What DDSL files say. What their networks come to is tested with the plan."""

from __future__ import annotations

import pytest

from robocomp_py.dsl.ddsl import model as m
from robocomp_py.dsl.ddsl.order import process_dependences, processes_of

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


@pytest.mark.parametrize(
    "clause",
    [
        "host onboard;",
        "restart on_failure;",
        "restart always 5;",
        'existing "ls", "-l";',
        'host onboard { address "192.168.1.10"; user "robot"; };',
        "System left { Component arm { path x; } }",
    ],
)
def test_words_that_are_spoken_for_are_read_and_listed(clause: str) -> None:
    assert [str(word) for word in instance(clause).later] == [clause.split()[0]]
    assert [str(word) for word in deployment(f"Deployment net {{ {clause} }};").later] == [clause.split()[0]]


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
