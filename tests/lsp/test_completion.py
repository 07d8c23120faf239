"""What can be written at a place, given all around it."""

from __future__ import annotations

import pytest
from lsprotocol import types as lsp

from .editor import Editor


def items(editor: Editor, name: str, marked: str) -> dict[str, lsp.CompletionItem]:
    """What is proposed at the `|` of a text that has just been typed, by label."""
    before, _, behind = marked.partition("|")
    text = before + behind
    if name in editor.texts:
        editor.change(name, text)
    else:
        editor.open(name, text)
    at = editor.at(name, marked)
    found = editor.ask(editor.client.text_document_completion_async(lsp.CompletionParams(**at)))
    assert isinstance(found, lsp.CompletionList)
    return {each.label: each for each in sorted(found.items, key=lambda item: item.sort_text or item.label)}


JOINTS = 'import "Joints.idsl";\nmodule RoboCompHand { struct Finger { float width; }; %s };\n'


# IDSL.


@pytest.mark.parametrize(
    "inside",
    [
        "struct Hand { | };",
        "struct Hand { int a; F| x; };",
        "exception Broken { | };",
        "sequence<|",
        "dictionary<string, | > Named;",
        "interface Hand { | };",
        "interface Hand { [query] idempotent | };",
        "interface Hand { void take(| ); };",
        "interface Hand { void take(int a, out | ); };",
        "interface Hand { void take(sequence<| ); };",
        "interface Hand { [action] void take() feedback(| ); };",
        "[records] sequence<|",
        "interface Hand { void take([records] sequence<| ); };",
        "const |",
    ],
)
def test_types_are_proposed_where_a_type_is_expected(editor: Editor, inside: str) -> None:
    found = items(editor, "Hand.idsl", JOINTS % inside)
    assert found["Finger"].kind == lsp.CompletionItemKind.Struct
    assert found["Joint"].insert_text == "RoboCompJoints::Joint"
    assert "int" in found
    assert "Blocked" not in found


@pytest.mark.parametrize("inside", ["struct Hand { int | };", "interface Hand { void | };", "enum Side { | };"])
def test_no_types_are_proposed_where_a_name_is_given(editor: Editor, inside: str) -> None:
    assert items(editor, "Hand.idsl", JOINTS % inside) == {}


def test_nothing_but_types_is_proposed_behind_a_module(editor: Editor) -> None:
    found = items(editor, "Hand.idsl", JOINTS % "struct Hand { RoboCompJoints::| };")
    assert set(found) == {"Joint", "Joints", "Mode"}
    assert found["Joint"].insert_text is None


def test_exceptions_are_proposed_behind_throws(editor: Editor) -> None:
    found = items(editor, "Hand.idsl", JOINTS % "interface Hand { void take() throws | };")
    assert "Blocked" in found
    assert "Joint" not in found


def test_interfaces_are_proposed_behind_extends(editor: Editor) -> None:
    text = 'import "Arm.idsl"; module M { interface Other {}; interface More extends | {}; };'
    found = items(editor, "M.idsl", text)
    assert {"Other", "Arm"} <= set(found)
    assert "Joint" not in found


def test_enumerators_are_proposed_as_values(editor: Editor) -> None:
    assert {"held", "free"} <= set(
        items(editor, "Hand.idsl", JOINTS % "struct Hand { RoboCompJoints::Mode mode = | };")
    )


def test_keywords_are_proposed_where_they_can_stand(editor: Editor) -> None:
    assert {"struct", "enum", "interface", "sequence"} <= set(items(editor, "Hand.idsl", JOINTS % "|"))
    assert {"query", "command", "publish", "action", "records", "confirm"} == set(
        items(editor, "Hand.idsl", JOINTS % "interface Hand { [| };")
    )
    assert "throws" in items(editor, "Hand.idsl", JOINTS % "interface Hand { void take() | };")


def test_a_type_that_is_not_imported_is_proposed_with_its_import(editor: Editor) -> None:
    found = items(editor, "M.idsl", "module M { struct S { | }; };")["Joint"]
    assert found.insert_text == "RoboCompJoints::Joint"
    assert editor.applied("M.idsl", found.additional_text_edits or ()).startswith('import "Joints.idsl";\n\nmodule M')


# CDSL.

COMPONENT = 'import "../Arm.idsl";\n\nComponent c\n{\n    Communications\n    {\n        %s\n    };\n    %s\n};\n'


@pytest.mark.parametrize("verb", ["requires", "implements", "publishes", "subscribesTo", "requires Arm,", "REQUIRES"])
def test_interfaces_are_proposed_behind_a_verb(editor: Editor, verb: str) -> None:
    found = items(editor, "arm/c.cdsl", COMPONENT % (f"{verb} |;", "language python;"))
    assert next(iter(found)) == "Arm"
    assert found["Arm"].kind == lsp.CompletionItemKind.Interface
    assert found["Arm"].additional_text_edits is None
    assert "Joint" not in found


