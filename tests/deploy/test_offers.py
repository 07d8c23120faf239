"""Named instances of a component, as its network declares them."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.deploy.keys import graph_of
from robocomp_py.deploy.plan import Overrides, Plan
from robocomp_py.deploy.planner import make_plan
from robocomp_py.dsl.diagnostics import Diagnostic
from robocomp_py.dsl.workspace import Workspace

from .planned import command

RING = """
import "Laser.idsl"; import "LaserPub.idsl"; import "Speech.idsl";
Component ring { Communications { implements Laser each, Speech; publishes LaserPub each; }; language python; };
"""
USER = """
import "Laser.idsl"; import "LaserPub.idsl";
Component user { Communications { requires Laser; subscribesTo LaserPub; }; language python; };
"""
SENSOR = """
import "Laser.idsl"; import "LaserPub.idsl";
Component sensor { Communications { implements Laser; publishes LaserPub; }; language python; };
"""


ROBOT = """
import "Laser.idsl"; import "LaserPub.idsl"; import "Speech.idsl";
Component robot { Communications { implements Laser each, Speech each; publishes LaserPub each; }; language python; };
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("offers")
    for name, text in (("ring", RING), ("user", USER), ("sensor", SENSOR), ("robot", ROBOT)):
        (root / name).mkdir()
        (root / name / f"{name}.cdsl").write_text(text)
        assert rcgen([str(root / name / f"{name}.cdsl")]) == 0
    return root


def plan(folder: Path, body: str, overrides: Overrides | None = None) -> tuple[Plan | None, list[Diagnostic]]:
    path = folder / "net.ddsl"
    imports = "".join(f'import "{name}/{name}.cdsl";\n' for name in ("ring", "user", "sensor", "robot"))
    path.write_text(f"{imports}Deployment net {{\n{body}\n}};\n")
    workspace = Workspace()
    return make_plan(path, workspace, overrides), workspace.report.diagnostics


def planned(folder: Path, body: str, overrides: Overrides | None = None) -> Plan:
    found, diagnostics = plan(folder, body, overrides)
    assert found is not None, diagnostics
    return found


def told(folder: Path, body: str) -> list[str]:
    """All that is said of a network: line, code, message and hint."""
    _, diagnostics = plan(folder, body)
    lines = [each.span.source.position(each.span.start)[0] - 5 for each in diagnostics]
    return [f"{line}: {each.code}: {each.message} ({each.hint})" for line, each in zip(lines, diagnostics, strict=True)]


TWO = "Component ring { offers front : Laser, LaserPub; offers back : Laser, LaserPub; };"


@pytest.mark.parametrize("name", ["front", "ring/front", "/front", "/ring/front"])
def test_a_named_instance_is_used_like_a_component_of_that_name(folder: Path, name: str) -> None:
    found = planned(
        folder, TWO + f"Component user {{ requires Laser from {name}; subscribesTo LaserPub from {name}; }};"
    )
    words = command(found, "user")
    assert "ports.laser.from=front" in words
    assert "ports.LaserPub.from=front" in words
    assert [(link.interface, link.source) for link in found.links] == [
        ("Laser", "ring/front"),
        ("LaserPub", "ring/front"),
    ]
    assert {way.channel.rpartition("/")[0] for way in found.ways} == {"front/Laser", "front/LaserPub"}
    assert {(way.provider, way.named) for way in found.ways} == {("ring", "front")}


def test_a_real_driver_and_a_named_instance_are_exchanged_by_one_line(folder: Path) -> None:
    user = "Component user { requires Laser from front; subscribesTo LaserPub from front; };"
    simulated = planned(folder, "Component ring { offers front : Laser, LaserPub; };" + user)
    real = planned(folder, "Component front : sensor { };" + user)
    assert command(simulated, "user") == command(real, "user")
    assert {way.channel for way in simulated.ways} == {way.channel for way in real.ways}


