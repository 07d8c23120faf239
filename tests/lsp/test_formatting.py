"""A file is laid out in the project's style, and nothing is touched that has it."""

from __future__ import annotations

from collections.abc import Sequence

from lsprotocol import types as lsp

from .conftest import FILES
from .editor import Editor


def edits(editor: Editor, name: str) -> Sequence[lsp.TextEdit] | None:
    options = lsp.FormattingOptions(4, True)
    parameters = lsp.DocumentFormattingParams(editor.identifier(name), options)
    return editor.ask(editor.client.text_document_formatting_async(parameters))


def test_a_file_is_laid_out(editor: Editor) -> None:
    editor.open("Joints.idsl", FILES["Joints.idsl"].replace("    struct Joint\n    {\n", "struct   Joint{\n"))
    assert editor.applied("Joints.idsl", edits(editor, "Joints.idsl") or ()) == FILES["Joints.idsl"]


def test_only_lines_that_change_are_touched(editor: Editor) -> None:
    editor.open("Joints.idsl", FILES["Joints.idsl"].replace("string name;", "string   name ;"))
    (edit,) = edits(editor, "Joints.idsl") or ()
    assert (edit.range.start, edit.range.end) == (lsp.Position(5, 0), lsp.Position(6, 0))
    assert edit.new_text == "        string name;\n"


def test_a_file_in_style_is_left_alone(editor: Editor) -> None:
    editor.open("Joints.idsl")
    assert not edits(editor, "Joints.idsl")


def test_lines_end_as_they_did(editor: Editor) -> None:
    text = FILES["Joints.idsl"].replace("string name;", "string   name ;").replace("\n", "\r\n")
    editor.open("Joints.idsl", text)
    (edit,) = edits(editor, "Joints.idsl") or ()
    assert edit.new_text == "        string name;\r\n"


def test_a_file_with_wrong_syntax_is_left_alone(editor: Editor) -> None:
    editor.open("Joints.idsl", "module   M {")
    assert edits(editor, "Joints.idsl") is None


def test_a_file_of_thousands_of_lines_is_laid_out_as_well(editor: Editor) -> None:
    """Of which most are alike, and many change."""
    wrong = "".join(f"    struct S{n}{{\n        int x;\n        int y;\n    }};\n" for n in range(2000))
    right = "\n".join(f"    struct S{n}\n    {{\n        int x;\n        int y;\n    }};\n" for n in range(2000))
    editor.open("Long.idsl", f"module M\n{{\n{wrong}}};\n")
    lines = editor.texts["Long.idsl"].splitlines(keepends=True)
    for each in reversed(edits(editor, "Long.idsl") or ()):
        lines[each.range.start.line : each.range.end.line] = [each.new_text]
    assert "".join(lines) == f"module M\n{{\n{right}}};\n"
