"""What is a word, where is it defined, and who uses it: across the languages."""

from __future__ import annotations

from pathlib import Path

import pytest
from lsprotocol import types as lsp

from .conftest import FLEET, write_project
from .editor import Editor


def said(editor: Editor, name: str, marked: str) -> str:
    found = editor.ask(editor.client.text_document_hover_async(lsp.HoverParams(**editor.at(name, marked))))
    assert found is None or isinstance(found.contents, lsp.MarkupContent)
    return found.contents.value if found else ""


def defined(editor: Editor, name: str, marked: str) -> list[tuple[str, str]]:
    """Files, and the words that stand there."""
    parameters = lsp.DefinitionParams(**editor.at(name, marked))
    return shown(editor, editor.ask(editor.client.text_document_definition_async(parameters)))


def used(editor: Editor, name: str, marked: str, *, declared: bool = False) -> list[tuple[str, str]]:
    parameters = lsp.ReferenceParams(lsp.ReferenceContext(declared), **editor.at(name, marked))
    return shown(editor, editor.ask(editor.client.text_document_references_async(parameters)))


def shown(editor: Editor, found: object) -> list[tuple[str, str]]:
    assert isinstance(found, list | tuple)
    names = {editor.uri(name): name for name in editor.texts}
    return [(names[each.uri], editor.text_in(names[each.uri], each.range)) for each in found]


# Hover.


def test_an_operation_is_said_with_its_signature_and_documentation(reader: Editor) -> None:
    text = said(reader, "Arm.idsl", "Joints get|Joints()")
    assert "```idsl\nRoboCompJoints::Joints getJoints()\n```" in text
    assert "Where all joints are." in text


def test_a_type_is_said_with_its_definition_from_another_file(reader: Editor) -> None:
    text = said(reader, "Arm.idsl", "RoboCompJoints::Joi|nt goal")
    assert "struct Joint\n{\n    string name;\n    float angle; // rad\n}" in text
    assert "Where a joint is." in text
    assert "struct of `RoboCompJoints`, in Joints.idsl" in text


def test_hover_tells_what_a_timer_calls(reader: Editor) -> None:
    reader.open("arm/timed.cdsl", "Component timed { language python; timer poll 20 ms; };")
    told = said(reader, "arm/timed.cdsl", "timer |poll")
    assert "timer poll 20 ms" in told
    assert "Calls `timer_poll` on the clock of the component" in told


@pytest.mark.parametrize(
    ("marked", "expected"),
    [
        ("ti|mer poll", "`timer`: a method that is called once in a period: `timer report 1 s;` calls `timer_report`"),
        ("per|iod 50", "`period`: the time from one `compute` to the next, as in `period 50 ms;`"),
        ("Arm e|ach", "`each`: the component provides the interface under any number of names"),
        ("each con|current", "`concurrent`: handlers of the interface run at any time"),
    ],
)
def test_the_words_of_a_component_are_said(editor: Editor, marked: str, expected: str) -> None:
    ports = "Communications { implements Arm each concurrent; };"
    text = f'import "../Arm.idsl"; Component timed {{ {ports} language python; period 50 ms; timer poll 1 s; }};'
    editor.open("arm/timed.cdsl", text)
    assert expected in said(editor, "arm/timed.cdsl", marked)


@pytest.mark.parametrize(
    ("marked", "expected"),
    [
        ("cl|ock left", "the instance whose clock all others follow, as in `clock lidar(speed 10, lost stop);`"),
        ("(lo|st stop", "what happens when a follower is gone: `keep` on, or `stop`"),
        ("lost st|op", "the instance that leads the clock fails if a follower is gone; only in lock-step"),
        ("speed m|ax", "as fast as possible; only in lock-step"),
        ("lost ke|ep", "processes on the host go on when the launcher of the network is gone"),
    ],
)
def test_a_word_is_said_as_its_clause_means_it(editor: Editor, marked: str, expected: str) -> None:
    host = 'host far { address "192.168.1.10"; lost keep; };'
    parts = f"{host} clock left(lost stop, speed max); Component left : arm {{}};"
    editor.open("timed.ddsl", f'import "arm/arm.cdsl"; Deployment d {{ {parts} }};')
    assert said(editor, "timed.ddsl", marked).partition(": ")[2] == expected


