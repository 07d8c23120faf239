"""A session ends properly, whichever side ends it, and survives any message."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from lsprotocol import types as lsp
from pygls.exceptions import JsonRpcException

from robocomp_py.testing.patience import SOON

from ..leftovers import killed_on_failure
from .conftest import FILES, write_project
from .editor import COMMAND, Editor, position


def test_an_editor_that_says_good_bye_leaves_no_process(tmp_path: Path) -> None:
    assert Editor(write_project(tmp_path)).leave() == 0


def test_an_editor_that_vanishes_leaves_no_process(tmp_path: Path) -> None:
    assert Editor(write_project(tmp_path)).vanish() == 1


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_it(number: signal.Signals) -> None:
    with killed_on_failure(
        COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        assert process.stdin
        assert process.stdout
        process.stdin.write(message(id=1, method="initialize", params={"capabilities": {}}))
        process.stdin.flush()
        assert process.stdout.readline().startswith(b"Content-Length")
        os.kill(process.pid, number)
        assert process.wait(3 * SOON) == -number


def test_unknown_messages_are_survived(editor: Editor) -> None:
    async def nonsense() -> object:
        return await editor.client.protocol.send_request_async("robocomp/nothing", {})

    with pytest.raises(JsonRpcException, match="Method Not Found"):
        editor.ask(nonsense())
    editor.client.protocol.notify("robocomp/nothing", {})
    assert editor.open("Joints.idsl") == []


def test_a_change_of_an_unopened_file_is_logged_and_survived(editor: Editor) -> None:
    document = lsp.VersionedTextDocumentIdentifier(3, editor.uri("never.idsl"))
    change = lsp.TextDocumentContentChangeWholeDocument("module")
    editor.client.text_document_did_change(lsp.DidChangeTextDocumentParams(document, [change]))
    editor.until(lambda: bool(editor.mistakes))
    editor.mistakes.clear()
    assert editor.open("Joints.idsl") == []


def test_a_cancelled_request_does_not_disturb_others(editor: Editor) -> None:
    editor.open("Arm.idsl")
    parameters = lsp.HoverParams(**editor.at("Arm.idsl", "interface A|rm"))
    editor.client.protocol.notify(lsp.CANCEL_REQUEST, lsp.CancelParams(12345))
    assert editor.ask(editor.client.text_document_hover_async(parameters)) is not None


def test_many_changes_end_in_the_diagnostics_of_the_last_one(editor: Editor) -> None:
    editor.open("M.idsl", "module M {};\n")
    for number in range(50):
        editor.type("M.idsl", "module M {};\n" + "x" * number)
    assert editor.change("M.idsl", "module M {};\n") == []


@pytest.mark.parametrize("name", [name for name in FILES if name.endswith("dsl")])
def test_no_text_that_is_being_written_makes_it_stumble(editor: Editor, name: str) -> None:
    for end in range(0, len(FILES[name]), 11):
        text = FILES[name][:end]
        editor.change(name, text) if name in editor.texts else editor.open(name, text)
        at = {"text_document": editor.identifier(name), "position": position(text, end)}
        editor.ask(editor.client.text_document_completion_async(lsp.CompletionParams(**at)))
        editor.ask(editor.client.text_document_hover_async(lsp.HoverParams(**at)))
        editor.ask(editor.client.text_document_document_symbol_async(lsp.DocumentSymbolParams(at["text_document"])))
        editor.ask(
            editor.client.text_document_semantic_tokens_full_async(lsp.SemanticTokensParams(at["text_document"]))
        )


def test_without_its_library_it_says_what_to_install(tmp_path: Path) -> None:
    (tmp_path / "pygls.py").write_text("raise ModuleNotFoundError(\"No module named 'pygls'\", name='pygls')\n")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(COMMAND, input="", capture_output=True, text=True, env=environment, check=False)
    assert (done.returncode, done.stderr) == (
        1,
        "rc lsp: the language server needs pygls; run: pip install 'robocomp-py[lsp]'\n",
    )


def test_what_is_no_message_is_complained_about_on_stderr_only() -> None:
    done = subprocess.run(COMMAND, input=b"hello\r\n\r\n", capture_output=True, check=False)
    assert done.stdout == b""


def message(**content: object) -> bytes:
    body = json.dumps({"jsonrpc": "2.0", **content}).encode()
    return b"Content-Length: %d\r\n\r\n%s" % (len(body), body)


def test_the_command_is_one_of_rc() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "robocomp_py.cli.rc", "--help"], capture_output=True, text=True, check=True
    )
    assert "lsp" in done.stdout
