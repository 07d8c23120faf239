"""A network is checked whole before anything starts."""

from __future__ import annotations

import os
import sys
from importlib.metadata import Distribution, DistributionFinder
from pathlib import Path

import pytest

from robocomp_py import installed
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.deploy.plan import OpenedTransport, Overrides
from robocomp_py.deploy.planner import make_plan
from robocomp_py.dsl.workspace import Workspace

from ..remembered import entry_points
from .planned import PARAMS, SENSOR, command, errors, plan

CARRIER = """
from robocomp_py.transports.base import Capability
class Carrier:
    capabilities = ~Capability.CROSS_HOST  # it does not leave this machine
"""


@pytest.fixture
def carrier(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A second middleware that could carry a network, installed as third parties do."""
    metadata = tmp_path / "installed" / "carrier-1.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Name: carrier\nVersion: 1\n")
    (metadata / "entry_points.txt").write_text("[robocomp_py.transports]\ncarrier = carrier_of_test:Carrier\n")
    (metadata.parent / "carrier_of_test.py").write_text(CARRIER)
    monkeypatch.syspath_prepend(metadata.parent)
    return "carrier"


@pytest.fixture
def looked_through(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Grows by one at each scan of all installed packages."""
    times: list[object] = []

    class Finder(DistributionFinder):
        def find_spec(self, *_: object) -> None:
            return None

        def find_distributions(self, context: object = None) -> list[Distribution]:
            times.append(context)
            return []

    monkeypatch.setattr(installed, "entry_points", entry_points)  # not remembered, as it is in other tests
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path, Finder()])
    return times


def test_a_right_network_becomes_processes_in_order(folder: Path) -> None:
    found, diagnostics = plan(
        folder,
        """
        namespace robot1;
        middleware zeromq;
        Component driver { dependences laser; args "--verbose"; env ROBOT "viriato"; };
        Component laser : sensor { port 10003; ip localhost; };
        """,
    )
    assert diagnostics == []
    assert found is not None
    laser, driver = found.processes
    assert (laser.name, laser.component, laser.after) == ("laser", "sensor", ())
    assert (driver.name, driver.after, dict(driver.env)) == ("driver", ("laser",), {"ROBOT": "viriato"})
    assert laser.command[0] == sys.executable
    for part in ("--name laser", "namespace=robot1", "middleware=zeromq", 'zeromq.bind="tcp://127.0.0.1:10003"'):
        assert part in command(found, "laser")
    for part in ("ports.laser.from=laser", "ports.LaserPub.from=laser", "--verbose"):
        assert part in command(found, "driver")
    assert [(link.interface, link.provider) for link in found.links] == [("Laser", "laser"), ("LaserPub", "laser")]


def test_the_command_line_overrides_the_network(folder: Path) -> None:
    body = "middleware nowhere; Component sensor { middleware zeromq; };"
    overrides = Overrides("zeromq", (("sensor", "params.range=5"), ("*", "component.log=debug")))
    assert errors(folder, body, overrides) == ["unknown-middleware"]
    found, _ = plan(folder, "Component sensor { };", overrides)
    assert "--set middleware=zeromq --set params.range=5 --set component.log=debug" in command(found, "sensor")


def test_all_instances_know_whether_their_clock_passes_by_itself(folder: Path) -> None:
    body = "clock left(mode free, speed 2); Component left : sensor { }; Component right : sensor { };"
    found, _ = plan(folder, body)
    for part in ('clock.leader="/left"', 'clock.mode="free"', "clock.speed=2", 'clock.followers=["/right"]'):
        assert part in command(found, "left")
    for part in ('clock.leader="/left"', 'clock.mode="free"'):
        assert part in command(found, "right")
    assert errors(folder, body, Overrides(speed=0.0)) == ["config-out-of-range"]
    assert errors(folder, body.replace("2", "max")) == ["bad-clock"], "told once"


def test_a_configuration_of_its_own_is_passed_on(folder: Path) -> None:
    (folder / "far.toml").write_text("[params]\nrange = 25\n")
    found, _ = plan(folder, 'Component sensor { config "far.toml"; };')
    assert f"--config {folder}/far.toml" in command(found, "sensor")


def test_with_several_instances_wiring_names_client_and_server(folder: Path) -> None:
    found, _ = plan(
        folder,
        """
        Component left : sensor { };
        Component right : sensor { };
        Component fusion { requires Laser from left; requires Laser1 from right; };
        Component driver { requires Laser from right; subscribesTo LaserPub from left; };
        """,
    )
    assert "ports.laser.from=left --set ports.laser1.from=right" in command(found, "fusion")
    assert "ports.laser.from=right --set ports.LaserPub.from=left" in command(found, "driver")


def test_a_subscriber_receives_from_all_publishers_by_default(folder: Path) -> None:
    found, _ = plan(
        folder,
        """
        Component left : sensor { };
        Component right : sensor { };
        Component driver { requires Laser from right; };
        """,
    )
    assert "LaserPub.from" not in command(found, "driver")
    assert found is not None
    assert sum(link.interface == "LaserPub" for link in found.links) == 2


