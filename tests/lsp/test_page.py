"""The files of editors/ are what those editors read, and start the server."""

from __future__ import annotations

import json
import re
import tomllib
from xml.etree import ElementTree

from robocomp_py.cli import lsp
from robocomp_py.dsl.workspace import ENDINGS
from tests.docs.pages import ROOT

EDITORS = ROOT / "editors"
LANGUAGES = [ending.removeprefix(".") for ending in ENDINGS]


def read(name: str) -> str:
    return (EDITORS / name).read_text(encoding="utf-8")


def test_the_page_names_every_file() -> None:
    page = (ROOT / "docs" / "guides" / "editors.md").read_text(encoding="utf-8")
    files = [path for path in EDITORS.glob("*/*") if path.parent.name != "vscode"]
    assert files
    assert not [path for path in files if f"`{path.relative_to(EDITORS)}`" not in page]


def test_helix_serves_every_language() -> None:
    settings = tomllib.loads(read("helix/languages.toml"))
    server = settings["language-server"]["robocomp"]
    assert [server["command"], *server["args"]] == ["rc", lsp.NAME]
    served = {
        each["name"]: each["file-types"] for each in settings["language"] if each["language-servers"] == ["robocomp"]
    }
    assert served == {name: [name] for name in LANGUAGES}


def test_kate_serves_the_language_that_its_definition_defines() -> None:
    language = ElementTree.fromstring(read("kate/robocomp.xml"))
    server = json.loads(read("kate/lsp.json"))["servers"]["robocomp"]
    assert server["command"] == ["rc", lsp.NAME]
    assert re.fullmatch(server["highlightingModeRegex"], language.attrib["name"])
    assert language.attrib["extensions"].split(";") == [f"*{ending}" for ending in ENDINGS]


def test_neovim_and_emacs_serve_every_language() -> None:
    lua, elisp = read("neovim/init.lua"), read("emacs/robocomp.el")
    assert re.findall(r'"(\w+)"', lua.partition("}")[0]) == LANGUAGES
    assert 'cmd = { "rc", "lsp" }' in lua
    assert re.findall(r"[a-z]*dsl", elisp.partition("auto-mode-alist")[2].partition("\n")[0]) == LANGUAGES
    assert '("rc" "lsp" ' in elisp
    assert elisp.count("(") == elisp.count(")")
