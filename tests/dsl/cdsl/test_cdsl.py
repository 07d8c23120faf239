"""What CDSL files mean."""

from __future__ import annotations

import dataclasses

import pytest

from robocomp_py.contract.component import Component, PeriodicTimer
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.qos import PRESETS, Durability, History, Liveliness, QoS, Reliability
from robocomp_py.dsl.cdsl.parser import parse
from robocomp_py.dsl.diagnostics import Report
from robocomp_py.dsl.source import Source

from ..texts import FOLDER, component_of, rendered, workspace


def arm(communications: str = "", clauses: str = "") -> Component:
    imports = "".join(f'import "{name}.idsl"; ' for name in ("Laser", "LaserPub", "Speech", "GotoPoint"))
    text = f"{imports} Component arm {{ Communications {{ {communications} }}; language python; {clauses} }};"
    return component_of(text).component


def ports(component: Component) -> list[tuple[Verb, str]]:
    return [(port.verb, port.name) for port in component.ports]


def test_each_verb_makes_a_port() -> None:
    made = arm("requires Laser; implements Speech, GotoPoint; publishes LaserPub; subscribesTo LaserPub;")
    assert ports(made) == [
        (Verb.REQUIRES, "laser"),
        (Verb.IMPLEMENTS, "Speech"),
        (Verb.IMPLEMENTS, "GotoPoint"),
        (Verb.PUBLISHES, "laserpub"),
        (Verb.SUBSCRIBES, "LaserPub"),
    ]


def test_statements_may_repeat_and_end_in_a_comma() -> None:
    made = arm("requires Laser,; requires Speech, GotoPoint,;")
    assert [name for _, name in ports(made)] == ["laser", "speech", "gotopoint"]


def test_an_interface_used_twice_is_numbered_from_its_second_use() -> None:
    made = arm("requires Laser, Laser; requires Laser; subscribesTo LaserPub, LaserPub; publishes LaserPub;")
    assert [name for _, name in ports(made)] == ["laser", "laser1", "laser2", "LaserPub", "LaserPub1", "laserpub"]
    assert [port.attribute for port in made.ports[:3]] == ["laser_proxy", "laser1_proxy", "laser2_proxy"]
    assert made.ports[4].handler("pushLaserData") == "LaserPub1_pushLaserData"


def test_named_instances_have_an_attribute_and_plain_names_of_methods() -> None:
    made = arm("implements Laser each, Speech; publishes LaserPub each qos(depth 1);")
    assert [port.each for port in made.ports] == [True, False, True]
    assert [port.attribute for port in made.named] == ["laser", "laserpub"]
    assert made.ports[0].handler("getLaserData") == "getLaserData"
    assert made.ports[0].handler("caller") == "caller_"
    assert {port.interface.short for port, _ in made.handlers()} == {"Speech"}


@pytest.mark.parametrize("name", ["timers", "import"])
def test_an_attribute_that_python_or_the_worker_has_gets_an_underscore(name: str) -> None:
    made = component_of(
        'import "it.idsl"; Component c { Communications { implements NAME each; }; language python; };'.replace(
            "NAME", name
        ),
        it_idsl=f"module it {{ interface {name} {{ void a(); }}; }};",
    ).component
    assert made.ports[0].attribute == f"{name}_"


@pytest.mark.parametrize("spelt", [str.upper, str.lower, str.title, str.swapcase])
def test_keywords_are_written_in_any_case(spelt: type[str]) -> None:
    words = ("Component", "Communications", "requires", "language", "gui", "options", "period", "import", "qos", "each")
    text = (
        'import "Laser.idsl"; import "LaserPub.idsl"; Component Arm { gui Qt(QWidget); options dsr;'
        " Communications { requires Laser; publishes LaserPub each qos(sensor_data, depth 1); }; language PYTHON;"
        " period 5 ms; };"
    )
    for word in words:
        text = text.replace(f"{word} ", f"{spelt(word)} ").replace(f" {word}(", f" {spelt(word)}(")
    made = component_of(text).component
    assert (made.name, made.period, made.ports[1].qos.depth) == ("Arm", 0.005, 1)


def test_keywords_are_not_reserved() -> None:
    made = component_of(
        'import "gui.idsl"; Component Component { Communications { requires gui, language1; }; language python; };',
        gui_idsl="module requires { interface gui { void options(); }; interface language1 { void a(); }; };",
    ).component
    assert (made.name, [name for _, name in ports(made)]) == ("Component", ["gui", "language1"])


@pytest.mark.parametrize("communications", ["", "Communications { };", "Communications { }"])
def test_communications_may_be_empty_or_absent(communications: str) -> None:
    assert component_of(f"Component arm {{ {communications} language python; }}").component.ports == ()


def test_clauses_come_in_any_order() -> None:
    made = component_of(
        'import "Laser.idsl"; Component arm { period 2 s; language python; Communications { requires Laser; } }'
    ).component
    assert (made.period, len(made.ports)) == (2.0, 1)


