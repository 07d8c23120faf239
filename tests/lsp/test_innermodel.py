"""InnerModel files in an editor: diagnostics, hover, completion, outline, and files that are named."""

from __future__ import annotations

from pathlib import Path

import pytest
from lsprotocol import types as lsp

from robocomp_py.dsl.innermodel.check import declared_encoding, is_root
from robocomp_py.dsl.source import Source
from robocomp_py.lsp import innermodel
from robocomp_py.lsp.complete import Candidate
from robocomp_py.lsp.elements import outline
from robocomp_py.lsp.outline import Symbol

from .editor import Editor

ROOM = """\
<?xml version="1.0"?>
<!-- a room -->
<innerModel>
  <transform id="world" tx="1">
    <include path="robot.xml"/>
    <laser id="front" measures="360" angle="3" max="4000"/>
    <mesh id="cup" file="cup.obj"/>
  </transform>
</innerModel>
"""
ROBOT = '<innerModel><differentialrobot id="base"/></innerModel>\n'


def completed(marked: str, path: Path = Path("room.xml")) -> dict[str, Candidate]:
    """The proposals at `|`."""
    before, _, behind = marked.partition("|")
    return {each.label: each for each in innermodel.complete(Source(path, before + behind), len(before))}


def hovered(marked: str) -> str:
    before, _, behind = marked.partition("|")
    return innermodel.hover(Source(Path("room.xml"), before + behind), len(before))


# What is proposed.


def test_tags_are_proposed_with_their_meaning() -> None:
    found = completed('<innerModel><transform id="a"><la|')
    assert found["laser"].detail == "a laser scanner in the plane of x and z"
    assert "innermodel" not in found
    assert found["laser"].over
    assert found["laser"].over.text == "la"
    assert "laser" in completed("<innerModel><|")
    assert "laser" in completed("<innerModel>\n  <|\n  <transform id='a'/>\n</innerModel>")


def test_nothing_is_proposed_where_nothing_may_be() -> None:
    assert completed('<innerModel><laser id="a"><tr|') == {}
    assert completed("<innerModel> | </innerModel>") == {}
    assert completed("<innerModel><!-- <tr| --></innerModel>") == {}
    assert list(completed("<|")) == ["innerModel"]


def test_attributes_are_proposed_that_are_not_yet_written() -> None:
    found = completed('<innerModel><laser id="a" me|')
    assert found["measures"].detail == "number of rays"
    assert "id" not in found
    assert "tx" not in found
    assert found["measures"].over
    assert found["measures"].over.text == "me"
    assert {"id", "tx", "mass"} <= completed('<innerModel>\n  <transform |tz="1">').keys()
    assert completed('<innerModel><laser id="a"/>|') == {}
    ranks = {name: each.rank for name, each in completed("<innerModel><joint |").items()}
    assert ranks["id"] < ranks["port"] < ranks["lx"]


@pytest.mark.parametrize(
    ("marked", "words"),
    [
        ('<innerModel><joint id="a" axis="|"', ["x", "y", "z"]),
        ('<innerModel><transform id="a" engine="st|atic">', ["static", "bullet"]),
        ("<innerModel><plane id='a' collide='|'/>", ["0", "1"]),
        ('<innerModel><touchsensor id="a" type="|"/>', ["bumper"]),
        ('<innerModel><laser id="|"/>', []),
        ('<innerModel><lazer id="|"/>', []),
    ],
)
def test_values_are_proposed(marked: str, words: list[str]) -> None:
    assert list(completed(marked)) == words


def test_an_end_tag_closes_what_is_open() -> None:
    assert list(completed('<innerModel><transform id="a"><laser id="b"/></|')) == ["transform>"]
    assert list(completed('<innerModel><transform id="a"></transform></inn|')) == ["innerModel>"]


