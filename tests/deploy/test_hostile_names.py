"""Whatever stands in the texts of a network, it stays a text: no shell, no other option, no other file, no markup."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings

from robocomp_py.deploy.plan import Host, Plan
from robocomp_py.deploy.planner import make_plan
from robocomp_py.dsl.ddsl.model import Deployment
from robocomp_py.dsl.ddsl.parser import parse
from robocomp_py.dsl.diagnostics import Report
from robocomp_py.dsl.source import Source
from robocomp_py.dsl.workspace import Workspace
from robocomp_py.graph import netsvg, nettext
from robocomp_py.graph.network import graph_of
from robocomp_py.testing.patience import SOON
from tests.hostile import FOR_QUOTES, NASTY, texts_for_quotes

from .planned import errors, plan

SHOWN = """\
import json, os, sys
json.dump([sys.argv[1:], os.environ["TEXT"]], open("shown.json", "w"))
"""


def read(text: str) -> tuple[Deployment | None, Report]:
    report = Report()
    return parse(Source(Path("net.ddsl"), text), report), report


# Arguments, environments, commands.


def check_given(folder: Path, text: str) -> None:
    """A text is given to a program as it is, whichever way."""
    quoted = shlex.quote(text)
    if '"' in quoted:  # which our quotes cannot hold: a single quote is quoted so by shlex
        quoted = "'" + text.replace("'", "'\\''") + "'"
    found, diagnostics = plan(
        folder,
        f'Component a : sensor {{ args "{text}"; env TEXT "{text}"; }};'
        f'Component b : sensor {{ existing "sleep {quoted}"; args "{text}"; }};',
    )
    assert found is not None, [each.message for each in diagnostics]
    ours, other = found.processes
    assert ours.command[-1] == text
    assert ours.env == {"TEXT": text}
    assert other.command == ("sleep", text, text)


@pytest.mark.parametrize("text", FOR_QUOTES)
def test_a_program_is_given_the_text_that_is_written(folder: Path, text: str) -> None:
    check_given(folder, text)


@settings(max_examples=25)
@given(texts_for_quotes)
def test_a_program_is_given_any_text_as_it_is_written(components: Path, text: str) -> None:
    if text != "+":
        check_given(components, text)


def test_what_separates_components_is_no_argument_of_one(folder: Path) -> None:
    assert errors(folder, 'Component sensor { args "+", "/tmp"; };') == ["configuration"]


@pytest.mark.parametrize("clause", ['args "a\0b"', 'env TEXT "\0"', 'path "\0"', 'config "\0"', 'existing "a \0"'])
def test_a_zero_is_refused(folder: Path, clause: str) -> None:
    assert "bad-command" in errors(folder, f"Component sensor {{ {clause}; }};")


def test_no_shell_sees_any_of_it(tmp_path: Path) -> None:
    (tmp_path / "show.cdsl").write_text("Component show { language python; };")
    (tmp_path / "show.py").write_text(SHOWN)
    texts = [text for text in FOR_QUOTES if text.isprintable()]
    arguments = ", ".join(f'"{text}"' for text in texts)
    (tmp_path / "net.ddsl").write_text(
        f'import "show.cdsl"; Deployment net {{ Component show {{ existing "{sys.executable} ./show.py"; '
        f'args {arguments}; env TEXT "$(touch owned)"; }}; }};'
    )
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", str(tmp_path / "net.ddsl"), "--until", "show"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SOON * 6, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "shown.json").read_text()) == [texts, "$(touch owned)"]
    assert not (tmp_path / "owned").exists()


# Names, and files.

PLACES = [
    "Deployment {} {{ }};",
    "Deployment net {{ Component {} {{ }}; }};",
    "Deployment net {{ Component a : {} {{ }}; }};",
    "Deployment net {{ System {} {{ }}; }};",
    "Deployment net {{ host {} {{ address a; }}; }};",
    "Deployment net {{ Component a {{ process {}; }}; }};",
    "Deployment net {{ namespace {}; }};",
    "Deployment net {{ middleware {}; }};",
    "Deployment net {{ Component a {{ dependences {}; }}; }};",
    'Deployment net {{ Component a {{ env {} "x"; }}; }};',
]
HARMLESS = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*\Z", re.ASCII)


@pytest.mark.parametrize("place", PLACES)
def test_names_are_made_of_letters_digits_and_underscores(place: str) -> None:
    for text in (
        "../up",
        "a/../../b",
        "/etc/passwd.d",
        "a b",
        "a;b",
        "$a",
        "a'b",
        "a-b",
        "a.b",
        "\u0430",
        "{{a}}",
        *NASTY,
    ):
        _, report = read(place.format(text))
        assert report.errors or HARMLESS.match(text.strip()) or not text.split("//")[0].strip(), text


@pytest.mark.parametrize("text", FOR_QUOTES)
def test_a_file_that_is_named_is_that_file_or_missing(folder: Path, text: str) -> None:
    found = errors(folder, f'Component a : sensor {{ config "{text}"; }}; Component b : sensor {{ path "{text}"; }};')
    assert set(found) <= {"missing-file", "not-executable", "config-syntax", "configuration", "config-unknown-key"}
    assert found
    workspace = Workspace()
    (folder / "net.ddsl").write_text(f'import "{text}"; Deployment net {{ }};')
    assert make_plan(folder / "net.ddsl", workspace) is None


@pytest.mark.parametrize("text", FOR_QUOTES)
def test_a_host_is_described_by_what_no_command_takes_for_something_else(text: str) -> None:
    workspace = Workspace(read=lambda path: said.encode())
    for clause in ("address", "user", "workdir", "python"):
        said = f'Deployment net {{ host far {{ address "10.0.0.1"; {clause} "{text}"; }}; }};'
        workspace = Workspace(read=lambda path: said.encode())  # noqa: B023  (it is read at once)
        workspace.deployment(Path("/net.ddsl"))
        wrong = {each.code for each in workspace.report.errors} - {"duplicate"}
        allowed = {"workdir": r"/(?!.*\.\.)[^\x00-\x1f]*", "user": r"\w[\w.-]*", "python": r"[\w/][\w./+-]*"}
        assert wrong or re.fullmatch(allowed.get(clause, r"\w[\w.:-]*"), text), (clause, text)


# Pictures.


def drawn(folder: Path, text: str) -> Plan:
    """A plan in which a text stands wherever a plan has one, whether a file could say it or not."""
    found, _ = plan(folder, "Component sensor { }; Component driver { }; System left { Component more : driver { }; };")
    assert found is not None

    def named(name: str) -> str:
        return f"{name} {text} z"

    processes = tuple(
        replace(each, name=named(each.name), component=named(each.component), host=named("far"), system=(named("s"),))
        for each in found.processes
    )
    links = tuple(
        replace(each, interface=named(each.interface), provider=named(each.provider), client=named(each.client))
        for each in found.links
    )
    ways = tuple(
        replace(each, client=named(each.client), provider=named(each.provider), interface=named(each.interface))
        for each in found.ways
    )
    hosts = (Host(named("far"), named("10.0.0.1")),)
    return replace(found, name=named("net"), processes=processes, links=links, ways=ways, hosts=hosts)


def tags(picture: str) -> list[tuple[str, list[str]]]:
    return [(each.tag, sorted(each.attrib)) for each in ElementTree.fromstring(picture).iter()]


def unquoted(text: str) -> list[str]:
    """A picture in words without its texts, a word a line."""
    return re.sub(r'"(?:[^"\\]|\\.)*"', "T", text, flags=re.DOTALL).split()


IN_PICTURES = [each for each in NASTY if "/" not in each]  # slashes are systems there


@pytest.mark.parametrize("text", IN_PICTURES)
def test_a_text_is_a_text_in_a_picture(folder: Path, text: str) -> None:
    plain, nasty = graph_of(drawn(folder, "plain")), graph_of(drawn(folder, text))
    kinds = {tag for tag, _ in tags(netsvg.draw(plain))}
    assert {tag for tag, _ in tags(netsvg.draw(nasty))} <= kinds
    assert unquoted(nettext.dot(nasty)) == unquoted(nettext.dot(plain))
    mermaid = nettext.mermaid(nasty)
    assert unquoted(mermaid) == unquoted(nettext.mermaid(plain))
    assert len(mermaid.splitlines()) == len(nettext.mermaid(plain).splitlines())
