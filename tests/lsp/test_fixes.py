"""What a diagnostic says is right can be done at a click, and the diagnostic is gone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import pytest
from lsprotocol import types as lsp

from robocomp_py.lsp.complaints import UNUSED_IMPORT
from tests.dsl.slugs import every_slug

from .conftest import FILES
from .editor import Editor
from .examples import write_examples

FIXABLE = {
    "ambiguous-provider",
    "bad-clock",
    "bad-default",
    "bad-period",
    "bad-qos",
    "bad-range",
    "bad-restart",
    "concurrent-proxy",
    "legacy-clause",
    "missing-file",
    "missing-import",
    "no-language",
    "not-python",
    "one-way-gives-back",
    "repeated-transition",
    "shadowed-name",
    "stray-directive",
    "stray-endif",
    "stray-semicolon",
    "syntax",
    "trailing-text",
    "unknown-component",
    "unknown-exception",
    "unknown-host",
    "unknown-instance",
    "unknown-interface",
    "unknown-middleware",
    "unknown-operation",
    "unknown-option",
    "unknown-port",
    "unknown-state",
    "unknown-type",
    UNUSED_IMPORT,
    "wrong-each",
    "wrong-offers",
    "wrong-policy",
}
"""Codes of which some diagnostics say what is right: a name that is close, a word that is missing or too many."""

NOT_FIXABLE = {
    # Which of two things is to go, or how it is to be called, is for people to say.
    "alike-in-omgidl",
    "ambiguous-interface",
    "duplicate",
    "duplicate-enumerator",
    "duplicate-value",
    "host-clash",
    "keyword-name",
    "overload",
    "port-clash",
    "reserved-name",
    "same-attribute",
    "same-port-name",
    "several-bases",
    "shared-enumerator",
    # There are several ways out, or something has to be thought of.
    "wrong-action",
    "ambiguous-port",
    "bad-command",
    "bad-host",
    "bad-key",
    "bad-port",
    "between-regions",
    "circular-base",
    "clause-of-parallel",
    "contract-mismatch",
    "dependence-cycle",
    "empty-deployment",
    "empty-enum",
    "empty-interface",
    "empty-port",
    "env-clash",
    "foreign-middleware",
    "import-cycle",
    "ineffective-escalation",
    "ineffective-gui",
    "ineffective-ip",
    "ineffective-option",
    "ineffective-qos",
    "insecure",
    "leaves-end-state",
    "middleware-mismatch",
    "missing-offers",
    "no-address",
    "no-initial-state",
    "no-states",
    "not-flat",
    "no-provider",
    "no-publisher",
    "not-a-program",
    "not-a-publication",
    "not-a-value-type",
    "not-an-exception",
    "not-an-interface",
    "out-of-range",
    "qos-mismatch",
    "qos-of-calls",
    "recursive-type",
    "state-in-itself",
    "throws-non-exception",
    "too-deep",
    "too-long",
    "unfit-middleware",
    "unreachable-state",
    "unshared-process",
    "void-type",
    "wrong-allow",
    "wrong-import",
    "wrong-verb",
    # It is not in the text that is open.
    "bad-import",
    "bad-state-name",
    "config-bad-address",
    "config-bad-name",
    "config-item-count",
    "config-missing",
    "config-not-understood",
    "config-out-of-range",
    "config-renamed-key",
    "config-syntax",
    "config-unknown-key",
    "config-unknown-value",
    "config-without-effect",
    "config-without-model",
    "config-wrong-type",
    "configuration",
    "ineffective-scxml",
    "lossy-in-omgidl",
    "lossy-in-rosmsg",
    "lossy-in-slice",
    "no-id",
    "not-executable",
    "not-generated",
    "not-in-omgidl",
    "not-in-rosmsg",
    "not-in-slice",
    "not-utf8",
    "out-of-date",
    "renamed-in-rosmsg",
    "several-targets",
    "too-large",
    "unknown-language",
    "unreadable",
    # `rc lint` finds it in InnerModel files, which the language server does not open.
    "cyclic-include",
    "foreign-root",
    "in-degrees",
    "missing-id",
    "missing-include",
    "missing-mesh",
    "missing-texture",
    "no-children",
    "read-otherwise",
    "repeated-id",
    "repeated-port",
    "unknown-attribute",
    "unfit-id",
    "unknown-tag",
    "without-effect",
    "wrong-colour",
    "wrong-value",
    # What is to be changed is Python code, which is not edited from here.
    "missing-handler",
    "missing-module",
    "python-syntax",
    "uncalled-handler",
    "wrong-handler",
}


def actions(editor: Editor, name: str, diagnostic: lsp.Diagnostic) -> list[lsp.CodeAction]:
    """What is offered for one diagnostic."""
    context = lsp.CodeActionContext([diagnostic])
    parameters = lsp.CodeActionParams(editor.identifier(name), diagnostic.range, context)
    found = editor.ask(editor.client.text_document_code_action_async(parameters))
    offered = [each for each in found or () if isinstance(each, lsp.CodeAction)]
    return [each for each in offered if list(each.diagnostics or ()) == [diagnostic]]


def done(editor: Editor, name: str, action: lsp.CodeAction) -> str:
    """The text when that was chosen."""
    assert action.edit
    (change,) = action.edit.document_changes or ()
    assert isinstance(change, lsp.TextDocumentEdit)
    assert change.text_document.uri == editor.uri(name)
    return editor.applied(name, [each for each in change.edits if isinstance(each, lsp.TextEdit)])


def counted(found: Sequence[lsp.Diagnostic]) -> Counter[tuple[object, str]]:
    return Counter((each.code, each.message) for each in found)


# All of them.


def test_it_is_settled_of_every_code_whether_it_can_be_fixed() -> None:
    assert not FIXABLE & NOT_FIXABLE
    assert every_slug() | {UNUSED_IMPORT} == FIXABLE | NOT_FIXABLE


def test_every_fix_takes_its_diagnostic_away_and_every_code_that_can_be_fixed_has_one(
    session: Editor, tmp_path: Path
) -> None:
    names = write_examples(tmp_path)
    session.move_to(tmp_path)
    fixed = set()
    for name in names:
        found = session.open(name)
        offered = [(each, action) for each in found for action in actions(session, name, each)]
        texts = [done(session, name, action) for _, action in offered]  # each by itself: of the file as it was
        for (diagnostic, action), text in zip(offered, texts, strict=True):
            complaint = (diagnostic.code, diagnostic.message)
            left = session.change(name, text)
            assert counted(left)[complaint] < counted(found)[complaint], f"{name}: {complaint}: {action.title}"
            fixed.add(diagnostic.code)
    assert fixed == FIXABLE


# Some of them.


@pytest.mark.parametrize(
    ("name", "right", "wrong", "title"),
    [
        ("Joints.idsl", "sequence<Joint>", "sequence<Joinr>", "Change to `Joint`"),
        ("Joints.idsl", "string name;", "string name", "Add `;`"),
        ("Joints.idsl", "string name;", "string name;;", "Remove `;`"),
        ("Arm.idsl", 'import "Joints.idsl";', 'import "Joint.idsl";', "Change to `Joints.idsl`"),
        ("arm/arm.cdsl", "implements Arm;", "implements Amr;", "Change to `Arm`"),
        ("arm/arm.cdsl", '"arm.pdsl"', '"amr.pdsl"', "Change to `arm.pdsl`"),
        ("arm/arm.pdsl", "enum soft {", "enum sotf {", "Change to `soft`"),
        ("arm/arm.smdsl", "moving => resting", "moving => restin", "Change to `resting`"),
        ("game.ddsl", "dependences left", "dependences lef", "Change to `left`"),
    ],
)
def test_a_slip_is_mended_as_it_was_meant(editor: Editor, name: str, right: str, wrong: str, title: str) -> None:
    (found,) = editor.open(name, FILES[name].replace(right, wrong))
    (action,) = actions(editor, name, found)
    assert (action.title, action.kind, action.is_preferred) == (title, lsp.CodeActionKind.QuickFix, True)
    assert done(editor, name, action) == FILES[name]


def test_a_missing_import_is_added_below_the_others(editor: Editor) -> None:
    text = FILES["arm/arm.cdsl"].replace("implements Arm;", "implements Arm;\n        requires Speech;")
    (found,) = editor.open("arm/arm.cdsl", text)
    (action,) = actions(editor, "arm/arm.cdsl", found)
    assert done(editor, "arm/arm.cdsl", action) == text.replace('Arm.idsl";', 'Arm.idsl";\nimport "Speech.idsl";')


def test_an_unused_import_is_removed_with_its_line(editor: Editor) -> None:
    text = FILES["Arm.idsl"].replace("import", 'import "Speech.idsl";\nimport', 1)
    (found,) = editor.open("Arm.idsl", text)
    (action,) = actions(editor, "Arm.idsl", found)
    assert (action.title, done(editor, "Arm.idsl", action)) == ("Remove this import", FILES["Arm.idsl"])


def test_a_component_that_the_project_has_is_imported(editor: Editor) -> None:
    text = FILES["game.ddsl"].replace('import "chess/chess.cdsl";\n', "")
    found = next(each for each in editor.open("game.ddsl", text) if each.code == "unknown-component")
    (action,) = actions(editor, "game.ddsl", found)
    assert action.title == 'Import "chess/chess.cdsl"'
    assert done(editor, "game.ddsl", action) == FILES["game.ddsl"]


def test_other_kinds_of_actions_are_not_answered_by_fixes(editor: Editor) -> None:
    (found,) = editor.open("Joints.idsl", FILES["Joints.idsl"].replace("sequence<Joint>", "sequence<Joinr>"))
    context = lsp.CodeActionContext([found], only=[lsp.CodeActionKind.SourceOrganizeImports])
    parameters = lsp.CodeActionParams(editor.identifier("Joints.idsl"), found.range, context)
    assert not editor.ask(editor.client.text_document_code_action_async(parameters))