def test_an_interface_that_is_not_imported_is_proposed_with_its_import(editor: Editor) -> None:
    found = items(editor, "arm/c.cdsl", COMPONENT % ("requires Las|;", ""))["Laser"]
    text = editor.applied("arm/c.cdsl", found.additional_text_edits or ())
    assert text.startswith('import "../Arm.idsl";\nimport "Laser.idsl";\n\nComponent')


@pytest.mark.parametrize(
    ("statement", "clause", "expected"),
    [
        ("requires Arm(|);", "", {"zeromq", "dds", "zenoh", "inproc", "ice"}),
        ("publishes Arm qos(|);", "", {"sensor_data", "reliable", "depth", "deadline"}),
        ("publishes Arm qos(liveliness |);", "", {"automatic", "manual_by_topic"}),
        ("", "language |;", {"python"}),
        ("", "period 50 |;", {"ms", "s"}),
        ("", "timer poll 50 |;", {"ms", "s"}),
        ("", "options |;", {"dsr"}),
        ("", 'params "|";', {"arm.pdsl"}),
        ("", 'statemachine "|";', {"arm.smdsl"}),
        ("", "|", {"params", "period", "timer", "language", "statemachine"}),
        ("|", "", {"requires", "implements", "publishes", "subscribesTo"}),
    ],
)
def test_a_component_is_written_with_what_fits(editor: Editor, statement: str, clause: str, expected: set[str]) -> None:
    assert expected <= set(items(editor, "arm/c.cdsl", COMPONENT % (statement, clause)))


@pytest.mark.parametrize(
    ("inside", "expected", "absent"),
    [
        ("(|);", {"goTo", "dock", "zeromq"}, {"ready"}),
        ("(goTo |);", {"refuse", "preempt", "queue"}, {"zeromq"}),
        ("(goTo queue, |);", {"goTo", "dock"}, {"zeromq", "queue"}),
    ],
)
def test_policies_of_actions_are_proposed(editor: Editor, inside: str, expected: set[str], absent: set[str]) -> None:
    editor.open(
        "Guide.idsl",
        "module RoboCompGuide { interface Guide "
        "{ [action] void goTo(int x) feedback(int left); [action] void dock(); [query] bool ready(); }; };",
    )
    text = 'import "Guide.idsl"; Component robot { Communications { implements Guide%s }; language python; };'
    found = set(items(editor, "robot.cdsl", text % inside))
    assert expected <= found
    assert not absent & found


def test_imports_are_proposed_as_they_are_found(editor: Editor) -> None:
    found = items(editor, "arm/c.cdsl", 'import "|";\nComponent c {};\n')
    assert {"Laser.idsl", "../Arm.idsl", "../Joints.idsl"} <= set(found)


def test_a_partly_typed_path_is_replaced_completely(editor: Editor) -> None:
    item = items(editor, "arm/c.cdsl", 'import "../Ar|";\nComponent c {};\n')["../Arm.idsl"]
    assert isinstance(item.text_edit, lsp.TextEdit)
    assert editor.applied("arm/c.cdsl", [item.text_edit]) == 'import "../Arm.idsl";\nComponent c {};\n'


# DDSL.

NETWORK = (
    'import "arm/arm.cdsl";\nimport "chess/chess.cdsl";\nDeployment d\n{\n    Component left : arm {};\n    %s\n};\n'
)


@pytest.mark.parametrize(
    ("inside", "expected", "absent"),
    [
        ("Component chess { dependences |; };", {"left"}, {"chess", "arm"}),
        ("Component chess { dependences left, |; };", {"left"}, {"arm"}),
        ("Component right : | {};", {"arm", "chess"}, {"left"}),
        ("Component chess { requires |; };", {"Arm"}, {"Joint", "left"}),
        ("Component chess { requires Arm from |; };", {"left"}, {"arm"}),
        ("Component chess { requires Arm from left |; };", {"middleware"}, {"left"}),
        ("Component chess { requires Arm from left middleware |; };", {"dds"}, {"left"}),
        ("Component left { requires |; };", set(), {"Arm"}),
        ("Component chess { process |; }; Component b { process vision; };", {"vision"}, {"chess"}),
        ("middleware |;", {"zeromq", "ice"}, {"left"}),
        ("Component chess { | };", {"dependences", "config", "requires"}, {"Deployment"}),
    ],
)
def test_a_network_is_written_with_what_fits(editor: Editor, inside: str, expected: set[str], absent: set[str]) -> None:
    found = set(items(editor, "d.ddsl", NETWORK % inside))
    assert expected <= found
    assert not absent & found