def test_hover_lists_the_users_of_a_definition(reader: Editor) -> None:
    assert "Used in Arm.idsl, Joints.idsl" in said(reader, "Joints.idsl", "struct Joi|nt")
    assert "Used in arm.cdsl, chess.cdsl, game.ddsl" in said(reader, "chess/chess.cdsl", "requires A|rm")


def test_an_instance_is_said_with_its_component(reader: Editor) -> None:
    text = said(reader, "game.ddsl", "dependences le|ft")
    assert "Component left : arm" in text


@pytest.fixture
def fleet(editor: Editor) -> Editor:
    """A network on several hosts is open, too."""
    editor.open("fleet.ddsl", FLEET)
    return editor


@pytest.mark.parametrize(
    ("marked", "expected"),
    [
        ("Component spare : arm { host on|board", 'host onboard { address "192.168.1.10"; };'),
        ("dependences north/ha|nd", "Component hand : arm"),
        ("dependences nor|th/hand", "system of `fleet`, in fleet.ddsl"),
        ("restart al|ways", "`always`: it is restarted whenever it ends by itself"),
        ("noti|fies;", "`notifies`: the program tells by sd_notify(3) when it is ready, and others wait for that"),
        ("escalation one_|for_one", "`one_for_one`: only the failed instance is restarted"),
    ],
)
def test_hosts_systems_and_the_words_of_supervision_are_said(fleet: Editor, marked: str, expected: str) -> None:
    assert expected in said(fleet, "fleet.ddsl", marked)


def test_a_name_leads_to_the_nearest_instance_that_has_it(fleet: Editor) -> None:
    lines = FLEET.splitlines()
    for marked, line in (
        ("chess { dependences ha|nd; requires", "        Component hand : arm {};"),
        ("dependences north/ha|nd", "        Component hand : arm {};"),
        ("north/hand, ha|nd;", next(each for each in lines if "System south" in each)),
    ):
        parameters = lsp.DefinitionParams(**fleet.at("fleet.ddsl", marked))
        found = fleet.ask(fleet.client.text_document_definition_async(parameters))
        assert isinstance(found, list | tuple)
        (only,) = found
        assert lines[only.range.start.line] == line


def test_what_is_in_a_system_is_below_it_in_the_outline(fleet: Editor) -> None:
    parameters = lsp.DocumentSymbolParams(fleet.identifier("fleet.ddsl"))
    assert tree(fleet.ask(fleet.client.text_document_document_symbol_async(parameters))) == [
        ["fleet", "onboard", "spare", ["north", "hand", ["inner", "chess"]], ["south", "hand", "chess"]]
    ]


def test_a_component_is_said_with_its_ports(reader: Editor) -> None:
    assert "Component chess\n    requires Arm;" in said(reader, "game.ddsl", "Component ch|ess")


def test_a_parameter_is_said_with_its_range(reader: Editor) -> None:
    assert "speed float 0.5 0:2" in said(reader, "arm/arm.pdsl", "spe|ed")


def test_an_import_is_said_with_its_file(reader: Editor) -> None:
    assert str(reader.folder / "Joints.idsl") in said(reader, "Arm.idsl", "Jo|ints.idsl")


def test_a_built_in_type_is_said_with_its_width(reader: Editor) -> None:
    assert said(reader, "Joints.idsl", "flo|at angle") == "`float`: float32, built in"


def test_a_middleware_is_said_in_a_sentence(editor: Editor) -> None:
    editor.open("marked.cdsl", 'import "Arm.idsl"; Component m { Communications { requires Arm(ice); }; };')
    assert said(editor, "marked.cdsl", "i|ce)") == "`ice`: ZeroC Ice, as RoboComp's own programs speak it"


def test_a_word_that_is_nothing_is_said_nothing_of(reader: Editor) -> None:
    assert said(reader, "Arm.idsl", "mod|ule RoboCompArm") == ""


