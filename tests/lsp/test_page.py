"""What the page about editors gives to be copied is what those editors read, and starts the server."""

from __future__ import annotations

import json
import re
import tomllib
from xml.etree import ElementTree

from robocomp_py.cli import lsp
from robocomp_py.dsl.workspace import ENDINGS
from tests.docs.pages import ROOT, blocks

PAGE = ROOT / "docs" / "editors.md"
LANGUAGES = [ending.removeprefix(".") for ending in ENDINGS]


def test_helix_serves_every_language() -> None:
    [text] = blocks(PAGE, "toml")
    settings = tomllib.loads(text)
    server = settings["language-server"]["robocomp"]
    assert [server["command"], *server["args"]] == ["rc", lsp.NAME]
    served = {
        each["name"]: each["file-types"] for each in settings["language"] if each["language-servers"] == ["robocomp"]
    }
    assert served == {name: [name] for name in LANGUAGES}


def test_kate_serves_the_language_that_its_definition_defines() -> None:
    [definition], [text] = blocks(PAGE, "xml"), blocks(PAGE, "json")
    language = ElementTree.fromstring(definition)
    server = json.loads(text)["servers"]["robocomp"]
    assert server["command"] == ["rc", lsp.NAME]
    assert re.fullmatch(server["highlightingModeRegex"], language.attrib["name"])
    assert language.attrib["extensions"].split(";") == [f"*{ending}" for ending in ENDINGS]


def test_neovim_and_emacs_serve_every_language() -> None:
    [lua], [elisp] = blocks(PAGE, "lua"), blocks(PAGE, "elisp")
    assert re.findall(r'"(\w+)"', lua.partition("}")[0]) == LANGUAGES
    assert 'cmd = { "rc", "lsp" }' in lua
    assert re.findall(r"[a-z]*dsl", elisp.partition("auto-mode-alist")[2].partition("\n")[0]) == LANGUAGES
    assert '("rc" "lsp" ' in elisp
    assert elisp.count("(") == elisp.count(")")