def test_the_component_is_told_what_the_network_declares(folder: Path) -> None:
    words = command(planned(folder, "Component ring { offers front : Laser, LaserPub; offers back : Laser; };"), "ring")
    for part in ("offers={}", "offers.front.Laser={}", "offers.front.laserpub={}", "offers.back.Laser={}"):
        assert f"--set {part}" in words
    assert "offers.back.laserpub" not in words


def test_the_only_named_instance_is_found_without_a_wiring(folder: Path) -> None:
    found = planned(folder, "Component ring { offers front : Laser, LaserPub; }; Component user { };")
    assert "ports.laser.from=front" in command(found, "user")
    assert found.processes[1].ready_after == ("ring",)


def test_subscribers_without_a_wiring_hear_all_named_instances(folder: Path) -> None:
    found = planned(folder, TWO + "Component user { requires Laser from back; };")
    heard = [link.source for link in found.links if link.interface == "LaserPub"]
    assert heard == ["ring/front", "ring/back"]


def test_a_component_may_offer_its_own_name_and_what_it_provides_otherwise(folder: Path) -> None:
    found = planned(folder, "Component ring { offers ring : Laser; }; Component user { requires Laser from ring; };")
    assert {way.channel.rpartition("/")[0] for way in found.ways} == {"ring/Laser"}


def test_in_a_system_a_named_instance_stands_beside_its_component(folder: Path) -> None:
    body = """
    System left { Component ring { offers front : Laser; }; Component near : user { requires Laser from front; }; };
    Component far : user { requires Laser from left/ring/front; };
    """
    found = planned(folder, body)
    assert {way.channel.rpartition("/")[0] for way in found.ways} == {"left/front/Laser"}
    assert "ports.laser.from=front" in command(found, "left/near")
    assert "ports.laser.from=/left/front/Laser" in command(found, "far")


def test_the_middleware_of_a_link_is_offered_by_that_named_instance_alone(folder: Path) -> None:
    body = TWO + "Component user { requires Laser from back middleware dds; subscribesTo LaserPub from front; };"
    words = command(planned(folder, body), "ring")
    assert 'offers.back.Laser.also=["dds"]' in words
    assert "offers.front.Laser.also" not in words


def test_the_allow_list_has_the_channels_of_the_named_instances(folder: Path) -> None:
    graph = graph_of(
        planned(folder, TWO + "Component user { requires Laser from back; subscribesTo LaserPub from front; };")
    )
    (ring,) = (each for each in graph.principals if each.name == "ring")
    assert set(ring.channels) == {"back", "front"}
    used = {edge.channel.rpartition("/")[0] for edge in graph.uses("user")}
    assert used == {"back/Laser", "front/LaserPub"}


@pytest.mark.tool
def test_a_named_instance_is_served_over_ice_at_its_own_port(folder: Path) -> None:
    body = """
    Component ring { port 10001; offers front : Laser port 10003; offers back : Laser port 10004; };
    Component user { requires Laser from front; };
    """
    words = command(planned(folder, body, Overrides("ice")), "ring")
    assert 'transports.ice.endpoints.Speech="tcp -p 10001"' in words
    assert 'transports.ice.endpoints."front/Laser"="tcp -p 10003"' in words
    assert 'transports.ice.endpoints."back/Laser"="tcp -p 10004"' in words


@pytest.mark.tool
def test_a_program_finds_a_named_instance_over_ice_at_its_port(folder: Path) -> None:
    body = """
    Component ring { offers front : Laser port 10003; };
    Component user { existing "true"; requires Laser from front; };
    """
    assert [way.middleware for way in planned(folder, body, Overrides("ice")).ways] == ["ice"] * 3


def test_what_the_component_does_not_provide_by_name_is_told(folder: Path) -> None:
    assert told(
        folder,
        """Component ring { offers front : Speech, Lasr; offers back : RGBD, Laser; };
        Component sensor { offers side : Laser; };""",
    ) == [
        "1: wrong-offers: `ring` provides `Speech` by its own name only (write in its CDSL: implements Speech each)",
        "1: wrong-offers: `ring` has no named instances of `Lasr` (did you mean `Laser`?)",
        "1: wrong-offers: `ring` has no named instances of `RGBD` (it has: Laser, LaserPub)",
        "2: wrong-offers: `sensor` provides `Laser` by its own name only (write in its CDSL: implements Laser each)",
    ]