# Definitions and uses.


@pytest.mark.parametrize(
    ("name", "marked", "home"),
    [
        ("Arm.idsl", "RoboCompJoints::|Joints get", ("Joints.idsl", "Joints")),
        ("Arm.idsl", "throws RoboCompJoints::Blo|cked", ("Joints.idsl", "Blocked")),
        ("arm/arm.cdsl", "implements |Arm", ("Arm.idsl", "Arm")),
        ("game.ddsl", "left : a|rm", ("arm/arm.cdsl", "arm")),
        ("game.ddsl", "Component ches|s", ("chess/chess.cdsl", "chess")),
        ("game.ddsl", "dependences le|ft", ("game.ddsl", "left")),
        ("game.ddsl", "requires A|rm from", ("Arm.idsl", "Arm")),
        ("game.ddsl", "from le|ft", ("game.ddsl", "left")),
        ("arm/arm.pdsl", "enum so|ft {", ("arm/arm.pdsl", "soft")),
        ("arm/arm.smdsl", "resting => mo|ving", ("arm/arm.smdsl", "moving")),
        ("arm/arm.smdsl", "moving => rest|ing", ("arm/arm.smdsl", "resting")),
    ],
)
def test_a_word_leads_to_its_definition(reader: Editor, name: str, marked: str, home: tuple[str, str]) -> None:
    assert defined(reader, name, marked) == [home]


@pytest.mark.parametrize(
    ("name", "marked", "target"),
    [
        ("Arm.idsl", '"Joints|.idsl"', "Joints.idsl"),
        ("arm/arm.cdsl", '"../Ar|m.idsl"', "Arm.idsl"),
        ("arm/arm.cdsl", '"arm.|pdsl"', "arm/arm.pdsl"),
        ("arm/arm.cdsl", '"arm.|smdsl"', "arm/arm.smdsl"),
        ("game.ddsl", '"chess/|chess.cdsl"', "chess/chess.cdsl"),
    ],
)
def test_a_files_name_leads_to_the_file(reader: Editor, name: str, marked: str, target: str) -> None:
    assert defined(reader, name, marked) == [(target, "")]


def test_uses_are_found_in_all_languages(reader: Editor) -> None:
    assert sorted(used(reader, "Arm.idsl", "interface A|rm")) == [
        ("arm/arm.cdsl", "Arm"),
        ("chess/chess.cdsl", "Arm"),
        ("game.ddsl", "Arm"),
    ]


def test_uses_are_found_from_a_use_with_the_definition(reader: Editor) -> None:
    assert sorted(used(reader, "Arm.idsl", "RoboCompJoints::Joi|nt goal", declared=True)) == [
        ("Arm.idsl", "Joint"),
        ("Joints.idsl", "Joint"),
        ("Joints.idsl", "Joint"),
    ]


def test_uses_are_found_in_unopened_files(editor: Editor) -> None:
    editor.open("Arm.idsl")
    parameters = lsp.ReferenceParams(lsp.ReferenceContext(False), **editor.at("Arm.idsl", "interface A|rm"))
    found = editor.ask(editor.client.text_document_references_async(parameters))
    assert {each.uri for each in found or ()} == {
        editor.uri(name) for name in ("arm/arm.cdsl", "chess/chess.cdsl", "game.ddsl")
    }


def test_a_name_of_another_module_is_another_name(editor: Editor) -> None:
    other = "module Other { struct Joint { int i; }; sequence<Joint> Some; };\n"
    editor.open("Other.idsl", other)
    editor.open("Joints.idsl")
    parameters = lsp.ReferenceParams(lsp.ReferenceContext(False), **editor.at("Other.idsl", "struct Jo|int"))
    found = editor.ask(editor.client.text_document_references_async(parameters))
    assert [each.uri for each in found or ()] == [editor.uri("Other.idsl")]


def test_the_same_word_is_marked_in_a_file(reader: Editor) -> None:
    parameters = lsp.DocumentHighlightParams(**reader.at("arm/arm.smdsl", "resting => mo|ving"))
    found = reader.ask(reader.client.text_document_document_highlight_async(parameters))
    assert [reader.text_in("arm/arm.smdsl", each.range) for each in found or ()] == ["moving"] * 3


