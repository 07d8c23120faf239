"""The extension for VS Code, as far as it can be judged without an editor; `make vscode` has the rest of its tests."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

import robocomp_py
from robocomp_py.contract.qos import PRESETS, Durability, History, Liveliness, Reliability
from robocomp_py.dsl.cdsl.model import SECONDS
from robocomp_py.dsl.idsl.check import BUILTIN
from robocomp_py.dsl.source import Source
from robocomp_py.dsl.syntax import Grammar
from robocomp_py.dsl.workspace import Workspace, read_file

from .snippets import expand, most_choices

EXTENSION = Path(__file__).parents[2] / "editors" / "vscode"
LANGUAGES = ("idsl", "cdsl", "pdsl", "ddsl", "smdsl")

WHOLE = "%s"
IN_MODULE = "module RoboCompTest { %s };"
IN_INTERFACE = IN_MODULE % "interface Test { %s };"
IN_COMPONENT = 'import "Laser.idsl"; import "LaserPub.idsl"; Component test { language python; %s };'
IN_COMMUNICATIONS = IN_COMPONENT % "Communications { %s };"
IN_PARAMS = "ComponentParams test { %s };"
IN_DEPLOYMENT = 'import "camera/camera.cdsl"; Deployment test { %s };'
IN_INSTANCE = IN_DEPLOYMENT % "Component world { }; Component test : camera { %s };"
MACHINE = "test { states compute; initial_state start; end_state finalize; transitions { start => compute; %s }; };"

AROUND = {
    "idsl": {
        "Module with an interface": WHOLE,
        "Import": f"%s {IN_MODULE % ''}",
        "Interface": IN_MODULE,
        "Query": IN_INTERFACE,
        "Query with outputs": IN_INTERFACE,
        "Command": IN_INTERFACE,
        "Action": IN_INTERFACE,
        "Publication": IN_INTERFACE,
        "Struct": IN_MODULE,
        "Enum": IN_MODULE,
        "Exception": IN_MODULE,
        "Sequence": IN_MODULE,
        "Records": IN_MODULE % "struct TPoint { float x; }; %s",
        "Dictionary": IN_MODULE,
        "Constant": IN_MODULE,
    },
    "cdsl": {
        "Component": WHOLE,
        "Import": "%s Component test { language python; };",
        "Communications": IN_COMPONENT,
        "Requires": IN_COMMUNICATIONS,
        "Implements": IN_COMMUNICATIONS,
        "Publishes": IN_COMMUNICATIONS,
        "Subscribes to": IN_COMMUNICATIONS,
        "Publishes, with QoS": IN_COMMUNICATIONS,
        "Parameters": IN_COMPONENT,
        "State machine": IN_COMPONENT,
        "Period": IN_COMPONENT,
        "Timer": IN_COMPONENT,
    },
    "pdsl": {
        "Parameters": WHOLE,
        "Import": f"%s {IN_PARAMS % ''}",
        "Number": IN_PARAMS,
        "Integer": IN_PARAMS,
        "String": IN_PARAMS,
        "Mandatory string": IN_PARAMS,
        "Bool": IN_PARAMS,
        "Enum": IN_PARAMS,
        "List": IN_PARAMS,
    },
    "ddsl": {
        "Deployment": WHOLE,
        "Import": "%s Deployment test { };",
        "Component": IN_DEPLOYMENT,
        "Middleware": IN_DEPLOYMENT,
        "Namespace": IN_DEPLOYMENT,
        "Dependences": IN_INSTANCE,
        "Process": IN_INSTANCE,
        "QoS": IN_INSTANCE,
        "Wiring": IN_INSTANCE,
        "Program": IN_INSTANCE,
        "Variable": IN_INSTANCE,
        "Port": IN_INSTANCE,
        "Host": IN_DEPLOYMENT,
        "On a host": IN_INSTANCE.replace("Deployment test {", "Deployment test { host onboard { address base; };"),
        "System": IN_DEPLOYMENT,
        "Restart": IN_INSTANCE,
        "Escalation": IN_DEPLOYMENT.replace("%s", "restart always; %s Component test : camera { };"),
        "Security": IN_DEPLOYMENT,
        "Existing": IN_INSTANCE,
        "Notifies": IN_INSTANCE.replace("%s", 'existing "sleep 60"; %s'),
        "Grace": IN_INSTANCE,
        "Named instance": IN_INSTANCE,
        "Allow": "Deployment test { %s Component world : world { }; };",
        "Clock": "Deployment test { %s Component world : world { }; };",
    },
    "smdsl": {
        "State machine": WHOLE,
        "Inside of a state": f"{MACHINE % 'compute => finalize;'} %s",
        "Parallel states": f"{MACHINE % 'compute => finalize;'} %s",
        "Transition": MACHINE,
    },
}
"""Where each snippet is used."""

BESIDE = {
    "common.pdsl": "ComponentParams common { };",
    "test.pdsl": IN_PARAMS % "",
    "test.smdsl": MACHINE % "compute => finalize;",
}
"""Files that snippets expect."""


def read_json(path: str) -> Any:
    return json.loads((EXTENSION / path).read_text(encoding="utf-8"))


def bodies(language: str) -> dict[str, str]:
    """The snippets' texts."""
    found = read_json(f"snippets/{language}.json")
    return {name: body if isinstance(body := each["body"], str) else "\n".join(body) for name, each in found.items()}


