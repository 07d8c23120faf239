"""A name is changed wherever models have it; who has it in Python is told, and left alone."""

from __future__ import annotations

from pathlib import Path

import pytest
from lsprotocol import types as lsp
from pygls.exceptions import JsonRpcException

from .conftest import FILES, FLEET, write_project
from .editor import Editor


def renamed(editor: Editor, name: str, marked: str, new: str) -> dict[str, str]:
    """The texts that a rename changes, by the names of their files. Nothing is wrong with them afterwards."""
    edit = asked(editor, name, marked, new)
    files = {editor.uri(each): each for each in (*FILES, *editor.texts)}
    texts = {}
    for change in edit.document_changes or ():
        assert isinstance(change, lsp.TextDocumentEdit)
        edits = [each for each in change.edits if not isinstance(each, lsp.SnippetTextEdit)]
        texts[files[change.text_document.uri]] = editor.applied(files[change.text_document.uri], edits)
    for each, text in texts.items():
        (editor.folder / each).write_text(text)
    for each, text in texts.items():
        assert [found for found in editor.open(each, text) if found.severity == lsp.DiagnosticSeverity.Error] == []
    return texts


def asked(editor: Editor, name: str, marked: str, new: str) -> lsp.WorkspaceEdit:
    if name not in editor.texts:
        editor.open(name)
    at = editor.at(name, marked)
    edit = editor.ask(editor.client.text_document_rename_async(lsp.RenameParams(new_name=new, **at)))
    assert edit
    return edit


def test_end_states_of_one_name_share_a_method_so_they_are_renamed_together(editor: Editor) -> None:
    text = (
        "arm\n{\n    initial_state one;\n    states two;\n    transitions { one => two; };\n};\n"
        ":one { initial_state a; end_state done; transitions { a => done; }; };\n"
        ":two { initial_state b; end_state done; transitions { b => done; }; };\n"
    )
    editor.open("arm/arm.smdsl", text)
    changed = renamed(editor, "arm/arm.smdsl", "end_state do|ne; transitions { a", "over")["arm/arm.smdsl"]
    assert changed == text.replace("done", "over")


def told(editor: Editor) -> list[str]:
    editor.until(lambda: bool(editor.messages))
    return editor.messages[-1].replace(f"{editor.folder}/", "").splitlines()[1:]


# Across the languages.


def test_an_interface_is_renamed_in_interfaces_components_and_networks(editor: Editor) -> None:
    texts = renamed(editor, "Arm.idsl", "interface A|rm", "Manipulator")
    assert set(texts) == {"Arm.idsl", "arm/arm.cdsl", "chess/chess.cdsl", "game.ddsl"}
    assert "interface Manipulator\n" in texts["Arm.idsl"]
    assert "implements Manipulator;" in texts["arm/arm.cdsl"]
    assert "requires Manipulator;" in texts["chess/chess.cdsl"]
    assert "requires Manipulator from left;" in texts["game.ddsl"]


def test_it_makes_no_difference_where_a_rename_begins(editor: Editor) -> None:
    assert set(renamed(editor, "game.ddsl", "requires A|rm", "Manipulator")) == {
        "Arm.idsl",
        "arm/arm.cdsl",
        "chess/chess.cdsl",
        "game.ddsl",
    }


def test_a_type_is_renamed_behind_its_module_in_other_files(editor: Editor) -> None:
    texts = renamed(editor, "Joints.idsl", "struct Jo|int", "Axis")
    assert "sequence<Axis> Joints;" in texts["Joints.idsl"]
    assert "moveTo(RoboCompJoints::Axis goal," in texts["Arm.idsl"]
    assert "RoboCompJoints::Joints getJoints()" in texts["Arm.idsl"]


@pytest.mark.parametrize(
    ("name", "marked", "new", "expected"),
    [
        ("Joints.idsl", "float ang|le;", "turn", {"Joints.idsl": "float turn;"}),
        ("Joints.idsl", "enum Mo|de", "State", {"Joints.idsl": "enum State {"}),
        ("Joints.idsl", "{ he|ld,", "kept", {"Joints.idsl": "{ kept, free }"}),
        ("Joints.idsl", "exception Bl|ocked", "Stuck", {"Arm.idsl": "throws RoboCompJoints::Stuck;"}),
        ("Joints.idsl", "sequence<Joint> Jo|ints", "All", {"Arm.idsl": "RoboCompJoints::All getJoints"}),
        ("Arm.idsl", "get|Joints()", "joints", {"Arm.idsl": "joints();"}),
        ("Arm.idsl", "Joint go|al,", "target", {"Arm.idsl": "Joint target,"}),
        ("arm/arm.pdsl", "spe|ed", "pace", {"arm/arm.pdsl": 'pace "rad/s"'}),
        ("arm/arm.pdsl", "{ so|ft,", "gentle", {"arm/arm.pdsl": "enum gentle { gentle, hard }"}),
        ("arm/arm.smdsl", "states mov|ing", "going", {"arm/arm.smdsl": "resting => going, parked;\n        going =>"}),
        (
            "game.ddsl",
            "Component le|ft",
            "first",
            {"game.ddsl": "dependences first;\n        requires Arm from first;"},
        ),
    ],
)
def test_what_has_a_name_can_be_renamed(
    editor: Editor, name: str, marked: str, new: str, expected: dict[str, str]
) -> None:
    texts = renamed(editor, name, marked, new)
    for file, text in expected.items():
        assert text in texts[file]


