"""Instances in systems: their peers and their names."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocomp_py.deploy.plan import Overrides
from robocomp_py.deploy.policy import Escalation

from .planned import command, errors, planned

TWO_ARMS = """
namespace robot1;
Component sensor { };
System left { restart always; escalation one_for_all; Component sensor { }; Component driver { }; };
System right { Component driver { }; System inner { Component driver { }; Component sensor { }; }; };
"""


def test_an_instance_uses_what_its_own_system_has_and_else_what_those_around_it_have(folder: Path) -> None:
    found = planned(folder, TWO_ARMS)
    assert [(each.client, each.provider) for each in found.links if each.interface == "Laser"] == [
        ("left/driver", "left/sensor"),
        ("right/driver", "right/inner/sensor"),
        ("right/inner/driver", "right/inner/sensor"),
    ]
    one = "Component sensor { }; System left { System wrist { Component driver { }; }; };"
    assert {(each.client, each.provider) for each in planned(folder, one).links} == {("left/wrist/driver", "sensor")}


def test_systems_are_part_of_the_namespace_of_channels(folder: Path) -> None:
    found = planned(folder, TWO_ARMS)
    assert "--name sensor --set namespace=robot1/left " in command(found, "left/sensor") + " "
    assert "--name driver --set namespace=robot1/right/inner " in command(found, "right/inner/driver")
    assert "--name sensor --set namespace=robot1 " in command(found, "sensor") + " "
    bare = planned(folder, "Component sensor { }; System left { Component driver { }; };")
    assert "--set namespace= " in command(bare, "sensor") + " ", "whatever its own configuration says"


def test_an_instance_of_another_system_is_named_with_its_namespace(folder: Path) -> None:
    found = planned(folder, TWO_ARMS)
    assert "ports.laser.from=sensor" in command(found, "left/driver")
    assert "ports.laser.from=/robot1/right/inner/sensor/Laser" in command(found, "right/driver")


def test_a_subscriber_of_several_systems_is_given_each_of_their_publishers(folder: Path) -> None:
    body = """
    System left { Component sensor { }; };
    System right { Component sensor { }; };
    Component driver { requires Laser from left/sensor; };
    """
    found = command(planned(folder, body), "driver")
    assert "ports.LaserPub.from=/left/sensor/LaserPub" in found
    assert 'from = "/right/sensor/LaserPub"' in found
    ways = {(way.provider, way.interface) for way in planned(folder, body).ways}
    assert ways == {("left/sensor", "Laser"), ("left/sensor", "LaserPub"), ("right/sensor", "LaserPub")}


def test_a_process_belongs_to_its_system_and_has_its_full_name(folder: Path) -> None:
    body = """
    System left { Component sensor { process p; }; Component driver { process p; dependences sensor; }; };
    System right { Component sensor { process p; }; };
    """
    left, right = planned(folder, body).processes
    assert (left.name, left.instances, left.system) == ("left/p", ("left/sensor", "left/driver"), ("left",))
    assert (right.name, right.instances) == ("right/p", ("right/sensor",))
    assert "--name driver --after sensor --set namespace=left" in " ".join(left.command)


def test_the_start_order_crosses_systems(folder: Path) -> None:
    body = """
    System left { Component driver { dependences right/sensor, sensor; requires Laser from sensor; }; };
    System right { Component sensor { }; };
    Component sensor { };
    """
    found = planned(folder, body)
    assert [(each.name, each.after) for each in found.processes] == [
        ("right/sensor", ()),
        ("sensor", ()),
        ("left/driver", ("right/sensor", "sensor")),
    ]


def test_what_a_system_says_holds_for_those_in_it(folder: Path) -> None:
    found = planned(folder, TWO_ARMS)
    assert {each.name: str(each.restart.when) for each in found.processes} == {
        "sensor": "never",
        "left/sensor": "always",
        "left/driver": "always",
        "right/driver": "never",
        "right/inner/driver": "never",
        "right/inner/sensor": "never",
    }
    assert found.escalations == {("left",): Escalation.ONE_FOR_ALL}


def test_the_command_line_names_an_instance_by_its_full_name(folder: Path) -> None:
    overrides = Overrides(settings=(("left/sensor", "params.range=5"),))
    found = planned(folder, TWO_ARMS, overrides)
    assert "params.range=5" in command(found, "left/sensor")
    assert "params.range=5" not in command(found, "sensor")
    wrong = Overrides(settings=(("left/sensr", "params.range=5"),))
    assert errors(folder, TWO_ARMS, wrong) == ["unknown-instance"]


def test_all_namespaces_can_still_be_changed_at_once(folder: Path) -> None:
    overrides = Overrides(settings=(("*", "namespace=robot2"),))
    body = "namespace robot1; Component sensor { }; Component driver { };"
    assert errors(folder, body, overrides) == []


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (
            "System a { Component sensor { }; }; System b { Component sensor { }; }; Component driver { };",
            ["ambiguous-provider"],
        ),
        (
            "System a { Component sensor { }; Component more : sensor { }; Component driver { }; };",
            ["ambiguous-provider"],
        ),
        ("System a { Component driver { requires Laser from b/sensor; }; };", ["unknown-instance"]),
        ("System a { Component sensor { }; System b { Component recorder { }; }; };", ["qos-mismatch"]),
        ("System a { Component driver { }; };", ["no-provider"]),
        (
            "middleware zeromq; System a { Component sensor { }; }; Component driver { middleware dds; };",
            ["middleware-mismatch"],
        ),
        ("System a { Component sensor { dependences /driver; }; Component x : driver { }; };", ["unknown-instance"]),
        (
            "System a { Component x : driver { dependences b/y; }; }; System b { Component y : driver "
            "{ dependences a/x; }; }; Component sensor { };",
            ["dependence-cycle"],
        ),
        ("System a { Component sensor { process p; }; Component p : driver { }; };", ["duplicate"]),
    ],
)
def test_what_is_wrong_between_systems_is_found(folder: Path, body: str, expected: list[str]) -> None:
    assert sorted(set(errors(folder, body))) == expected