@pytest.mark.parametrize(
    ("inside", "expected", "absent"),
    [
        ("host base { address robot; }; Component chess { host |; };", {"base"}, {"left"}),
        ("host base { | };", {"address", "user", "port", "workdir", "python", "lost"}, {"dependences"}),
        ("host base { lost |; };", {"stop", "keep"}, {"base"}),
        ("restart |;", {"never", "on_failure", "always"}, {"left"}),
        ("Component chess { restart always(|); };", {"intensity", "period", "delay", "max_delay"}, {"left"}),
        ("escalation |;", {"one_for_one", "rest_for_one", "one_for_all"}, {"left"}),
        ("security |;", {"local", "lan", "open"}, {"left"}),
        ("System a { | };", {"Component", "System", "host", "restart", "escalation"}, {"middleware", "notifies"}),
        ("System a { Component x : arm { }; Component chess { dependences |; }; };", {"left", "x"}, {"a/x", "chess"}),
        ("System a { Component left : arm { }; Component b : arm { dependences |; }; };", {"left", "/left"}, {"b"}),
        ("System a { Component x : arm { }; }; Component chess { requires Arm from |; };", {"left", "a/x"}, {"x"}),
        ("| Component chess { };", {"System", "host", "security", "restart", "escalation"}, {"grace"}),
        ("allow |;", {"left/Arm", "left/Arm/moveTo"}, {"chess", "Arm", "left"}),
        ("allow left/Arm/getJoints, |;", {"left/Arm/moveTo"}, set()),
        ("allow left/|;", {"Arm", "Arm/moveTo"}, {"left/Arm"}),
        ("allow left/Arm/|;", {"moveTo", "getJoints"}, {"Arm"}),
        ("Component hand : arm { allow |; };", {"Arm", "Arm/moveTo"}, {"left/Arm"}),
        ("Component chess { | };", {"existing", "grace", "notifies", "restart", "host"}, {"security"}),
    ],
)
def test_a_network_on_several_hosts_is_written_with_what_fits(
    editor: Editor, inside: str, expected: set[str], absent: set[str]
) -> None:
    found = set(items(editor, "d.ddsl", NETWORK % inside))
    assert expected <= found
    assert not absent & found


@pytest.mark.parametrize(
    ("clause", "expected", "absent"),
    [
        ("qos |;", {"LaserPub", "BatteryStatusPub", "publishes", "subscribesTo"}, {"Laser"}),
        ("qos publishes |;", {"LaserPub"}, {"BatteryStatusPub"}),
        ("qos subscribesTo |;", {"BatteryStatusPub"}, {"LaserPub"}),
        ("qos LaserPub(|);", {"sensor_data", "depth"}, {"LaserPub"}),
        ("qos LaserPub(depth 1, liveliness |);", {"automatic"}, {"depth"}),
    ],
)
def test_a_qos_is_written_with_what_fits(editor: Editor, clause: str, expected: set[str], absent: set[str]) -> None:
    imports = "".join(f'import "{name}.idsl";' for name in ("Laser", "LaserPub", "BatteryStatusPub"))
    ports = "implements Laser; publishes LaserPub; subscribesTo BatteryStatusPub;"
    editor.open("arm/arm.cdsl", f"{imports} Component arm {{ Communications {{ {ports} }}; language python; }};")
    found = set(items(editor, "d.ddsl", NETWORK % f"Component b : arm {{ {clause} }};"))
    assert expected <= found
    assert not absent & found


@pytest.mark.parametrize(
    ("clause", "expected", "absent"),
    [
        ("clock |;", {"left"}, {"arm", "mode"}),
        ("clock left(|);", {"speed", "mode", "lost"}, {"left"}),
        ("clock left(speed 10, |);", {"mode", "lost"}, {"speed"}),
        ("clock left(mode |);", {"lockstep", "free"}, {"speed", "keep"}),
        ("clock left(lost |);", {"keep", "stop"}, {"free"}),
        ("clock left(speed |);", {"max"}, {"lost"}),
    ],
)
def test_a_clock_is_written_with_what_fits(editor: Editor, clause: str, expected: set[str], absent: set[str]) -> None:
    found = set(items(editor, "d.ddsl", NETWORK % clause))
    assert expected <= found
    assert not absent & found


@pytest.mark.parametrize(
    ("verb", "expected", "absent"),
    [
        ("implements", {"each", "concurrent"}, set()),
        ("publishes", {"each"}, {"concurrent"}),
        ("requires", set(), {"each", "concurrent"}),
        ("subscribesTo", {"concurrent"}, {"each"}),
    ],
)
def test_words_behind_an_interface_fit_its_verb(
    editor: Editor, verb: str, expected: set[str], absent: set[str]
) -> None:
    text = 'import "Laser.idsl"; Component c { Communications { %s Laser |; }; };'
    found = set(items(editor, "arm/c.cdsl", text % verb))
    assert {"qos", *expected} <= found
    assert not absent & found