def test_files_are_proposed(tmp_path: Path) -> None:
    for name in ("room.xml", "robot.xml", "cup.obj", "wood.png", "notes.txt", "parts/arm.xml", "parts/hand.stl"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    path = tmp_path / "room.xml"
    assert list(completed('<innerModel><include path="|"', path)) == ["parts/", "robot.xml"]
    assert list(completed('<innerModel><include path="parts/|"', path)) == ["parts/arm.xml"]
    assert list(completed('<innerModel><mesh id="a" file="parts/h|"', path)) == ["parts/hand.stl"]
    assert list(completed('<innerModel><plane id="a" texture="|"', path)) == ["parts/", "wood.png"]
    assert list(completed('<innerModel><mesh id="a" file="none/|"', path)) == []


# What is said.


def test_tags_and_attributes_are_explained_with_units() -> None:
    assert hovered("<innerModel><las|er").startswith("`<laser>`: a laser scanner in the plane of x and z")
    assert "It has no children." in hovered("<innerModel><las|er")
    assert (
        hovered('<innerModel><TRANSFORM t|x="1"')
        == "`tx` of `<transform>`: translation along x, mm\n\na number; default `0`"
    )
    assert "the whole field of view, rad" in hovered('<innerModel><laser angle="1.|5"')
    assert "default `2500`" in hovered("<innerModel><plane si|ze='1'")
    assert hovered('<innerModel><laser |colour="red"/>') == ""
    assert hovered("<innerModel> te|xt") == ""
    assert hovered("<lay|er/>") == ""


# The nodes of a file.


def shown(symbols: tuple[Symbol, ...]) -> list[object]:
    return [(each.name.text, each.detail, shown(each.children)) for each in symbols]


def test_the_outline_has_ids_and_tags() -> None:
    made = outline(Source(Path("room.xml"), ROOM))
    inside = [("robot.xml", "include", []), ("front", "laser", []), ("cup", "mesh", [])]
    assert shown(made.symbols) == [("innerModel", "", [("world", "transform", inside)])]
    assert made.symbols[0].children[0].span.text.startswith('<transform id="world"')
    assert made.symbols[0].children[0].span.text.endswith("</transform>")
    assert [link.name.text for link in made.links] == ["robot.xml", "cup.obj"]


def test_tags_that_cross_or_are_missing_are_read_as_far_as_they_go() -> None:
    made = outline(
        Source(Path("a.xml"), '<innerModel><joint id="a"><joint id="b"></joint><laser id="c"/></innerModel>')
    )
    assert shown(made.symbols) == [("innerModel", "", [("a", "joint", [("b", "joint", []), ("c", "laser", [])])])]


def test_no_text_that_is_being_written_makes_it_stumble() -> None:
    for end in range(0, len(ROOM), 2):
        for text in (ROOM[:end], ROOM[:end] + ROOM[end + 1 :], ROOM[:end] + '"<' + ROOM[end:]):
            source = Source(Path("room.xml"), text)
            made = outline(source)
            assert all(0 <= each.span.start <= each.span.end <= len(text) for each in made.walk())
            innermodel.hover(source, end)
            innermodel.complete(source, end)
    deep = Source(Path("a.xml"), "<innerModel>" + "<transform>" * 5000)
    assert len(list(outline(deep).walk())) == 5001


@pytest.mark.parametrize(
    ("text", "is_it"),
    [
        (ROOM, True),
        ("\ufeff<INNERMODEL/>", True),
        ("<!DOCTYPE x>\n<innermodel>", True),
        ("<!-- <innerModel> --><svg/>", False),
        ("<svg><innerModel/></svg>", False),
        ("<innerModels/>", False),
        ("", False),
    ],
)
def test_only_its_root_makes_a_file_an_innermodel(text: str, *, is_it: bool) -> None:
    assert is_root(text) is is_it


def test_the_declared_encoding_counts() -> None:
    assert declared_encoding('<?xml version="1.0" encoding="ISO-8859-1"?>') == "iso8859-1"
    assert declared_encoding('<?xml version="1.0" encoding="klingon"?>') == "utf-8"
    assert declared_encoding("<innerModel/>") == "utf-8"


# In a session.


def test_mistakes_are_told_while_they_are_written(editor: Editor) -> None:
    (editor.folder / "robot.xml").write_text(ROBOT)
    text = ROOM.replace('<mesh id="cup" file="cup.obj"/>', "")
    assert editor.open("room.xml", text) == []
    [found] = editor.change("room.xml", text.replace("tx=", "tix="))
    assert (found.code, found.severity) == ("unknown-attribute", lsp.DiagnosticSeverity.Error)
    assert found.message.endswith("did you mean `tx`?")
    assert [each.code for each in editor.change("room.xml", text.replace("</transform>", ""))] == ["syntax"]
    assert editor.open("picture.xml", "<svg><lazer/></svg>") == []
    accents = '<?xml version="1.0" encoding="iso-8859-1"?>\n<innerModel><transform id="ñandú" tix="1"/></innerModel>'
    [found] = editor.open("accents.xml", accents)
    assert editor.text_in("accents.xml", found.range) == "tix"


def test_mistakes_of_an_included_file_are_told_where_it_is_included(editor: Editor) -> None:
    (editor.folder / "robot.xml").write_text(ROBOT)
    name, text = editor.uri("room.xml"), ROOM.replace('<mesh id="cup" file="cup.obj"/>', "")
    assert editor.open("room.xml", text) == []
    editor.open("robot.xml", ROBOT.replace("differential", "diferential"))
    editor.until(lambda: [each.code for each in editor.published[name][-1].diagnostics] == ["broken-import"])
    [found] = editor.published[name][-1].diagnostics
    assert editor.text_in("room.xml", found.range) == "robot.xml"
    editor.change("robot.xml", ROBOT.replace("base", "front"))
    editor.until(lambda: [each.code for each in editor.published[name][-1].diagnostics] == ["repeated-id"])


def test_an_editor_is_answered(editor: Editor) -> None:
    (editor.folder / "robot.xml").write_text(ROBOT)
    editor.open("room.xml", ROOM)
    client = editor.client
    hover = editor.ask(client.text_document_hover_async(lsp.HoverParams(**editor.at("room.xml", "mea|sures="))))
    assert hover
    assert isinstance(hover.contents, lsp.MarkupContent)
    assert "number of rays" in hover.contents.value
    where = editor.at("room.xml", 'path="robot|.xml')
    links = editor.ask(client.text_document_definition_async(lsp.DefinitionParams(**where)))
    assert isinstance(links, list)
    assert [each.uri for each in links if isinstance(each, lsp.Location)] == [editor.uri("robot.xml")]
    found = editor.ask(client.text_document_completion_async(lsp.CompletionParams(**editor.at("room.xml", "<las|er"))))
    assert isinstance(found, lsp.CompletionList)
    [edit] = [each.text_edit for each in found.items if each.label == "rgbd"]
    assert isinstance(edit, lsp.TextEdit)
    assert '<rgbder id="front"' in editor.applied("room.xml", [edit])
    symbols = lsp.DocumentSymbolParams(editor.identifier("room.xml"))
    [root] = editor.ask(client.text_document_document_symbol_async(symbols)) or ()
    assert isinstance(root, lsp.DocumentSymbol)
    assert [each.name for each in (root.children or [])[0].children or ()] == ["robot.xml", "front", "cup"]
    tokens = lsp.SemanticTokensParams(editor.identifier("room.xml"))
    assert not editor.ask(client.text_document_semantic_tokens_full_async(tokens)).data  # type: ignore[union-attr]
    formatting = lsp.DocumentFormattingParams(
        editor.identifier("room.xml"), lsp.FormattingOptions(4, insert_spaces=True)
    )
    assert editor.ask(client.text_document_formatting_async(formatting)) is None
