"""Whatever stands in the texts and comments of models, what is made of them does the same."""

from __future__ import annotations

import ast
import json
import re
import tomllib
from functools import cache, lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

import pytest
from hypothesis import example, given, settings

from robocomp_py import plugins
from robocomp_py.codegen.exporting import Files
from robocomp_py.codegen.formats import export
from robocomp_py.codegen.generate import Artifact, Model, generate
from robocomp_py.dsl.diagnostics import Report
from robocomp_py.dsl.idsl.model import File as IdslFile
from robocomp_py.dsl.workspace import LinkedComponent, Workspace, read_file
from tests.hostile import FOR_COMMENTS, FOR_QUOTES, NASTY, texts_for_comments, texts_for_quotes

IDSL = """
/* %(comment)s */
module RoboCompArm
{
    /** %(comment)s */
    const string name = "%(quoted)s";
    /** %(comment)s */
    enum Mode { /** %(comment)s */ fast, slow };
    /** %(comment)s */
    struct Joint { /** %(comment)s */ string name = "%(quoted)s"; float angle; /* %(comment)s */ };
    /** %(comment)s */
    exception Stuck { /** %(comment)s */ string why = "%(quoted)s"; };
    /** %(comment)s */
    interface Arm
    {
        /** %(comment)s */
        void move(string how, Joint where) throws Stuck;
    };
};
"""
PDSL = """
/* %(comment)s */
ComponentParams arm
{
    device "%(quoted)s" string "%(quoted)s";     /* %(comment)s */
    mode "%(quoted)s" enum "x%(quoted)s" { "x%(quoted)s", other };
    rate "%(quoted)s" int 10 1:1000;
    List motors "%(quoted)s" { label string "%(quoted)s"; };
};
"""
SMDSL = """
/* %(comment)s */
arm { states moving, resting; initial_state start; end_state finish; /* %(comment)s */
transitions { start => moving; moving => resting; resting => finish; }; };
"""
CDSL = """
/* %(comment)s */
import "Arm.idsl";
Component arm
{
    Communications { implements Arm; /* %(comment)s */ requires Arm; };
    language python;
    params "arm.pdsl";
    statemachine "arm.smdsl";
};
"""
FOLDER = Path("/models")


def files(comment: str, quoted: str) -> dict[Path, str]:
    texts = {"Arm.idsl": IDSL, "arm.pdsl": PDSL, "arm.smdsl": SMDSL, "arm.cdsl": CDSL}
    said = {"comment": f"a {comment} z", "quoted": f"a {quoted} z"}
    return {FOLDER / name: text % said for name, text in texts.items()}


def workspace(texts: dict[Path, str]) -> Workspace:
    def read(path: Path) -> bytes:
        return texts[path].encode() if path in texts else read_file(path)

    return Workspace(read=read)


@lru_cache(2)  # the plain one, and that of the test
def linked(comment: str, quoted: str) -> LinkedComponent:
    found = workspace(files(comment, quoted))
    component = found.component(FOLDER / "arm.cdsl")
    assert component, "\n".join(each.render() for each in found.report.diagnostics)
    return component


def generated(comment: str, quoted: str, cdsl: str = "arm.cdsl") -> tuple[Artifact, ...]:
    of = linked(comment, quoted)
    return generate(Model(of.component, of.modules, cdsl, of.params, "dds", of.statemachine))


def skeleton(artifact: Artifact) -> Any:
    """What a file does, whatever texts are in it."""
    match artifact.path.suffix:
        case ".py":
            return python(artifact.text)
        case ".toml":
            return shape(tomllib.loads(artifact.text))
        case ".json":
            return shape(json.loads(artifact.text))
        case ".idl":
            return bare(artifact.text)
        case ".md":
            return [line for line in artifact.text.split("\n") if line.startswith(("#", "```", "|--"))]
        case _:
            return None


def python(text: str) -> str:
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            node.value = "text"
    return ast.dump(tree)


def shape(value: object) -> object:
    """Keys and types; of the values only what is no text."""
    match value:
        case dict():
            return {key: shape(each) for key, each in value.items()}
        case list():
            return [shape(each) for each in value]
        case str():
            return "text"
        case _:
            return value