@pytest.mark.parametrize(("pattern", "has_feedback"), [("[action] ", True), ("", False), ("[query] ", False)])
def test_feedback_is_proposed_for_actions(editor: Editor, pattern: str, has_feedback: bool) -> None:
    found = items(editor, "Hand.idsl", JOINTS % f"interface Hand {{ {pattern}void take(int force) |; }};")
    assert "throws" in found
    assert ("feedback" in found) is has_feedback


def test_actions_and_topics_that_a_component_subscribes_to_may_be_allowed(editor: Editor) -> None:
    editor.open("arm/Grip.idsl", "module RoboCompGrip { interface Grip { [action] void take(int force); }; };")
    imports = 'import "Grip.idsl"; import "LaserPub.idsl"; import "BatteryStatusPub.idsl";'
    ports = "implements Grip; publishes LaserPub; subscribesTo BatteryStatusPub;"
    editor.open("arm/arm.cdsl", f"{imports} Component arm {{ Communications {{ {ports} }}; language python; }};")
    found = set(items(editor, "d.ddsl", NETWORK % "Component b : arm { allow |; };"))
    assert {"Grip/take", "BatteryStatusPub", "BatteryStatusPub/pushBatteryState"} <= found
    assert "LaserPub" not in found


@pytest.mark.parametrize(
    ("clause", "expected", "absent"),
    [
        ("offers side : |;", {"Laser", "LaserPub"}, {"BatteryStatusPub", "arm"}),
        ("offers side : Laser, |;", {"LaserPub"}, {"Laser"}),
        ("offers |;", set(), {"Laser", "left"}),
        ("offers side : Laser |;", {"port"}, {"LaserPub"}),
    ],
)
def test_a_named_instance_is_written_with_what_fits(
    editor: Editor, clause: str, expected: set[str], absent: set[str]
) -> None:
    imports = "".join(f'import "{name}.idsl";' for name in ("Laser", "LaserPub", "BatteryStatusPub"))
    ports = "implements Laser each; publishes LaserPub each, BatteryStatusPub;"
    editor.open("arm/arm.cdsl", f"{imports} Component arm {{ Communications {{ {ports} }}; language python; }};")
    found = set(items(editor, "d.ddsl", NETWORK % f"Component b : arm {{ {clause} }};"))
    assert expected <= found
    assert not absent & found


def test_named_instances_are_proposed_as_providers(editor: Editor) -> None:
    inside = "Component b : arm { offers front : Arm; offers eye : Laser; }; Component chess { requires Arm from |; };"
    found = list(items(editor, "d.ddsl", NETWORK % inside))
    assert found.index("front") < found.index("eye")
    assert "b/front" not in found


def test_providers_of_the_interface_come_first(editor: Editor) -> None:
    found = items(editor, "d.ddsl", NETWORK % "Component chess { requires Arm from |; };")
    assert list(found) == ["left", "chess"]


def test_a_networks_imports_are_components(editor: Editor) -> None:
    assert set(items(editor, "d.ddsl", 'import "|";\n')) == {"arm/arm.cdsl", "chess/chess.cdsl"}


def test_configurations_are_proposed_by_their_paths(editor: Editor) -> None:
    found = items(editor, "d.ddsl", NETWORK % 'Component chess { config "|"; };')
    assert set(found) == {"arm/etc/config.toml"}


# PDSL and SMDSL.


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("ComponentParams p { speed |", {"int", "float", "string", "bool", "enum"}),
        ('ComponentParams p { device string "x" | };', {"mandatory", "dynamic"}),
        ("ComponentParams p { on bool | };", {"true", "false"}),
        ("ComponentParams p { mode enum | { slow, fast }; };", {"slow", "fast"}),
    ],
)
def test_parameters_are_written_with_what_fits(editor: Editor, text: str, expected: set[str]) -> None:
    assert expected <= set(items(editor, "p.pdsl", text))


MACHINE = "m\n{\n    states one, two;\n    initial_state start;\n    transitions { %s };\n};\n"


@pytest.mark.parametrize("inside", ["|", "start => |;", "start => one, |;"])
def test_states_are_proposed_in_transitions(editor: Editor, inside: str) -> None:
    assert {"start", "one", "two"} <= set(items(editor, "m.smdsl", MACHINE % inside))


# Anywhere.


@pytest.mark.parametrize("text", ["// an |", "module M { /* an | */ };", "module M { // an |"])
def test_nothing_is_proposed_in_a_comment(editor: Editor, text: str) -> None:
    assert items(editor, "M.idsl", text) == {}


def test_names_are_known_while_a_file_cannot_be_read(editor: Editor) -> None:
    items(editor, "Hand.idsl", JOINTS % "|")
    assert "Finger" in items(editor, "Hand.idsl", JOINTS.partition("%s")[0] + "sequence<|")