@pytest.mark.parametrize(
    ("written", "seconds"),
    [
        ("50 ms", 0.05),
        ("50ms", 0.05),
        ("0.5 s", 0.5),
        ("2 S", 2.0),
        ("250 us", 0.00025),
        ("1 min", 60.0),
        ("1e2 ms", 0.1),
    ],
)
def test_a_period_has_a_unit(written: str, seconds: float) -> None:
    assert arm(clauses=f"period {written};").period == pytest.approx(seconds)


def test_timers_have_names_and_periods() -> None:
    made = arm(clauses="timer poll 20 ms; Timer timer 1 min; timer period 2 s;")
    assert made.timers == (PeriodicTimer("poll", 0.02), PeriodicTimer("timer", 60.0), PeriodicTimer("period", 2.0))
    assert arm().timers == ()


def test_without_a_period_it_is_that_of_the_contract() -> None:
    assert arm().period == Component("arm").period


@pytest.mark.parametrize("gui", ["gui Qt(QWidget);", "gui Qt;", "gui (QWidget);", "gui;"])
def test_every_form_of_a_gui_is_read(gui: str) -> None:
    arm(clauses=gui)


@pytest.mark.parametrize(
    "clause",
    [
        'RoboCompClasses { laser, "agent", 1; };',
        "RoboCompModules { a; b; };",
        "worker isThread;",
        "qtversion 5;",
        "useQt true;",
        "InnerModelViewer false;",
        "modules a, b;",
        "classes { a };",
        "options;",
        "options dsr, agmagent, InnerModelViewer;",
    ],
)
def test_what_older_generators_knew_is_read_and_has_no_effect(clause: str) -> None:
    assert arm(clauses=clause) == arm()


@pytest.mark.parametrize(
    ("clause", "instead"),
    [
        ("RoboCompClasses { laser };", "remove it, and import what the component needs in its specificworker.py"),
        ("modules a, b;", "remove it, and import what the component needs in its specificworker.py"),
        ("worker isThread;", "remove it: a worker has threads anyway; `period 50 ms;` says how often it computes"),
        ("qtversion 5;", "write `gui Qt;`"),
        ("useQt qt4;", "write `gui Qt;`"),
        ("useQt none;", "remove it: this is the default"),
        ("InnerModelViewer true;", "write `options InnerModelViewer;`"),
        ("InnerModelViewer false;", "remove it: this is the default"),
    ],
)
def test_of_a_clause_of_an_older_robocomp_one_warning_says_what_to_write_instead(clause: str, instead: str) -> None:
    found = workspace(**{"arm.cdsl": f"Component arm {{ language python; {clause} }};"})
    assert found.component(FOLDER / "arm.cdsl") is not None
    [warning] = found.report.diagnostics
    assert (warning.code, warning.span.text, warning.hint) == ("legacy-clause", clause, instead)


AGENTS = {
    "AGMExecutiveTopic.idsl": "module Agents { interface AGMExecutiveTopic { void changed(); }; };",
    "AGMWorldModel.idsl": "module World { interface Unused { void stop(); }; };",
}


def test_an_agent_imports_the_interfaces_of_agents_without_a_word() -> None:
    text = "Component arm { Communications { subscribesTo AGMExecutiveTopic; }; language python; options AGMAgent; };"
    linked = component_of(text, **AGENTS)
    assert [port.interface.name for port in linked.component.ports] == ["Agents::AGMExecutiveTopic"]
    assert [module.name for module in linked.modules] == ["Agents"]


WHOLE = {
    "AGMCommonBehavior.idsl": "module Common { interface AGMCommonBehavior { bool activateAgent(); }; };",
    "AGMExecutive.idsl": "module Executive { interface AGMExecutive { void activate(); }; };",
    "AGMExecutiveTopic.idsl": "module Agents { interface AGMExecutiveTopic { void changed(); }; };",
}


@pytest.mark.parametrize("ports", ["", "Communications { requires AGMExecutive; };"])
def test_an_agent_has_the_ports_that_robocomp_gives_it(ports: str) -> None:
    found = workspace(**{"arm.cdsl": f"Component arm {{ {ports} language python; options agmagent; }};", **WHOLE})
    linked = found.component(FOLDER / "arm.cdsl")
    assert linked
    assert not found.report.diagnostics
    assert sorted((str(port.verb), port.interface.short, port.name) for port in linked.component.ports) == [
        ("implements", "AGMCommonBehavior", "AGMCommonBehavior"),
        ("requires", "AGMExecutive", "agmexecutive"),
        ("subscribesTo", "AGMExecutiveTopic", "AGMExecutiveTopic"),
    ]