@cache
def plain() -> list[tuple[PurePosixPath, Any]]:
    """What harmless texts come to."""
    return [(each.path, skeleton(each)) for each in generated("plain", "plain")]


def check(comment: str, quoted: str) -> dict[str, str]:
    """What is made does what is made of harmless texts; its files by name."""
    made = generated(comment, quoted)
    assert [(each.path, skeleton(each)) for each in made] == plain()
    return {str(each.path): each.text for each in made}


@pytest.mark.parametrize("text", FOR_COMMENTS)
def test_a_comment_of_a_model_is_text_in_what_is_generated(text: str) -> None:
    check(text, "plain")


@pytest.mark.parametrize("text", FOR_QUOTES)
def test_a_text_of_a_model_is_the_same_text_in_what_is_generated(text: str) -> None:
    found = check("plain", text)
    assert tomllib.loads(found["etc/config.toml"])["params"]["device"] == f"a {text} z"
    module = next(text for path, text in found.items() if path.endswith("RoboCompArm.py"))
    constants = [node.value for node in ast.walk(ast.parse(module)) if isinstance(node, ast.Constant)]
    assert f"a {text} z" in constants


@settings(max_examples=40)
@given(texts_for_comments, texts_for_quotes)
@example("", f"[{chr(0x7F) * 8}")  # a long text with a bracket
def test_any_text_of_a_model_is_the_same_text_in_what_is_generated(comment: str, quoted: str) -> None:
    check(comment, quoted)


@pytest.mark.parametrize("name", NASTY)
def test_the_name_of_a_file_is_text_in_what_is_generated(name: str) -> None:
    made = generated("plain", "plain", f"{name}.cdsl")
    assert [(each.path, skeleton(each)) for each in made if each.path.suffix == ".py"] == [
        (path, said) for path, said in plain() if path.suffix == ".py"
    ]


# Other languages.

_OTHER = re.compile(r'"(?:[^"\\\n]|\\.)*"|//[^\n]*|/\*.*?\*/', re.DOTALL)


def bare(text: str) -> list[str]:
    """A file of Slice or of OMG IDL without its texts and comments, word for word."""
    return _OTHER.sub(" ", text).split()


def ros(text: str) -> list[str]:
    """A file of ROS without its comments, and its values without their texts."""
    lines = [line.split("#")[0].rstrip() for line in text.split("\n")]
    return [re.sub(r"(string \w+ ?=?).*", r"\1", line) for line in lines if line]


@pytest.mark.parametrize("to", plugins.exporters())
@pytest.mark.parametrize("text", FOR_QUOTES)
def test_a_text_is_text_in_other_languages_too_or_is_refused(to: str, text: str) -> None:
    read = ros if to == "rosmsg" else bare
    harmless, _ = exported(to, "plain", "plain")
    made, refused = exported(to, text.replace("*/", ""), text)
    if not refused:
        assert {path: read(each) for path, each in made.items()} == {
            path: read(each) for path, each in harmless.items()
        }


@pytest.mark.parametrize("to", plugins.exporters())
@pytest.mark.parametrize("text", FOR_COMMENTS)
def test_a_comment_is_one_in_other_languages_too(to: str, text: str) -> None:
    read = ros if to == "rosmsg" else bare
    harmless, _ = exported(to, "plain", "plain")
    made, refused = exported(to, text, "plain")
    assert not refused
    assert {path: read(each) for path, each in made.items()} == {path: read(each) for path, each in harmless.items()}


@lru_cache(2)
def interfaces(comment: str, quoted: str) -> tuple[IdslFile, ...]:
    found = workspace(files(comment, quoted))
    read = found.interface_files(FOLDER / "Arm.idsl")
    assert read, "\n".join(each.render() for each in found.report.diagnostics)
    return tuple(read)


@cache
def exported(to: str, comment: str, quoted: str) -> tuple[dict[PurePosixPath, str], bool]:
    """The files, and whether anything was refused."""
    report = Report()
    made = export(Files(interfaces(comment, quoted)), to, report)
    return {each.path: each.text for each in made}, bool(report.errors)