def test_a_component_that_is_renamed_stays_that_of_an_instance_of_its_old_name(editor: Editor) -> None:
    texts = renamed(editor, "chess/chess.cdsl", "Component ch|ess", "player")
    assert "Component player\n" in texts["chess/chess.cdsl"]
    assert "Component chess : player\n" in texts["game.ddsl"]


def test_an_instance_that_is_renamed_stays_one_of_its_component(editor: Editor) -> None:
    texts = renamed(editor, "game.ddsl", "Component ch|ess", "player")
    assert "Component player : chess\n" in texts["game.ddsl"]
    assert set(texts) == {"game.ddsl"}


@pytest.mark.parametrize(
    ("marked", "new", "expected"),
    [
        ("System nor|th", "west", ["System west", "dependences west/hand, hand;"]),
        ("dependences nor|th", "west", ["System west", "dependences west/hand, hand;"]),
        ("north/ha|nd", "grip", ["Component grip : arm", "requires Arm from grip;", "dependences north/grip, hand;"]),
        ("host on|board {", "base", ["host base {", "arm { host base; restart", "{\n        host base;"]),
    ],
)
def test_hosts_and_systems_and_what_is_in_them_are_renamed_wherever_they_are_named(
    editor: Editor, marked: str, new: str, expected: list[str]
) -> None:
    editor.open("fleet.ddsl", FLEET)
    text = renamed(editor, "fleet.ddsl", marked, new)["fleet.ddsl"]
    for part in expected:
        assert part in text


def test_a_named_instance_is_renamed_wherever_it_is_named(editor: Editor) -> None:
    editor.open(
        "hand.cdsl", 'import "Arm.idsl"; Component hand { Communications { implements Arm each; }; language python; };'
    )
    editor.open(
        "pair.ddsl",
        'import "hand.cdsl"; import "chess/chess.cdsl"; Deployment pair {'
        " System s { Component hand { offers left : Arm; }; Component chess { requires Arm from hand/left; }; };"
        " Component far : chess { requires Arm from s/left; }; };",
    )
    text = renamed(editor, "pair.ddsl", "from s/le|ft", "first")["pair.ddsl"]
    for part in ("offers first : Arm;", "from hand/first;", "from s/first;"):
        assert part in text


def test_nothing_is_renamed_so_that_a_name_means_another_instance(editor: Editor) -> None:
    editor.open("fleet.ddsl", FLEET.replace("requires Arm from hand", "requires Arm from spare"))
    with pytest.raises(JsonRpcException, match="`hand` is `north/hand` here, and not `hand`"):
        renamed(editor, "fleet.ddsl", "Component spa|re", "hand")


# What is told.


def test_handlers_that_have_the_old_name_are_told(editor: Editor) -> None:
    renamed(editor, "Arm.idsl", "void mo|veTo", "goTo")
    assert told(editor) == [
        "`Arm_moveTo` in arm/specificworker.py:5",
        "`arm_proxy.moveTo` in chess/specificworker.py:3",
    ]


def test_all_handlers_of_an_interface_are_told(editor: Editor) -> None:
    renamed(editor, "Arm.idsl", "interface A|rm", "Manipulator")
    assert told(editor) == [
        "`Arm_getJoints` in arm/specificworker.py:2",
        "`Arm_moveTo` in arm/specificworker.py:5",
        "`arm_proxy` in chess/specificworker.py:3",
    ]


def test_methods_of_a_state_are_told(editor: Editor) -> None:
    renamed(editor, "arm/arm.smdsl", "states mov|ing", "going")
    assert told(editor) == [
        "`sm_moving` in arm/specificworker.py:8",
        "`t_moving_to_resting` in arm/specificworker.py:9",
    ]


def test_uses_of_a_parameter_in_code_and_configuration_are_reported(editor: Editor) -> None:
    renamed(editor, "arm/arm.pdsl", "spe|ed", "pace")
    assert told(editor) == ["`params.speed` in arm/specificworker.py:6", "`speed` in arm/etc/config.toml:2"]