def test_an_instance_that_provides_what_it_uses_is_not_wired_to_itself(tmp_path: Path) -> None:
    text = """
import "Laser.idsl"; import "LaserPub.idsl";
Component sieve { Communications { requires Laser; implements Laser; publishes LaserPub; subscribesTo LaserPub; }; };
"""
    (tmp_path / "sieve.cdsl").write_text(text)
    assert rcgen([str(tmp_path / "sieve.cdsl")]) == 0
    (tmp_path / "sensor.cdsl").write_text(SENSOR)
    (tmp_path / "sensor.pdsl").write_text(PARAMS)
    assert rcgen([str(tmp_path / "sensor.cdsl"), "-o", str(tmp_path / "sensor")]) == 0
    network = tmp_path / "net.ddsl"
    network.write_text('import "sieve.cdsl";\nDeployment net { Component sieve { }; };')
    workspace = Workspace()
    assert make_plan(network, workspace) is None
    codes = [
        each.code for each in workspace.report.diagnostics if each.code.startswith(("no-provider", "no-publisher"))
    ]
    assert codes == ["no-provider", "no-publisher"]


@pytest.mark.parametrize(
    "imports", ['import "sensor/sensor.cdsl"; import "driver/driver.cdsl";', 'import "driver/driver.cdsl";']
)
def test_an_imported_component_that_offers_what_is_missing_is_proposed(folder: Path, imports: str) -> None:
    (folder / "lone.ddsl").write_text(f"{imports} Deployment lone {{ Component driver {{ }}; }};")
    workspace = Workspace()
    assert make_plan(folder / "lone.ddsl", workspace) is None
    told = {
        each.code: each.hint
        for each in workspace.report.diagnostics
        if each.code.startswith(("no-provider", "no-publisher"))
    }
    hint = "write `Component sensor { };`" if "sensor" in imports else ""
    assert told == {"no-provider": hint, "no-publisher": hint}


def test_each_of_several_ports_gets_its_own_proposal(folder: Path) -> None:
    _, diagnostics = plan(folder, "Component left : sensor { }; Component right : sensor { }; Component fusion { };")
    told = [(each.message, each.hint) for each in diagnostics if each.code == "ambiguous-provider"]
    assert told == [
        (
            "several instances implement `Laser` for `fusion`: `left`, `right`",
            "write in its block: requires Laser from left;",
        ),
        (
            "several instances implement `Laser1` for `fusion`: `left`, `right`",
            "write in its block: requires Laser1 from right;",
        ),
    ]


def test_a_program_of_ones_own_is_run_as_it_is(folder: Path) -> None:
    script = folder / "own.sh"
    script.write_text("#!/bin/sh\n")
    script.chmod(0o755)
    found, _ = plan(folder, 'Component sensor { path "own.sh"; args "a b", "c"; };')
    assert found is not None
    (process,) = found.processes
    assert process.command == (str(script), "a b", "c")
    assert (process.cwd, process.notifies, process.is_program) == (folder, False, True)


def test_a_program_that_says_when_it_is_ready_is_waited_for(folder: Path) -> None:
    body = 'Component sensor { existing "sleep 60"; notifies; }; Component driver { dependences sensor; };'
    found, diagnostics = plan(folder, body)
    assert diagnostics == []
    assert found is not None
    assert [(each.name, each.notifies, each.is_program) for each in found.processes] == [
        ("sensor", True, True),
        ("driver", True, False),
    ]
    assert [(each["notifies"], each["is_program"]) for each in found.to_json()["processes"]] == [
        (True, True),
        (True, False),
    ]


def test_a_subscriber_receives_from_programs_and_generated_components(folder: Path) -> None:
    (folder / "own.sh").write_text("#!/bin/sh\n")
    (folder / "own.sh").chmod(0o755)
    body = """
        Component ours : sensor { };
        Component own : sensor { path "own.sh"; };
        Component driver { requires Laser from ours; };
    """
    found, _ = plan(folder, body)
    assert found is not None
    heard = [(way.provider, way.middleware) for way in found.ways if way.interface == "LaserPub"]
    assert heard == [("ours", "shm"), ("own", "zeromq")]
    assert 'ports.LaserPub.also=[{ from = "own", middleware = "zeromq" }]' in command(found, "driver")
    assert "own.sh" in command(found, "own")
    assert "--set" not in command(found, "own")


