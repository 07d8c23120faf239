"""What is wrong is told while it is typed, in the file it is in, and in those it matters to."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from lsprotocol import types as lsp

from .conftest import FILES, write_project
from .editor import Editor, position


def test_a_file_without_errors_has_no_diagnostics(editor: Editor) -> None:
    models = [name for name in FILES if name.endswith("dsl")]
    assert {name: editor.open(name) for name in models} == {name: [] for name in models}


def test_an_error_appears_when_it_is_typed_and_goes_when_it_is_corrected(editor: Editor) -> None:
    right = FILES["Joints.idsl"]
    editor.open("Joints.idsl")
    wrong = editor.change("Joints.idsl", right.replace("sequence<Joint>", "sequence<Joinr>"))
    assert [each.code for each in wrong] == ["unknown-type"]
    assert editor.change("Joints.idsl", right) == []


def test_a_diagnostic_says_where_how_bad_and_what_to_do(editor: Editor) -> None:
    text = FILES["Joints.idsl"].replace("sequence<Joint>", "sequence<Joinr>")
    (found,) = editor.open("Joints.idsl", text)
    assert editor.text_in("Joints.idsl", found.range) == "Joinr"
    assert found.severity is lsp.DiagnosticSeverity.Error
    assert found.message == "unknown type `Joinr`\ndid you mean `Joint`?"
    assert found.source == "robocomp"


def test_a_warning_is_shown_as_one(editor: Editor) -> None:
    (found,) = editor.open("Joints.idsl", FILES["Joints.idsl"].replace("string name;", "string name;;"))
    assert (found.code, found.severity) == ("stray-semicolon", lsp.DiagnosticSeverity.Warning)


def test_the_other_place_is_shown_with_its_file(editor: Editor) -> None:
    text = FILES["Joints.idsl"].replace("enum Mode", "enum Joint")
    (found,) = editor.open("Joints.idsl", text)
    (other,) = found.related_information or ()
    assert other.location.uri == editor.uri("Joints.idsl")
    assert other.location.range.start == position(text, text.index("Joint\n    {"))


def test_a_change_updates_the_files_that_import_it(editor: Editor) -> None:
    assert editor.open("Arm.idsl") == []
    editor.open("Joints.idsl")
    editor.change("Joints.idsl", FILES["Joints.idsl"].replace("exception Blocked", "exception Stuck"))
    editor.until(lambda: editor.codes("Arm.idsl") == ["unknown-exception"])
    editor.change("Joints.idsl", FILES["Joints.idsl"])
    editor.until(lambda: editor.codes("Arm.idsl") == [])


def test_a_network_is_checked_as_the_deployer_does(editor: Editor) -> None:
    text = FILES["game.ddsl"].replace("dependences left", "dependences chess")
    assert [each.code for each in editor.open("game.ddsl", text)] == ["dependence-cycle"]


def test_a_component_that_no_longer_provides_an_interface_is_reported_in_its_network(editor: Editor) -> None:
    editor.open("game.ddsl")
    editor.open("arm/arm.cdsl")
    editor.change("arm/arm.cdsl", FILES["arm/arm.cdsl"].replace("implements Arm;", ""))
    editor.until(lambda: "no-provider" in editor.codes("game.ddsl"))


def test_what_is_closed_has_no_diagnostics_any_more(editor: Editor) -> None:
    assert editor.open("Joints.idsl", "module") != []
    editor.close("Joints.idsl")
    editor.until(lambda: editor.codes("Joints.idsl") == [])


def test_what_is_closed_counts_as_it_is_on_the_disk(editor: Editor) -> None:
    editor.open("Joints.idsl", FILES["Joints.idsl"].replace("exception Blocked", "exception Stuck"))
    assert [each.code for each in editor.open("Arm.idsl")] == ["unknown-exception"]
    editor.close("Joints.idsl")
    editor.until(lambda: editor.codes("Arm.idsl") == [])


def test_a_file_changed_on_the_disk_is_read_again(editor: Editor) -> None:
    editor.open("Arm.idsl")
    path = editor.folder / "Joints.idsl"
    path.write_text(FILES["Joints.idsl"].replace("exception Blocked", "exception Stuck"))
    changed = lsp.FileEvent(editor.uri("Joints.idsl"), lsp.FileChangeType.Changed)
    editor.client.workspace_did_change_watched_files(lsp.DidChangeWatchedFilesParams([changed]))
    editor.until(lambda: editor.codes("Arm.idsl") == ["unknown-exception"])


def test_the_editor_is_asked_to_watch_the_disk(editor: Editor) -> None:
    editor.until(lambda: lsp.WORKSPACE_DID_CHANGE_WATCHED_FILES in editor.registered)


def test_an_import_that_brings_nothing_is_shown_as_unnecessary(editor: Editor) -> None:
    (found,) = editor.open("Joints.idsl", 'import "Speech.idsl";\n' + FILES["Joints.idsl"])
    assert (found.code, found.severity) == ("unused-import", lsp.DiagnosticSeverity.Hint)
    assert found.tags == (lsp.DiagnosticTag.Unnecessary,)


def test_an_import_with_mistakes_of_its_own_is_pointed_out_with_them(editor: Editor) -> None:
    editor.open("Joints.idsl", FILES["Joints.idsl"].replace("string name;", "strin name;"))
    found = {each.code: each for each in editor.open("arm/arm.cdsl")}["broken-import"]
    assert editor.text_in("arm/arm.cdsl", found.range) == "../Arm.idsl"
    assert found.severity == lsp.DiagnosticSeverity.Information
    (mistake,) = found.related_information or ()
    assert (mistake.location.uri, mistake.message) == (editor.uri("Joints.idsl"), "unknown type `strin`")


def test_no_import_is_called_unnecessary_while_something_is_wrong(editor: Editor) -> None:
    text = 'import "Speech.idsl";\n' + FILES["Joints.idsl"].replace("string name;", "string name")
    assert [each.code for each in editor.open("Joints.idsl", text)] == ["syntax"]


def test_columns_count_as_the_protocol_does(editor: Editor) -> None:
    text = "/* \N{ROBOT FACE}\N{ROBOT FACE} \xfc */ module M { struct S { Nothing n; }; };\n"
    (found,) = editor.open("M.idsl", text)
    assert found.range == lsp.Range(lsp.Position(0, 35), lsp.Position(0, 42))
    assert editor.text_in("M.idsl", found.range) == "Nothing"


def test_columns_count_code_points_with_an_editor_that_prefers_them(tmp_path: Path) -> None:
    general = lsp.GeneralClientCapabilities(position_encodings=[lsp.PositionEncodingKind.Utf32])
    editor = Editor(write_project(tmp_path), capabilities=lsp.ClientCapabilities(general=general))
    (found,) = editor.open("M.idsl", "/* \N{ROBOT FACE}\N{ROBOT FACE} */ module M { struct S { Nothing n; }; };\n")
    assert found.range.start == lsp.Position(0, 31)
    assert editor.leave() == 0


def test_a_byte_order_mark_that_the_editor_shows_counts(editor: Editor) -> None:
    text = "\ufeffmodule M { struct S { Nothing n; }; };\n"
    (found,) = editor.open("M.idsl", text)
    assert editor.text_in("M.idsl", found.range) == "Nothing"


def test_lines_end_as_the_protocol_says(editor: Editor) -> None:
    (found,) = editor.open("M.idsl", "module M\r{\r\n\f struct S { Nothing n; };\n};\n")
    assert found.range.start == lsp.Position(2, 13)


def test_include_folders_are_the_users(tmp_path: Path) -> None:
    folder = write_project(tmp_path / "project")
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "Far.idsl").write_text("module RoboCompFar { struct S { int i; }; };\n")
    text = 'import "Far.idsl";\nmodule M { sequence<RoboCompFar::S> All; };\n'
    editor = Editor(folder, options={"include": ["../more"]})
    assert editor.open("M.idsl", text) == []
    settings = lsp.DidChangeConfigurationParams({"robocomp": {"include": []}})
    editor.client.workspace_did_change_configuration(settings)
    editor.until(lambda: editor.codes("M.idsl") == ["missing-import"])
    assert editor.leave() == 0


def test_settings_of_others_change_nothing(tmp_path: Path) -> None:
    folder = write_project(tmp_path / "project")
    editor = Editor(folder / "arm", options={"include": [".."]})
    text = 'import "Joints.idsl";\nmodule M { sequence<RoboCompJoints::Joint> All; };\n'
    editor.open("M.idsl", text)
    for settings in (None, {}, {"pylsp": {"plugins": {}}}, {"robocomp": None}, {"robocomp": {}}, [1]):
        editor.client.workspace_did_change_configuration(lsp.DidChangeConfigurationParams(settings))
        text += "\n"
        assert editor.change("M.idsl", text) == [], settings
    assert editor.leave() == 0


def test_an_editor_that_can_do_little_is_served_as_well(tmp_path: Path) -> None:
    editor = Editor(write_project(tmp_path), capabilities=lsp.ClientCapabilities(), folders=[])
    assert [each.code for each in editor.open("Joints.idsl", "module")] == ["syntax"]
    assert editor.leave() == 0


def test_a_file_with_no_place_of_its_own_is_left_alone(editor: Editor) -> None:
    nowhere = ("git:/Joints.idsl?HEAD", "untitled:Untitled-1", "file:///Joints%00.idsl")
    for uri in nowhere:
        item = lsp.TextDocumentItem(uri, "idsl", 1, "module")
        editor.client.text_document_did_open(lsp.DidOpenTextDocumentParams(item))
    editor.open("Joints.idsl")
    assert not editor.published.keys() & nowhere


def test_a_pipe_that_is_imported_is_not_waited_for(editor: Editor) -> None:
    os.mkfifo(editor.folder / "Pipe.idsl")
    found = editor.open("M.idsl", 'import "Pipe.idsl";\nmodule M {};\n')
    assert [each.code for each in found] == ["missing-import"]


def test_a_missing_handler_is_reported_at_the_clause_that_needs_it(editor: Editor) -> None:
    worker = editor.folder / "arm" / "specificworker.py"
    states = "".join(f"    def sm_{name}(self): pass\n" for name in ("resting", "moving", "parked"))
    head = f"from .generic.genericworker import GenericWorker\nclass SpecificWorker(GenericWorker):\n{states}"
    worker.write_text(f"{head}    def Arm_getJoints(self): return []\n    def Arm_move(self, goal, speed): pass\n")
    found = {str(each.code): each for each in editor.open("arm/arm.cdsl")}
    assert found.keys() == {"missing-handler", "uncalled-handler"}
    missing = found["missing-handler"]
    assert editor.text_in("arm/arm.cdsl", missing.range) == "Arm"
    assert missing.message.startswith("`SpecificWorker` lacks `Arm_moveTo`, which `implements Arm` asks for")
    places = [each.location.uri for each in missing.related_information or ()]
    assert set(places) == {editor.uri("arm/specificworker.py")}
    worker.write_text(f"{head}    def Arm_getJoints(self): return []\n    def Arm_moveTo(self, goal, speed): pass\n")
    changed = lsp.FileEvent(editor.uri("arm/specificworker.py"), lsp.FileChangeType.Changed)
    editor.client.workspace_did_change_watched_files(lsp.DidChangeWatchedFilesParams([changed]))
    editor.until(lambda: editor.codes("arm/arm.cdsl") == [])


def test_a_configuration_is_checked_against_the_component_around_it(editor: Editor) -> None:
    assert editor.open("arm/etc/config.toml", "[component]\nperiod = 0.1\n") == []
    editor.change("arm/etc/config.toml", "[component]\nperid = 0.1\n")
    editor.until(lambda: editor.codes("arm/etc/config.toml") == ["config-unknown-key"])


@pytest.mark.parametrize("name", ["pyproject.toml", "arm/specificworker.py", "README.md", "config"])
def test_files_of_other_formats_have_no_diagnostics(editor: Editor, name: str) -> None:
    assert editor.open(name, "= not ours\n") == []