def test_reported_uses_are_shown_with_the_change(editor: Editor) -> None:
    edit = asked(editor, "Arm.idsl", "void mo|veTo", "goTo")
    (annotation,) = (edit.change_annotations or {}).values()
    assert "Arm_moveTo" in (annotation.description or "")


def test_changes_are_of_the_versions_that_the_editor_has(editor: Editor) -> None:
    editor.open("Arm.idsl")
    editor.change("Arm.idsl", FILES["Arm.idsl"] + "\n")
    edit = asked(editor, "Arm.idsl", "interface A|rm", "Manipulator")
    changed = [each.text_document for each in edit.document_changes or () if isinstance(each, lsp.TextDocumentEdit)]
    assert {each.uri: each.version for each in changed} == {
        editor.uri("Arm.idsl"): 2,
        **{editor.uri(name): None for name in ("arm/arm.cdsl", "chess/chess.cdsl", "game.ddsl")},
    }


def test_python_is_left_as_it_is(editor: Editor) -> None:
    texts = renamed(editor, "Arm.idsl", "void mo|veTo", "goTo")
    assert set(texts) == {"Arm.idsl"}


# What cannot be.


@pytest.mark.parametrize(
    ("name", "marked", "new", "why"),
    [
        ("Joints.idsl", "struct Jo|int", "2nd", "`2nd` is not a name"),
        ("Joints.idsl", "struct Jo|int", "", "`` is not a name"),
        ("Joints.idsl", "struct Jo|int", "größe", "`größe` is not a name"),
        ("Joints.idsl", "struct Jo|int", "class", "`class` is a keyword of Python"),
        ("Joints.idsl", "struct Jo|int", "__all__", "two underscores are reserved by Python"),
        ("Joints.idsl", "struct Jo|int", "float", "`float` is a word of IDSL"),
        ("Joints.idsl", "struct Jo|int", "Mode", "`Mode` is already defined (Joints.idsl:10)"),
        ("Arm.idsl", "void mo|veTo", "getJoints", "overloading is not possible (Arm.idsl:10)"),
        ("arm/arm.pdsl", "spe|ed", "grip", "`grip` is defined twice (arm.pdsl:4)"),
        ("arm/arm.smdsl", "states mov|ing", "resting", "state `resting` is defined twice"),
        ("game.ddsl", "Component le|ft", "chess", "instance `chess` is defined twice"),
        ("Joints.idsl", "module Robo|CompJoints", "Other", "nothing here can be renamed"),
    ],
)
def test_a_name_that_would_be_wrong_is_refused(editor: Editor, name: str, marked: str, new: str, why: str) -> None:
    editor.open(name)
    parameters = lsp.RenameParams(new_name=new, **editor.at(name, marked))
    with pytest.raises(JsonRpcException, match=r".") as refused:
        editor.ask(editor.client.text_document_rename_async(parameters))
    assert why in refused.value.message


def test_what_is_not_of_the_project_is_not_renamed(editor: Editor) -> None:
    editor.open(
        "M.cdsl", 'import "Laser.idsl";\nComponent M { Communications { requires Laser; }; language python; };\n'
    )
    parameters = lsp.RenameParams(new_name="Scanner", **editor.at("M.cdsl", "requires La|ser"))
    with pytest.raises(JsonRpcException, match="not part of this project"):
        editor.ask(editor.client.text_document_rename_async(parameters))


def test_it_is_known_beforehand_what_can_be_renamed(editor: Editor) -> None:
    editor.open("Arm.idsl")
    at = editor.at("Arm.idsl", "interface A|rm")
    found = editor.ask(editor.client.text_document_prepare_rename_async(lsp.PrepareRenameParams(**at)))
    assert isinstance(found, lsp.PrepareRenamePlaceholder)
    assert (found.placeholder, editor.text_in("Arm.idsl", found.range)) == ("Arm", "Arm")
    at = editor.at("Arm.idsl", "mod|ule RoboCompArm")
    assert editor.ask(editor.client.text_document_prepare_rename_async(lsp.PrepareRenameParams(**at))) is None


def test_an_editor_that_knows_no_versions_gets_plain_changes(tmp_path: Path) -> None:
    editor = Editor(write_project(tmp_path), capabilities=lsp.ClientCapabilities())
    edit = asked(editor, "Arm.idsl", "interface A|rm", "Manipulator")
    assert set(edit.changes or {}) == {
        editor.uri(name) for name in ("Arm.idsl", "arm/arm.cdsl", "chess/chess.cdsl", "game.ddsl")
    }
    assert editor.leave() == 0