WRONG = {
    "Component driver { };": ["no-provider"],
    "Component a : sensor {}; Component b : sensor {}; Component driver { };": ["ambiguous-provider"],
    "Component sensor {}; Component fusion { requires Laser2 from sensor; };": ["unknown-port"],
    "Component sensor {}; Component driver { requires Laser from senser; };": ["unknown-instance"],
    "Component sensor {}; Component d : driver {}; Component driver { requires Laser from d; };": ["no-provider"],
    "Component sensor {}; Component sensor {};": ["duplicate"],
    "Component sensor : sensr { };": ["unknown-component"],
    "Component sensor { dependences laser; };": ["unknown-instance"],
    "Component a : sensor { dependences b; }; Component b : sensor { dependences a; };": ["dependence-cycle"],
    "Component sensor { dependences sensor; };": ["dependence-cycle"],
    "Component sensor { dependences driver; }; Component driver { };": ["dependence-cycle"],
    "Component a : sensor { port 7; }; Component b : sensor { port 7; };": ["port-clash"],
    "Component sensor { port 70000; };": ["bad-port"],
    'Component sensor { path "nowhere"; };': ["missing-file"],
    'Component sensor { path "net.ddsl"; };': ["not-executable"],
    'Component sensor { config "nowhere.toml"; };': ["missing-file"],
    'Component sensor { config "bad.toml"; };': ["config-out-of-range"],
    'Component sensor { config "no.toml"; };': ["config-syntax"],
    'Component sensor { env ROBOCOMP__PARAMS__RANGE "99"; };': ["config-out-of-range"],
    "host onboard { }; Component sensor { };": ["bad-host"],
    "Component sensor { host onboard; };": ["unknown-host"],
    'Component sensor { existing "no-such-program"; };': ["missing-file"],
    'Component sensor { existing "./no-such-program"; };': ["missing-file"],
    'Component sensor { existing "sleep"; qos LaserPub(reliable); };': ["configuration"],
    "Component sensor { restart always(intensity 0); };": ["bad-restart"],
    "Component sensor { notifies; };": ["not-a-program"],
    "System left { Component sensor { }; }; Component left : driver { };": ["duplicate"],
    "System a { Component sensor { }; }; System b { Component sensor { }; }; Component driver { };": [
        "ambiguous-provider"
    ],
    "System a { Component sensor { }; }; Component recorder { };": ["qos-mismatch"],
    "middleware zeromp; Component sensor { };": ["unknown-middleware"],
    "Component sensor { middleware inproc; };": ["unfit-middleware"],
    "Component sensor { }; Component driver { requires Laser from sensor middleware zeromp; };": ["unknown-middleware"],
    "Component sensor { }; Component driver { requires Laser from sensor middleware inproc; };": ["unfit-middleware"],
    "Component sensor { }; Component recorder { };": ["qos-mismatch"],
    "Component sensor { qos LaserPup(reliable); };": ["unknown-port"],
    "Component sensor { qos subscribesTo LaserPub(reliable); };": ["unknown-port"],
    "Component sensor { qos Laser(reliable); };": ["qos-of-calls"],
    "Component filter { qos LaserPub(reliable); };": ["ambiguous-port"],
    'Component sensor { path "own.sh"; qos LaserPub(reliable); };': ["configuration"],
    'Component sensor { process p; env ROBOCOMP__PARAMS__RANGE "5"; }; Component driver { process p; };': [
        "config-unknown-key"
    ],
    "Component driver { process p; }; Component fusion { process p; }; Component sensor { middleware inproc; };": [
        "unfit-middleware"
    ],
}


@pytest.mark.parametrize("body", WRONG)
def test_what_is_wrong_is_found_before_anything_starts(folder: Path, body: str) -> None:
    (folder / "bad.toml").write_text("[params]\nrange = 99\n")
    (folder / "no.toml").write_text("[params\n")
    (folder / "own.sh").write_text("#!/bin/sh\n")
    (folder / "own.sh").chmod(0o755)
    assert errors(folder, body) == WRONG[body]


def test_several_errors_are_reported_at_once(folder: Path) -> None:
    body = "Component driver { dependences nobody; }; Component sensor : lidar { }; Component fusion { port 0; };"
    assert set(errors(folder, body)) >= {"unknown-instance", "unknown-component", "bad-port"}


def test_an_error_in_a_configuration_is_reported_at_its_place(folder: Path) -> None:
    (folder / "bad.toml").write_text("[params]\nrange = 99\nrnage = 1\n")
    _, found = plan(folder, 'Component a : sensor { config "bad.toml"; }; Component b : sensor { config "bad.toml"; };')
    far, misspelt = sorted(found, key=lambda each: each.span.start)
    assert far.message == "`range` (m) is 99; allowed: float, 0.0 to 30.0"
    assert far.render().startswith(f"{folder}/bad.toml:2:9: error[config-out-of-range]")
    assert misspelt.message == "unknown parameter `rnage`; did you mean `range`?"
    assert misspelt.render().startswith(f"{folder}/bad.toml:3:1: error[config-unknown-key]")


def test_an_invalid_override_is_reported_with_its_source(folder: Path) -> None:
    override = Overrides(settings=(("sensor", "namespace.x=1"),))
    _, (found,) = plan(folder, "namespace a; Component sensor { };", override)
    assert found.code == "configuration"
    assert found.render() == "--set sensor.namespace.x=1: error[configuration]: namespace is not a table (for `sensor`)"