def test_missing_interfaces_of_an_agent_are_reported() -> None:
    found = workspace(**{"arm.cdsl": "Component arm { language python; options agmagent; };"})
    assert found.component(FOLDER / "arm.cdsl") is not None
    [warning] = found.report.diagnostics
    assert (warning.code, warning.span.text) == ("ineffective-option", "agmagent")
    assert "AGMCommonBehavior.idsl, AGMExecutive.idsl, AGMExecutiveTopic.idsl" in warning.message


def test_a_component_that_is_no_agent_must_import_the_agent_interfaces() -> None:
    text = "Component arm { Communications { subscribesTo AGMExecutiveTopic; }; language python; };"
    found = workspace(**{"arm.cdsl": text, **AGENTS})
    assert found.component(FOLDER / "arm.cdsl") is None
    assert [each.span.text for each in found.report.errors] == ["AGMExecutiveTopic"]


@pytest.mark.parametrize("language", ["Cpp", "cpp", "Cpp11", "CPP", "C++", "Python", "python3", "PYTHON"])
def test_every_language_becomes_python(language: str) -> None:
    found = workspace(**{"arm.cdsl": f"Component arm {{ language {language}; }};"})
    assert found.component(FOLDER / "arm.cdsl") is not None
    warned = [each.code for each in found.report.diagnostics]
    assert warned == ([] if "python" in language.lower() else ["not-python"]), rendered(found)


@pytest.mark.parametrize(
    ("marker", "middleware"), [("(zeromq)", "zeromq"), ("(ZeroMQ)", "zeromq"), ("(ice)", "ice"), ("(ros)", None)]
)
def test_a_marker_chooses_the_middleware_of_a_port(marker: str, middleware: str | None) -> None:
    [port] = arm(f"requires Laser{marker};").ports
    assert port.middleware == middleware


def test_an_interface_may_be_served_beside_other_code() -> None:
    made = arm("implements Speech concurrent, GotoPoint; subscribesTo LaserPub concurrent qos(depth 1);")
    assert [port.concurrent for port in made.ports] == [True, False, True]


def test_the_comment_above_a_component_describes_it() -> None:
    assert component_of("// Moves the arm.\nComponent arm { language python; };").component.description == (
        "Moves the arm."
    )


def test_parameters_come_from_a_file_beside_it() -> None:
    linked = component_of(
        'Component arm { params "arm.pdsl"; language python; };', arm_pdsl="ComponentParams arm { speed float 1; };"
    )
    assert linked.params == "arm.pdsl"
    assert linked.component.params is not None
    assert [each.name for each in linked.component.params.parameters] == ["speed"]


# Quality of service.


@pytest.mark.parametrize(
    ("words", "qos"),
    [
        ("", QoS()),
        ("reliable", QoS(Reliability.RELIABLE)),
        ("best_effort", QoS(Reliability.BEST_EFFORT)),
        ("volatile", QoS(durability=Durability.VOLATILE)),
        ("transient_local", QoS(durability=Durability.TRANSIENT_LOCAL)),
        ("keep_last", QoS(history=History.KEEP_LAST)),
        ("keep_last 3", QoS(depth=3)),
        ("keep_all", QoS(history=History.KEEP_ALL)),
        ("depth 1", QoS(depth=1)),
        ("deadline 50 ms", QoS(deadline=0.05)),
        ("lifespan 2 s", QoS(lifespan=2.0)),
        ("lease 1 min", QoS(lease=60.0)),
        ("liveliness automatic", QoS(liveliness=Liveliness.AUTOMATIC)),
        ("liveliness manual_by_topic", QoS(liveliness=Liveliness.MANUAL_BY_TOPIC)),
        ("reliable, transient_local, depth 2,", QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=2)),
        ("RELIABLE, Keep_All", QoS(Reliability.RELIABLE, history=History.KEEP_ALL)),
        ("sensor_data, depth 1", dataclasses.replace(PRESETS["sensor_data"], depth=1)),
    ],
)
def test_a_quality_of_service_is_written_in_the_words_of_ros(words: str, qos: QoS) -> None:
    [port] = arm(f"publishes LaserPub qos({words});").ports
    assert port.qos == qos


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_can_be_used(preset: str) -> None:
    [port] = arm(f"subscribesTo LaserPub qos({preset});").ports
    assert port.qos == PRESETS[preset]


# Models.


def test_a_model_knows_where_everything_stands() -> None:
    text = 'import "Laser.idsl"; Component arm { Communications { requires Laser(ice) qos(depth 1); }; period 5 ms; };'
    model = parse(Source(FOLDER / "arm.cdsl", text), Report())
    assert model is not None
    [item], [period] = model.items, model.clauses
    assert model.span.text == text.partition("; ")[2]
    assert (item.span.text, item.qos[0].span.text) == ("Laser(ice) qos(depth 1)", "depth 1")
    assert (period.span.text, model.period and model.period.span.text) == ("period 5 ms;", "5 ms")
    assert model.imports[0].span.text == "Laser.idsl"