def test_a_network_that_declares_no_named_instance_is_told_so(folder: Path) -> None:
    assert told(folder, "Component ring { };") == [
        "1: missing-offers: `ring` has named instances of `Laser`, `LaserPub`, but the network declares none "
        "(write in its block, for example: offers front : Laser;)"
    ]


def test_a_configuration_may_not_declare_what_the_network_does_not(folder: Path) -> None:
    body = "Component ring { offers front : Laser; };"
    _, diagnostics = plan(folder, body, Overrides(settings=(("ring", "offers.rear.Laser.middleware=shm"),)))
    (error,) = diagnostics
    assert error.code == "config-unknown-key"
    assert error.message.endswith(
        "the network does not declare `rear`; write in the block of `ring`: offers rear : Laser; (for `ring`)"
    )


def test_a_configuration_may_set_what_the_network_declares(folder: Path) -> None:
    body = "Component ring { offers front : Laser; }; Component user { requires Laser from front; };"
    found = planned(folder, body, Overrides(settings=(("ring", "offers.front.Laser.middleware=zeromq"),)))
    assert {way.middleware for way in found.ways} == {"zeromq"}


@pytest.mark.parametrize(
    ("wiring", "message"),
    [
        (
            "requires Laser from ring;",
            "`ring` does not implement `Laser` (requires Laser from front; or requires Laser from back;)",
        ),
        (
            "subscribesTo LaserPub from left;",
            "`left` does not publish `LaserPub` (write in the block of `ring`: offers left : Laser, LaserPub;)",
        ),
    ],
)
def test_a_wiring_to_what_a_name_does_not_provide_is_told(folder: Path, wiring: str, message: str) -> None:
    body = f"""Component ring {{ offers front : Laser; offers back : Laser; offers left : Laser; }};
    Component user {{ requires Laser from left; {wiring} }};"""
    if "requires" in wiring:
        body = body.replace("offers left : Laser;", "").replace("requires Laser from left;", "")
    assert told(folder, body)[0] == f"2: no-provider: {message}"


@pytest.mark.parametrize(
    ("wiring", "line"),
    [
        ("", "2: no-provider: `user` requires `Laser`, which no component implements"),
        ("requires Laser from ring;", "2: no-provider: `ring` does not implement `Laser`"),
    ],
)
def test_where_only_the_offers_clause_is_missing_that_clause_is_proposed(folder: Path, wiring: str, line: str) -> None:
    body = f"Component ring {{ }};\nComponent user {{ {wiring} }};"
    hint = "(write in the block of `ring`: offers front : Laser;)"
    assert f"{line} {hint}" in told(folder, body)


@pytest.mark.parametrize(
    ("clauses", "proposed"),
    [
        ("offers mouth : Speech;", "offers laser : Laser;"),
        ("offers mouth : Speech; offers top : LaserPub;", "offers top : LaserPub, Laser;"),
        ("offers laser : Speech;", "offers front : Laser;"),
    ],
)
def test_a_missing_clause_is_not_proposed_as_a_part_of_that_of_another_device(
    folder: Path, clauses: str, proposed: str
) -> None:
    body = f"Component robot {{ {clauses} }};\nComponent user {{ }};"
    line = "2: no-provider: `user` requires `Laser`, which no component implements"
    assert f"{line} (write in the block of `robot`: {proposed})" in told(folder, body)


def test_without_an_instance_that_could_offer_it_a_component_is_proposed(folder: Path) -> None:
    (line, *_) = told(folder, "Component user { };")
    assert line.endswith("(write `Component ring { };` or `Component sensor { };` or `Component robot { };`)")


def test_several_named_instances_need_a_choice(folder: Path) -> None:
    (line, *_) = told(folder, TWO + "\nComponent user { };")
    assert line.startswith("2: ambiguous-provider: several instances implement `Laser` for `user`: `front`, `back`")