def test_files_that_are_named_are_links(reader: Editor) -> None:
    parameters = lsp.DocumentLinkParams(reader.identifier("arm/arm.cdsl"))
    found = reader.ask(reader.client.text_document_document_link_async(parameters))
    assert [each.target for each in found or ()] == [
        reader.uri(n) for n in ("Arm.idsl", "arm/arm.pdsl", "arm/arm.smdsl")
    ]


# Symbols.


def tree(symbols: object) -> list[object]:
    assert isinstance(symbols, list | tuple)
    return [[each.name, *tree(each.children)] if each.children else each.name for each in symbols]


@pytest.mark.parametrize(
    ("name", "outline"),
    [
        (
            "Joints.idsl",
            [["RoboCompJoints", ["Joint", "name", "angle"], "Joints", ["Mode", "held", "free"], ["Blocked", "what"]]],
        ),
        ("Arm.idsl", [["RoboCompArm", ["Arm", "getJoints", "moveTo"]]]),
        ("arm/arm.cdsl", ["arm"]),
        ("arm/arm.pdsl", [["arm", "speed", "grip"]]),
        ("arm/arm.smdsl", [["arm", "resting", "moving", "parked"]]),
        ("game.ddsl", [["game", "left", "chess"]]),
    ],
)
def test_a_file_has_an_outline(reader: Editor, name: str, outline: list[object]) -> None:
    parameters = lsp.DocumentSymbolParams(reader.identifier(name))
    assert tree(reader.ask(reader.client.text_document_document_symbol_async(parameters))) == outline


def test_a_project_is_searched_by_the_letters_of_a_name(reader: Editor) -> None:
    found = reader.ask(reader.client.workspace_symbol_async(lsp.WorkspaceSymbolParams("gtjo")))
    assert [each.name for each in found or ()] == ["getJoints"]


# Colours.


def coloured(editor: Editor, name: str) -> list[tuple[str, str]]:
    """The words of a file, each with its type, as an editor reads the numbers."""
    parameters = lsp.SemanticTokensParams(editor.identifier(name))
    found = editor.ask(editor.client.text_document_semantic_tokens_full_async(parameters))
    options = editor.server.semantic_tokens_provider
    assert found
    assert options
    words, line, column = [], 0, 0
    for at in range(0, len(found.data), 5):
        down, right, length, kind, _ = found.data[at : at + 5]
        line, column = line + down, right if down else column + right
        where = lsp.Range(lsp.Position(line, column), lsp.Position(line, column + length))
        words.append((editor.text_in(name, where), options.legend.token_types[kind]))
    return words


def test_every_word_has_the_colour_of_what_it_is(reader: Editor) -> None:
    assert coloured(reader, "game.ddsl")[:13] == [
        ("import", "keyword"),
        ('"arm/arm.cdsl"', "string"),
        ("import", "keyword"),
        ('"chess/chess.cdsl"', "string"),
        ("Deployment", "keyword"),
        ("game", "namespace"),
        ("Component", "keyword"),
        ("left", "variable"),
        ("arm", "class"),
        ("Component", "keyword"),
        ("chess", "variable"),
        ("dependences", "keyword"),
        ("left", "variable"),
    ]


def test_colours_stay_in_place_behind_wide_characters(editor: Editor) -> None:
    editor.open("M.idsl", "/* \N{ROBOT FACE}\n\N{ROBOT FACE} */ module M { struct S { int i; }; };\n")
    assert coloured(editor, "M.idsl") == [
        ("/* \N{ROBOT FACE}", "comment"),
        ("\N{ROBOT FACE} */", "comment"),
        ("module", "keyword"),
        ("M", "namespace"),
        ("struct", "keyword"),
        ("S", "struct"),
        ("int", "type"),
        ("i", "property"),
    ]


# Places where nothing is.