def test_nothing_can_be_set_for_a_program_that_would_not_be_told(folder: Path) -> None:
    own = folder / "own.sh"
    own.write_text("#!/bin/sh\n")
    own.chmod(0o755)
    body = 'Component sensor { path "own.sh"; };'
    _, (found,) = plan(folder, body, Overrides(settings=(("sensor", "params.range=9"),)))
    assert found.code == "configuration"
    said = "`sensor` is your own program; its configuration cannot be set here"
    assert found.render().startswith(f"--set sensor.params.range=9: error[configuration]: {said}\n")
    assert errors(folder, body, Overrides(settings=(("*", "component.log=debug"),))) == []


def test_what_an_instance_finds_in_its_environment_is_checked(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    body = 'Component sensor { env ROBOCOMP__RANGE "99"; };'
    _, (found,) = plan(folder, body)
    assert "environment variable ROBOCOMP__RANGE: `range` (m) is 99; allowed: float, 0.0 to 30.0" in found.message
    assert errors(folder, body, Overrides(settings=(("sensor", "range=9"),))) == []
    monkeypatch.setenv("ROBOCOMP__RANGE", "98")
    assert errors(folder, "Component sensor { };") == ["config-out-of-range"]
    assert errors(folder, 'Component sensor { env ROBOCOMP__RANGE "9"; };') == []


def test_a_wrong_override_is_reported_as_given(folder: Path) -> None:
    _, (found,) = plan(folder, "Component sensor { };", Overrides(settings=(("sensor", "params.range=99"),)))
    said = "`range` (m) is 99; allowed: float, 0.0 to 30.0 (for `sensor`)"
    assert found.render() == f"--set sensor.params.range=99: error[config-out-of-range]: {said}"
    _, (found,) = plan(folder, "Component sensor { };", Overrides(settings=(("sensor", "range=99"),)))
    assert found.render() == f"--set sensor.range=99: error[config-out-of-range]: {said}"


@pytest.mark.parametrize(
    ("instance", "assignment", "said"),
    [
        ("senser", "params.range=9", "unknown instance `senser`; did you mean `sensor`?"),
        ("params", "range=9", "unknown instance `params`\n    write the instance first, as in `sensor.params.range`"),
        (
            "component",
            "log=x",
            "unknown instance `component`\n    write the instance first, as in `driver.component.log`",
        ),
    ],
)
def test_an_override_for_an_unknown_instance_is_reported_as_given(
    folder: Path, instance: str, assignment: str, said: str
) -> None:
    override = Overrides(settings=((instance, assignment),))
    _, (found,) = plan(folder, "Component driver { }; Component sensor { };", override)
    assert found.render() == f"--set {instance}.{assignment}: error[unknown-instance]: {said}"


@pytest.mark.parametrize(
    ("instance", "said"),
    [
        ("senzor", "unknown instance `senzor`; did you mean `sensor`?"),
        ("*", "unknown instance `*`; known: driver, sensor"),
    ],
)
def test_a_diary_of_an_unknown_instance_is_reported_as_given(folder: Path, instance: str, said: str) -> None:
    override = Overrides(diaries=((instance, "component.diary='x.mcap'"),))
    _, (found,) = plan(folder, "Component driver { }; Component sensor { };", override)
    assert found.render() == f"--diary {instance}: error[unknown-instance]: {said}"


def test_a_subscription_without_publisher_is_a_warning(folder: Path) -> None:
    found, diagnostics = plan(folder, "Component recorder { };")
    assert found is not None
    assert [(each.code, each.severity) for each in diagnostics] == [("no-publisher", "warning")]


def test_an_empty_network_is_a_warning(folder: Path) -> None:
    found, diagnostics = plan(folder, "")
    assert found is not None
    assert [each.code for each in diagnostics] == ["empty-deployment"]


def test_a_component_that_was_not_generated_says_how(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "sensor.cdsl").write_text(SENSOR.replace("sensor.pdsl", str(folder / "sensor" / "sensor.pdsl")))
    (tmp_path / "net.ddsl").write_text('import "sensor.cdsl"; Deployment net { Component sensor { }; };')
    workspace = Workspace()
    assert make_plan(tmp_path / "net.ddsl", workspace) is None
    ((code, hint),) = [(each.code, each.hint) for each in workspace.report.errors]
    assert (code, hint) == ("not-generated", f"run: rcgen {tmp_path}/sensor.cdsl")


def test_its_configuration_is_checked_all_the_same(tmp_path: Path) -> None:
    (tmp_path / "sensor.cdsl").write_text(SENSOR)
    (tmp_path / "sensor.pdsl").write_text(PARAMS)
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc" / "config.toml").write_text("[params]\nrange = 99\n")
    (tmp_path / "net.ddsl").write_text('import "sensor.cdsl"; Deployment net { Component sensor { }; };')
    workspace = Workspace()
    assert make_plan(tmp_path / "net.ddsl", workspace) is None
    assert any("config.toml:2" in each.render() for each in workspace.report.errors)


def test_an_instance_whose_component_is_unknown_is_there_for_those_that_use_it(folder: Path) -> None:
    body = "Component left : sensr { }; Component driver { dependences left; requires Laser from left; };"
    assert errors(folder, body) == ["unknown-component"]


def test_a_wrong_wire_is_not_reported_as_missing_too(folder: Path) -> None:
    both = "Component left : sensor { }; Component right : sensor { };"
    assert errors(folder, f"{both} Component driver {{ requires Lasr from left; }};") == ["unknown-port"]
    assert errors(folder, f"{both} Component driver {{ requires Laser from lfet; }};") == ["unknown-instance"]


def test_two_definitions_of_one_interface_are_distinguished(folder: Path, tmp_path: Path) -> None:
    for name, width in (("server", "float"), ("client", "double")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "Speed.idsl").write_text(
            f"module RoboCompSpeed {{ interface Speed {{ {width} get(); }}; }};"
        )
        verb = "implements" if name == "server" else "requires"
        (tmp_path / name / f"{name}.cdsl").write_text(
            f'import "Speed.idsl"; Component {name} {{ Communications {{ {verb} Speed; }}; language python; }};'
        )
        assert rcgen([str(tmp_path / name / f"{name}.cdsl")]) == 0
    (tmp_path / "net.ddsl").write_text(
        'import "server/server.cdsl"; import "client/client.cdsl";'
        "Deployment net { Component server { }; Component client { }; };"
    )
    workspace = Workspace()
    assert make_plan(tmp_path / "net.ddsl", workspace) is None
    (found,) = workspace.report.errors
    assert found.code == "contract-mismatch"
    assert "SpeedGetResponse.ret: float64 here, float32 there" in found.message


def test_errors_in_imported_files_are_reported_at_their_places(tmp_path: Path) -> None:
    (tmp_path / "broken.cdsl").write_text("Component broken { Communications { implements Lasr; } language python; };")
    (tmp_path / "net.ddsl").write_text('import "broken.cdsl"; Deployment net { Component broken { }; };')
    workspace = Workspace()
    assert make_plan(tmp_path / "net.ddsl", workspace) is None
    assert {os.path.basename(each.span.source.path) for each in workspace.report.errors} == {"broken.cdsl"}


def test_a_plan_is_the_same_every_time(folder: Path) -> None:
    body = "Component sensor { }; Component driver { };"
    assert plan(folder, body)[0] == plan(folder, body)[0]


INPROC = [
    'middleware = "inproc"',
    '[ports.laser]\nmiddleware = "inproc"',
    '[ports.laser.getLaserData]\nmiddleware = "inproc"',
]


@pytest.mark.parametrize("text", INPROC)
def test_a_configuration_cannot_choose_a_middleware_that_stays_in_a_process(folder: Path, text: str) -> None:
    (folder / "inproc.toml").write_text(text)
    found, diagnostics = plan(folder, 'Component driver { config "inproc.toml"; }; Component sensor { };')
    assert found is None
    assert {each.code for each in diagnostics} == {"unfit-middleware"}
    assert (
        f"`driver` ({folder}/inproc.toml:{text.count(chr(10)) + 1}): `inproc` does not reach" in diagnostics[0].message
    )


def test_the_command_line_cannot_choose_a_middleware_that_stays_in_a_process(folder: Path) -> None:
    overrides = Overrides(settings=(("sensor", "middleware=inproc"),))
    _, (found,) = plan(folder, "Component sensor { };", overrides)
    assert found.code == "unfit-middleware"
    assert found.render().startswith("--set sensor.middleware=inproc: error[unfit-middleware]: `inproc` does not reach")
    port = Overrides(settings=(("sensor", "ports.laserpub.middleware=zeromk"),))
    _, (found,) = plan(folder, "Component sensor { };", port)
    assert (found.code, found.hint) == ("unknown-middleware", "did you mean `zeromq`?")


def test_a_component_generated_for_a_middleware_that_stays_in_a_process_cannot_be_alone(tmp_path: Path) -> None:
    (tmp_path / "sensor.cdsl").write_text(SENSOR.replace(' params "sensor.pdsl";', ""))
    assert rcgen([str(tmp_path / "sensor.cdsl"), "--middleware", "inproc"]) == 0
    (tmp_path / "net.ddsl").write_text('import "sensor.cdsl"; Deployment net { Component sensor { }; };')
    workspace = Workspace()
    assert make_plan(tmp_path / "net.ddsl", workspace) is None
    assert {each.code for each in workspace.report.errors} == {"unfit-middleware"}
    assert make_plan(tmp_path / "net.ddsl", Workspace(), Overrides("zeromq")) is not None


def test_both_ends_of_a_link_use_one_middleware(folder: Path, carrier: str) -> None:
    (folder / "other.toml").write_text(f'[ports.laser]\nmiddleware = "{carrier}"\n')
    body = 'Component driver { config "other.toml"; }; Component sensor { middleware zeromq; };'
    _, (found,) = plan(folder, body)
    assert found.code == "middleware-mismatch"
    assert f"`driver` uses `Laser.getLaserData` over `carrier` ({folder}/other.toml:2)" in found.message
    assert f"`sensor` offers it over `zeromq` ({folder}/net.ddsl)" in found.message
    both = Overrides(settings=(("sensor", f"ports.Laser.middleware={carrier}"),))
    assert errors(folder, body, both) == []


@pytest.mark.parametrize("general", ["", "middleware zeromq;"])
def test_a_network_names_the_middleware_of_one_link(folder: Path, carrier: str, general: str) -> None:
    body = f"{general} Component sensor {{ }}; Component driver {{ requires Laser from sensor middleware {carrier}; }};"
    found, diagnostics = plan(folder, body)
    assert (found is not None, diagnostics) == (True, [])
    ways = {(way.interface, way.middleware == carrier) for way in found.ways}
    assert ways == {("Laser", True), ("LaserPub", False)}
    assert f"ports.laser.middleware={carrier}" in command(found, "driver")
    assert f'"{carrier}"' in command(found, "sensor")  # which offers it beside what the other links use
    line = plan(folder, body, Overrides("zeromq"))[0]
    assert {way.middleware for way in line.ways} == {"zeromq"}


def test_ends_are_those_that_configurations_name(folder: Path, carrier: str) -> None:
    body = f"""
        middleware zeromq;
        Component left : sensor {{ }};
        Component right : sensor {{ middleware {carrier}; }};
        Component driver {{ requires Laser from left; subscribesTo LaserPub from left; }};
    """
    assert errors(folder, body) == []
    assert errors(folder, body, Overrides(settings=(("driver", "ports.laser.from=right"),))) == ["middleware-mismatch"]


def test_further_publishers_that_a_configuration_names_are_checked_as_the_first_is(folder: Path, carrier: str) -> None:
    body = f"""
        Component left : sensor {{ }};
        Component right : sensor {{ middleware {carrier}; }};
        Component driver {{ requires Laser from left; subscribesTo LaserPub from left; config "hears.toml"; }};
    """

    def told(also: str) -> list[str]:
        (folder / "hears.toml").write_text(f"[ports.LaserPub]\nalso = [{also}]\n")
        return errors(folder, body)

    assert told('{ from = "right" }') == []
    assert told('{ from = "wrong" }') == ["unknown-instance"]
    assert told('{ from = "right", middleware = "zeromq" }') == ["middleware-mismatch"]
    assert told(f'"{carrier}"') == []  # any publisher over this middleware
    assert told('"nowhere"') == ["unknown-middleware"]


def test_a_publisher_is_heard_by_the_way_that_suits_it(folder: Path, carrier: str) -> None:
    body = f"""
        Component left : sensor {{ middleware zeromq; }};
        Component right : sensor {{ middleware {carrier}; }};
        Component driver {{ requires Laser from left; middleware zeromq; }};
    """
    assert errors(folder, body) == ["middleware-mismatch"]
    found, _ = plan(folder, body, Overrides(settings=(("driver", f'ports.LaserPub.also=["{carrier}"]'),)))
    assert found is not None
    heard = [(way.provider, way.middleware) for way in found.ways if way.interface == "LaserPub"]
    assert heard == [("left", "zeromq"), ("right", carrier)]


def test_an_end_may_use_any_middleware_over_which_the_other_one_offers_it(folder: Path, carrier: str) -> None:
    both = Overrides(settings=(("sensor", f'ports.Laser.also=["{carrier}"]'),))
    body = f"Component sensor {{ middleware zeromq; }}; Component driver {{ middleware {carrier}; }};"
    assert errors(folder, body) == ["middleware-mismatch", "middleware-mismatch"]
    assert errors(folder, body, both) == ["middleware-mismatch"]


SOURCES = {
    "senser": ["unknown-instance"],
    "/senser/Laser": ["unknown-instance"],
    "/robot2/senser/Laser": [],
    "sensor": [],
    "sensor/Laser1": ["no-provider"],
    "driver": ["no-provider"],
}


@pytest.mark.parametrize("source", SOURCES)
def test_a_configuration_can_name_an_existing_instance_as_source(folder: Path, source: str) -> None:
    overrides = Overrides(settings=(("driver", f"ports.laser.from={source}"),))
    assert errors(folder, "Component sensor { }; Component driver { };", overrides) == SOURCES[source]


def test_an_unknown_instance_is_reported_with_a_suggestion(folder: Path) -> None:
    overrides = Overrides(settings=(("driver", "ports.laser.from=senser"),))
    _, (found,) = plan(folder, "Component sensor { }; Component driver { };", overrides)
    assert found.message == (
        "`driver` (--set driver.ports.laser.from=senser): unknown instance `senser`; did you mean `sensor`?"
    )


def test_what_will_be_opened_is_known_with_its_options(folder: Path) -> None:
    body, domain = "Component sensor {}; Component driver {};", ("*", "transports.dds.domain=7")
    found, _ = plan(folder, body, Overrides("zeromq", (domain,)))
    assert found
    assert found.transports == (OpenedTransport("zeromq"),)
    both = (("sensor", "ports.Laser.middleware=dds"), ("driver", "ports.laser.middleware=dds"))
    found, _ = plan(folder, body, Overrides("zeromq", (domain, *both)))
    assert found
    assert found.transports == (OpenedTransport("dds", {"domain": 7}), OpenedTransport("zeromq"))


def test_what_is_installed_is_looked_through_once_for_a_plan_and_anew_for_the_next_one(
    folder: Path, looked_through: list[object]
) -> None:
    plan(folder, "middleware zeromq; Component laser : sensor { }; Component driver { };")
    looked_through.clear()
    for count in (1, 2):
        make_plan(folder / "net.ddsl", Workspace(middlewares=["zeromq"]))
        assert len(looked_through) == count


# Several instances in one process.

SHARED = """
    Component recorder { dependences driver; };
    Component driver { process body; dependences sensor; env ROBOT "viriato"; args "--name", "second"; };
    Component sensor { process body; dependences outside; config "near.toml"; };
    Component outside : filter { };
"""


def test_instances_that_name_one_process_are_run_by_one_command(folder: Path) -> None:
    (folder / "near.toml").write_text('[params]\nrange = 5\n[ports.laserpub]\nqos = "services_default"\n')
    found, diagnostics = plan(
        folder, SHARED + "middleware zeromq;", Overrides(settings=(("outside", "ports.laserpub.qos=parameters"),))
    )
    assert diagnostics == []
    assert found is not None
    outside, body, recorder = found.processes
    assert (outside.name, outside.instances, outside.members) == ("outside", ("outside",), ())
    assert (body.name, body.component, body.instances) == ("body", "sensor, driver", ("sensor", "driver"))
    assert (body.after, dict(body.env), body.notifies) == (("outside",), {"ROBOT": "viriato"}, True)
    assert (recorder.name, recorder.after) == ("recorder", ("body",))
    sensor, driver = " ".join(body.command).split(" + ")
    assert f"run {folder}/sensor --name sensor --config {folder}/near.toml --set middleware=zeromq" in sensor
    assert driver.startswith(f"{folder}/driver --name driver --after sensor --set")
    assert driver.endswith("--name second")
    assert [each["instances"] for each in found.to_json()["processes"]] == [
        ["outside"],
        ["sensor", "driver"],
        ["recorder"],
    ]


def test_an_instance_may_be_alone_in_a_process_that_has_a_name(folder: Path) -> None:
    found, _ = plan(folder, "Component sensor { process p; }; Component driver { dependences sensor; };")
    assert found is not None
    shown = [(process.name, process.instances, process.after) for process in found.processes]
    assert shown == [("p", ("sensor",), ()), ("driver", ("driver",), ("p",))]
    assert " + " not in command(found, "p")


def test_instances_that_share_a_process_may_use_a_middleware_that_stays_in_it(folder: Path) -> None:
    inside = "Component sensor { process p; }; Component driver { process p; };"
    assert errors(folder, f"middleware inproc; {inside}") == []
    assert errors(folder, inside, Overrides("inproc")) == []
    assert errors(folder, inside.replace("process p;", "process p; middleware inproc;")) == []


APART = """
    Component sensor { process left; };
    Component driver { process right; requires Laser from sensor; };
    Component filter { process left; };
    Component fusion { process right; requires Laser from sensor; requires Laser1 from sensor; };
"""


def test_what_stays_in_a_process_is_refused_between_two(folder: Path) -> None:
    _, found = plan(folder, f"middleware inproc; {APART}")
    assert [each.code for each in found] == ["unfit-middleware"] * len(found)
    message = "`Laser.getLaserData` of `sensor` does not reach `driver`, which is in another process, over `inproc`"
    assert any(each.message.startswith(message) for each in found)
    assert errors(folder, APART, Overrides("inproc")) == ["unfit-middleware"] * len(found)


def test_inproc_names_the_instance_that_is_alone_in_its_process(folder: Path) -> None:
    body = "middleware inproc; Component sensor { process p; }; Component driver { process p; }; Component filter { };"
    _, (found,) = plan(folder, body)
    assert found.message == "`inproc` does not reach other processes, and `filter` is alone in its own"
    assert found.span.text == "inproc"


ENDLESS = {
    "in one process": "Component sensor { process p; dependences driver; }; Component driver { process p; };",
    "of two processes": """
        Component sensor { process p; dependences filter; };
        Component filter { process q; };
        Component driver { process q; };
    """,
}


@pytest.mark.parametrize("how", ENDLESS)
def test_an_instance_that_would_wait_forever_for_its_own_client_is_an_error(folder: Path, how: str) -> None:
    _, (found,) = plan(folder, ENDLESS[how])
    assert found.code == "dependence-cycle"
    assert found.span.text == ("driver" if how == "in one process" else "filter")
    assert found.message == (
        f"`sensor` would never start: `{found.span.text}` is not ready before that, "
        "since `driver` requires `Laser` of `sensor`"
    )
    _, apart = plan(folder, ENDLESS["of two processes"].replace("process q;", ""))
    assert apart == []


# QoS.


def test_the_network_sets_the_qos_of_a_port(folder: Path) -> None:
    body = """
        Component sensor { qos LaserPub(reliable, depth 3, deadline 0.5 s); };
        Component recorder { qos LaserPub(best_effort); };
        Component filter { qos subscribesTo LaserPub(depth 1); };
    """
    found, _ = plan(folder, body)
    assert 'ports.laserpub.qos={ reliability = "reliable", depth = 3, deadline = 0.5 }' in command(found, "sensor")
    assert 'ports.LaserPub.qos="default"' in command(found, "recorder")
    assert "ports.LaserPub.qos={ depth = 1 }" in command(found, "filter")
    assert "laserpub.qos" not in command(found, "filter")


def test_qos_of_the_network_is_compared_between_the_ends_of_a_link(folder: Path) -> None:
    network = "Component sensor { %s }; Component recorder { %s };"
    assert errors(folder, network % ("", "qos LaserPub(best_effort);")) == []
    assert errors(folder, network % ("qos LaserPub(reliable);", "")) == []
    _, (found,) = plan(folder, network % ("", "qos LaserPub(reliable);"))
    assert (found.code, found.span.text) == ("qos-mismatch", "LaserPub")
    assert f"({folder}/net.ddsl:7)" in found.message


def test_qos_of_a_configuration_is_compared_between_the_ends_of_a_link(folder: Path) -> None:
    (folder / "asks.toml").write_text('[ports.LaserPub.pushLaserData]\nqos = { durability = "transient_local" }\n')
    _, (found,) = plan(folder, 'Component sensor { }; Component driver { config "asks.toml"; };')
    assert found.code == "qos-mismatch"
    assert f"`transient_local` ({folder}/asks.toml:2)" in found.message
    (folder / "offers.toml").write_text('[ports.laserpub]\nqos = { reliability = "reliable" }\n')
    assert errors(folder, 'Component sensor { config "offers.toml"; }; Component recorder { };') == []
    assert errors(
        folder, 'Component sensor { config "offers.toml"; qos LaserPub(best_effort); }; Component recorder {};'
    ) == ["qos-mismatch"]


def test_of_a_program_of_ones_own_only_the_model_is_known(folder: Path) -> None:
    (folder / "own.sh").write_text("#!/bin/sh\n")
    (folder / "own.sh").chmod(0o755)
    assert errors(folder, 'Component sensor { path "own.sh"; }; Component recorder { };') == ["qos-mismatch"]
    assert errors(folder, 'Component sensor { path "own.sh"; }; Component recorder { path "own.sh"; };') == [
        "qos-mismatch"
    ]


def test_what_is_set_of_many_that_meet_over_dds_is_left_as_it_is(folder: Path) -> None:
    body = "middleware dds; Component sensor { };" + "".join(f"Component d{n} : driver {{ }};" for n in range(25))
    found, _ = plan(folder, body, Overrides(settings=(("*", "transports.dds.many=false"),)))
    assert "many=false" in command(found, "d7")
    assert "many=true" not in command(found, "d7")
    found, _ = plan(folder, body, Overrides(settings=(("d7", "transports.dds.many=false"),)))
    assert "many=true" not in command(found, "d7")
    assert "many=true" in command(found, "d8")


def test_a_configuration_that_is_not_there_is_one_error_and_suggests_no_file_of_another_instance(
    tmp_path: Path,
) -> None:
    root = tmp_path / "sensor"
    root.mkdir()
    (root / "sensor.cdsl").write_text('Component sensor { language python; params "sensor.pdsl"; };')
    (root / "sensor.pdsl").write_text("ComponentParams sensor { offset float 0 mandatory; };")
    assert rcgen([str(root / "sensor.cdsl")]) == 0
    (root / "etc" / "config.toml").unlink()
    (root / "etc" / "west.toml").write_text("params.offset = 1.0")
    path = tmp_path / "net.ddsl"
    path.write_text(
        'import "sensor/sensor.cdsl"; Deployment net { Component west : sensor { config "sensor/etc/west.toml"; };'
        'Component east : sensor { config "sensor/etc/eest.toml"; }; };'
    )

    def told() -> list[tuple[str, str]]:
        workspace = Workspace()
        assert make_plan(path, workspace) is None
        return [(each.code, each.hint) for each in workspace.report.diagnostics]

    assert told() == [("missing-file", "write it, or correct the name")]
    (root / "etc" / "east.toml").write_text("params.offset = 1.0")
    assert told() == [("missing-file", "did you mean `sensor/etc/east.toml`?")]
