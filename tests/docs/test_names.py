"""Options, files, modules and other names on the pages are those of the code."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
import tomllib
from contextlib import redirect_stdout, suppress
from functools import cache
from io import StringIO
from pathlib import Path

import pytest

from robocomp_py.cli import rc, rcdeploy, rcgen

from .pages import ROOT, blocks

DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md"] + [
    page for page in sorted(DOCS.rglob("*.md")) if not {"decisions", "diagnostics"} & {*page.parts}
]
CODES = {page.stem for page in (DOCS / "diagnostics").glob("*.md")}

PROGRAMS = {"rc": rc.main, "rcdeploy": rcdeploy.main, "rcgen": rcgen.main}
FOREIGN = frozenset(
    [
        "--shm-size",
        "--import-mode",
        "--quiet",
        "--qos",
        "--health",
        "--system-site-packages",
        "--user",
        "--output-dir",
        "--chdir",
        "--turbo",
        "--flag",
        "--what",
        "--stored",
        "--only",
        "--fast",
    ]
)
"""Options of other programs, of benchmarks and of examples."""

_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
_CODE = re.compile(r"```\w*\n(.*?)```|`([^`\n]+)`|^ {4}(\S[^\n]*)", re.DOTALL | re.MULTILINE)


@cache
def options(program: str) -> frozenset[str]:
    """What `--help` of a program and of its commands lists."""
    main = PROGRAMS[program]
    every = _help(main, [])
    for command in re.findall(r"^ {2,4}(\w+)  ", every, re.MULTILINE):
        every += (said := _help(main, [command]))
        for part in re.findall(r"^ {4}(\w+)  ", said, re.MULTILINE):  # as `view` of `rc sim`
            every += _help(main, [command, part])
    if program == "rc":  # lists its own options only for given components
        components = [str(ROOT / "components" / "wander"), "+", str(ROOT / "components" / "world2d")]
        command = [sys.executable, "-m", "robocomp_py.cli.rc", "run", *components, "--help"]
        every += subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return frozenset(_OPTION.findall(every))


def _help(main: object, command: list[str]) -> str:
    assert callable(main)
    with redirect_stdout(StringIO()) as said, suppress(SystemExit):
        main([*command, "--help"])
    return said.getvalue()


def lines_of_code(page: Path) -> list[str]:
    """Lines of blocks, and words in back-quotes."""
    found = _CODE.findall(page.read_text(encoding="utf-8"))
    return [line for each in found for line in "".join(each).splitlines()]


@pytest.fixture(params=PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def code(request: pytest.FixtureRequest) -> list[str]:
    return lines_of_code(request.param)


def test_options_are_listed_by_help(code: list[str]) -> None:
    every = frozenset[str]().union(*map(options, PROGRAMS), FOREIGN)
    unknown = []
    for line in code:
        command = line.removeprefix("$ ").partition("  #")[0]
        known = options(command.split()[0]) if command.split()[:1] and command.split()[0] in PROGRAMS else every
        unknown += [line for option in _OPTION.findall(command) if option not in known]
    assert unknown == []


def test_codes_of_diagnostics_have_a_page(code: list[str]) -> None:
    named = [
        found for line in code for found in re.findall(r"(?:error|warning)\[([a-z-]+)\]|--explain ([a-z-]+)", line)
    ]
    assert {a or b for a, b in named} <= CODES


def test_make_targets_exist(code: list[str]) -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert {line.split()[1] for line in code if re.match(r"make [a-z]", line)} <= targets


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_keys_of_configurations_are_those_of_the_reference(page: Path) -> None:
    """Other tests compare the reference with the code."""
    [toml] = blocks(DOCS / "reference" / "components.md", "toml")
    table = (DOCS / "reference" / "middlewares.md").read_text(encoding="utf-8")
    known = {("component", key) for key in tomllib.loads(toml)["component"]}
    known |= set(re.findall(r"^\| `(\w+)`: `(\w+)` \|", table, re.MULTILINE))
    named = {each for line in lines_of_code(page) for each in _KEY.findall(line)}
    for text in blocks(page, "toml"):
        document = tomllib.loads(text)
        tables = document.get("transports", {}) | {"component": document.get("component", {})}
        named |= {(name, key) for name, table in tables.items() for key in table}
    assert named <= known


_KEY = re.compile(r"\b(component(?=\.\w+=)|(?<=transports\.)[a-z]+)\.([a-z_]+)")


@cache
def sources() -> str:
    found = subprocess.run(["git", "ls-files", "robocomp_py"], cwd=ROOT, capture_output=True, text=True, check=True)
    files = [ROOT / name for name in found.stdout.split() if name.endswith((".py", ".j2"))]
    return "\n".join(path.read_text(encoding="utf-8") for path in files)


def test_variables_of_the_environment_are_read(code: list[str]) -> None:
    named = {name for line in code for name in re.findall(r"\bROBOCOMP_[A-Z]+\b", line)}
    assert {name for name in named if name not in sources()} == set()


def test_files_and_modules_of_the_project_exist(code: list[str]) -> None:
    files = {
        line for line in code if re.fullmatch(r"(robocomp_py|tests|examples|benchmarks|editors|docs)/[\w./-]+", line)
    }
    assert [name for name in files if not (ROOT / name).exists()] == []
    modules = {name for line in code for name in re.findall(r"\brobocomp_py(?:\.[a-z_]+)+", line)}
    groups = ("configurations", "workers", "importers", "exporters", "transports", "deployments")  # of entry points
    named = modules - {f"robocomp_py.{group}" for group in groups}
    assert [name for name in named if not _is_module(name) and not _is_module(name.rpartition(".")[0])] == []


def _is_module(name: str) -> bool:
    with suppress(ModuleNotFoundError):
        return importlib.util.find_spec(name) is not None
    return False