@pytest.mark.parametrize("where", [lsp.Position(0, 500), lsp.Position(9999, 0), lsp.Position(1, 0)])
def test_a_place_where_nothing_is_is_answered_by_nothing(reader: Editor, where: lsp.Position) -> None:
    at = {"text_document": reader.identifier("Arm.idsl"), "position": where}
    assert reader.ask(reader.client.text_document_hover_async(lsp.HoverParams(**at))) is None
    assert reader.ask(reader.client.text_document_definition_async(lsp.DefinitionParams(**at))) == []
    assert reader.ask(reader.client.text_document_prepare_rename_async(lsp.PrepareRenameParams(**at))) is None


@pytest.mark.parametrize("name", ["nothing.idsl", "notes.txt", "../"])
def test_a_file_that_is_not_there_or_not_ours_is_answered_by_nothing(reader: Editor, name: str) -> None:
    at = {"text_document": reader.identifier(name), "position": lsp.Position(0, 0)}
    assert reader.ask(reader.client.text_document_hover_async(lsp.HoverParams(**at))) is None
    assert reader.ask(reader.client.text_document_completion_async(lsp.CompletionParams(**at))) is not None
    parameters = lsp.DocumentSymbolParams(reader.identifier(name))
    assert reader.ask(reader.client.text_document_document_symbol_async(parameters)) == []


def test_a_broken_file_is_answered_as_far_as_it_can_be_read(editor: Editor) -> None:
    editor.open("M.idsl", "module M { struct S { int i; }; struct T { S s; strut }; };")
    assert defined(editor, "M.idsl", "S| s;") == [("M.idsl", "S")]


def test_without_folders_what_is_beside_any_open_file_is_looked_through(tmp_path: Path) -> None:
    editor = Editor(write_project(tmp_path / "one"), folders=[])
    for name in ("one", "two"):
        editor.folder = write_project(tmp_path / name)
        editor.open("Joints.idsl")
        parameters = lsp.ReferenceParams(lsp.ReferenceContext(False), **editor.at("Joints.idsl", "exception Block|ed"))
        [found] = editor.ask(editor.client.text_document_references_async(parameters)) or ()
        assert found.uri == editor.uri("Arm.idsl")
    assert editor.leave() == 0


ALLOWING = """\
import "arm/arm.cdsl";
Deployment tamed
{
    allow north/hand/Arm/moveTo;
    System north { Component hand : arm { allow Arm/getJoints; }; };
};
"""


@pytest.mark.parametrize(
    ("marked", "expected"),
    [
        ("allow nor|th/hand", "system of `tamed`"),
        ("north/ha|nd/Arm", "Component hand : arm"),
        ("hand/Ar|m/moveTo", "interface of `RoboCompArm`"),
        ("Arm/move|To", "void moveTo("),
        ("allow Arm/get|Joints", "Where all joints are."),
        ("all|ow Arm", "an agent may do"),
    ],
)
def test_hovering_what_an_agent_may_do_shows_what_it_is(editor: Editor, marked: str, expected: str) -> None:
    editor.open("tamed.ddsl", ALLOWING)
    assert expected in said(editor, "tamed.ddsl", marked)


RING = 'import "Laser.idsl"; Component ring { Communications { implements Laser each; }; language python; };'
HOUSE = """\
import "ring.cdsl";
Deployment house
{
    System left
    {
        Component world : ring { offers front : Laser; };
        Component user : ring { requires Laser from world/front; };
    };
    Component far : ring { requires Laser from left/front; };
};
"""


@pytest.mark.parametrize(
    ("marked", "expected"),
    [
        ("offers fr|ont", "offers front : Laser;"),
        ("from world/fro|nt", "named instance of `house::left`"),
        ("from wor|ld/front", "Component world : ring"),
        ("from left/fr|ont", "offers front : Laser;"),
        ("from le|ft/front", "system of `house`"),
        ("front : La|ser", "interface"),
        ("off|ers", "under a further name"),
    ],
)
def test_hovering_a_named_instance_shows_where_it_is_declared(editor: Editor, marked: str, expected: str) -> None:
    editor.open("ring.cdsl", RING)
    editor.open("house.ddsl", HOUSE)
    assert expected in said(editor, "house.ddsl", marked)