def expansions() -> Iterator[tuple[str, str, int]]:
    for language in LANGUAGES:
        for name, body in bodies(language).items():
            yield from ((language, name, choice) for choice in range(most_choices(body)))


@pytest.mark.parametrize(("language", "name", "choice"), list(expansions()))
def test_a_snippet_as_it_is_proposed_has_nothing_that_is_complained_of(
    language: str, name: str, choice: int, tmp_path: Path
) -> None:
    path = tmp_path / f"test.{language}"
    text = AROUND[language][name] % expand(bodies(language)[name], path.stem, choice)
    files = {**{tmp_path / beside: content for beside, content in BESIDE.items()}, path: text}

    def read(asked: Path) -> bytes:
        return files[asked].encode() if asked in files else read_file(asked)

    workspace = Workspace(read=read)
    workspace.check(path)
    assert [f"{each.span.text}: {each.message}" for each in workspace.report.diagnostics] == []


@pytest.mark.parametrize("language", LANGUAGES)
def test_where_a_snippet_is_used_is_known_for_those_there_are(language: str) -> None:
    assert set(AROUND[language]) == set(bodies(language))


def patterns(language: str, rule: str) -> list[re.Pattern[str]]:
    """The expressions of a rule of a grammar, which here mean the same in Python."""
    found = read_json(f"syntaxes/{language}.tmLanguage.json")["repository"][rule]
    return [re.compile(each["match"]) for each in found.get("patterns", [found]) if "match" in each]


def missing(words: Iterable[str], language: str, rule: str) -> list[str]:
    return [word for word in words if not any(each.fullmatch(word) for each in patterns(language, rule))]


def test_the_grammar_knows_every_built_in_type() -> None:
    assert missing([*BUILTIN, "void"], "idsl", "built-in") == []


def test_the_grammar_knows_every_word_of_qos() -> None:
    values = [str(each) for kind in (Reliability, Durability, History, Liveliness) for each in kind]
    settings = ["depth", "deadline", "lifespan", "lease", "liveliness"]
    assert missing([*PRESETS, *values, *settings], "cdsl", "qos-word") == []


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_syntax_file_has_every_keyword_of_the_grammar(language: str) -> None:
    rules = [
        (EXTENSION / f"syntaxes/{each}.tmLanguage.json").read_text(encoding="utf-8") for each in (language, "common")
    ]
    written = re.sub(r"\\\\.", " ", "".join(rules))
    keywords = {word for kind, word in Grammar(language).keywords.items() if not kind.startswith("LEGACY")}
    if language == "ddsl":
        keywords -= words_that_begin_clauses()
    assert sorted(word for word in keywords if not re.search(rf"\b{word}\b", written, re.I)) == []


def words_that_begin_clauses() -> set[str]:
    """Those of DDSL that the syntax file knows by their place, so that a new clause needs no change of it."""
    begin = read_json("syntaxes/ddsl.tmLanguage.json")["repository"]["clause"]["begin"]
    blocks = ("", "Component arm { ", "System left { ", "host onboard { ")
    sources = (Source(Path("net.ddsl"), f"Deployment net {{ {block}") for block in blocks)
    words = {word for each in sources for word in Grammar("ddsl").words_behind(each)}
    assert words >= {"security", "existing", "restart", "workdir"}
    return {word for word in words if re.fullmatch(begin, word)}


def test_the_grammar_knows_every_unit_of_time() -> None:
    assert missing([f"50 {unit}" for unit in SECONDS], "cdsl", "duration") == []


def test_the_extension_has_the_version_of_the_package() -> None:
    manifest, lock = read_json("package.json"), read_json("package-lock.json")
    assert manifest["version"] == lock["version"] == lock["packages"][""]["version"] == robocomp_py.__version__


def test_the_lock_file_says_what_to_get_and_not_from_where() -> None:
    packages = read_json("package-lock.json")["packages"]
    assert [name for name, each in packages.items() if name and "integrity" not in each] == []
    assert [name for name, each in packages.items() if "resolved" in each] == []
