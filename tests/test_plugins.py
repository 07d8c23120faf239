"""Toy plug-ins for each hook: what other packages can add, and what is said when none of them offers it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from robocomp_py import installed, plugins
from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.errors import ComponentError, ConfigurationError
from robocomp_py.runtime import settings
from robocomp_py.runtime.load import load_worker
from robocomp_py.runtime.worker import Worker

from .docs.pages import ROOT, blocks

Said = pytest.CaptureFixture[str]
Install = Callable[[str, str], None]

CDSL = "Component toy { language python; };"
IDSL = "module Shop { interface Till { void open(); }; };"

READER = """
from robocomp_py.runtime.document import Document, Note

def find(folder):
    path = folder / "etc" / "toy.ini"
    return path if path.is_file() else None

def accepts(path, text):
    return path.suffix == ".ini"

def read(text, path, params, topics):
    lines = [line.split() for line in text.splitlines()]
    data = {"component": {"period": float(value) for key, value in lines if key == "seconds"}}
    notes = tuple(Note(key, number, ("component", "period")) for number, (key, _) in enumerate(lines, 1))
    return Document(data, path, text, params=params, notes=notes)
"""
LOADER = """
import importlib

def accepts(folder):
    return (folder / "robot.py").is_file()

def component(component):
    return component

def load(folder, package, *, alone):
    worker = importlib.import_module(f"{package}.generic.genericworker").GenericWorker
    robot = importlib.import_module(f"{package}.robot")
    return type("SpecificWorker", (worker,), {"compute": lambda self: robot.step(), "alone": alone})

class Told:
    def lines(self):
        yield "a toy, which steps"

    def to_json(self):
        return [{"what": "toy"}]

def adopted(component, model, found, folder, middleware):
    return Told()
"""
IMPORTER = """
endings = {".toys": "a list of toys"}

def to_ddsl(source, folder, report):
    return f"Deployment toys {{ Component {source.text.strip()} : toy {{ }}; }};\\n"
"""
EXPORTER = """
from pathlib import PurePosixPath
from robocomp_py.codegen.generate import Artifact

def write(files, report):
    names = [each.name.text for file in files.all for each in file.definitions]
    text = "\\n".join(["# Generated from IDSL by rcgen 0: edits are lost.", *names])
    return (Artifact(PurePosixPath("all.toys"), text),)
"""


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Installs a package of one module, `toys`, which has an entry point `toy` in a group."""
    site = tmp_path / "site"

    def install(group: str, text: str) -> None:
        information = site / "toys-1.0.dist-info"
        information.mkdir(parents=True)
        (information / "METADATA").write_text("Metadata-Version: 2.1\nName: toys\nVersion: 1.0\n")
        called = "toys:write" if group == plugins.EXPORTERS else "toys"
        (information / "entry_points.txt").write_text(f"[{group}]\ntoy = {called}\n")
        (site / "toys.py").write_text(text)
        monkeypatch.syspath_prepend(site)
        monkeypatch.delitem(sys.modules, "toys", raising=False)

    return install


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """No package offers anything."""
    monkeypatch.setattr(installed, "entry_points", list)


def generated(tmp_path: Path) -> Path:
    folder = tmp_path / "toy"
    folder.mkdir()
    (folder / "toy.cdsl").write_text(CDSL)
    assert rcgen([str(folder / "toy.cdsl")]) == 0
    return folder


def test_a_plug_in_reads_another_form_of_configuration(tmp_path: Path, install: Install) -> None:
    install(plugins.CONFIGURATIONS, READER)
    etc = tmp_path / "etc"
    etc.mkdir()
    (etc / "toy.ini").write_text("seconds 0.25\n")
    assert settings.find(tmp_path) == etc / "toy.ini"
    document = settings.read(etc / "toy.ini")
    assert document.data == {"component": {"period": 0.25}}
    assert [note.became for note in document.notes] == [("component", "period")]


def test_a_form_that_no_package_reads_is_refused(tmp_path: Path, alone: None) -> None:
    (tmp_path / "config").write_text("seconds 0.25\n")
    with pytest.raises(ConfigurationError, match="not valid TOML, and no installed package reads this"):
        settings.read(tmp_path / "config")


def test_the_checker_says_so_at_the_file(tmp_path: Path, alone: None, capsys: Said) -> None:
    (tmp_path / "toy.cdsl").write_text(CDSL)
    (tmp_path / "config").write_text("seconds 0.25\n")
    assert rc(["lint", str(tmp_path / "config")]) == 1
    assert "config:1:1: error[config-syntax]: not valid TOML, and no installed package" in capsys.readouterr().err


def test_a_plug_in_runs_a_component_for_another_framework(tmp_path: Path, install: Install, capsys: Said) -> None:
    install(plugins.WORKERS, LOADER)
    folder = tmp_path / "toy"
    folder.mkdir()
    (folder / "toy.cdsl").write_text(CDSL)
    (folder / "robot.py").write_text("def step():\n    return 'stepped'\n")
    assert rcgen([str(folder)]) == 0
    assert "\na toy, which steps\n" in capsys.readouterr().out
    assert not (folder / "specificworker.py").exists()
    worker = load_worker(folder, alone=True)
    assert issubclass(worker, Worker)
    assert worker.compute(worker.__new__(worker)) == "stepped"  # type: ignore[func-returns-value]
    assert vars(worker)["alone"]


def test_a_component_that_no_package_runs_is_refused(tmp_path: Path, alone: None) -> None:
    (tmp_path / "generic").mkdir()
    (tmp_path / "generic" / "genericworker.py").touch()
    with pytest.raises(ComponentError, match=r"it has no specificworker\.py, and no installed package runs it without"):
        load_worker(tmp_path)


def test_a_plug_in_imports_the_networks_of_another_tool(tmp_path: Path, install: Install, capsys: Said) -> None:
    install(plugins.IMPORTERS, IMPORTER)
    (tmp_path / "shelf.toys").write_text("bear\n")
    assert rcdeploy(["--import", str(tmp_path / "shelf.toys")]) == 0
    assert capsys.readouterr().out == "Deployment toys { Component bear : toy { }; };\n"


def test_a_network_that_no_package_imports_is_refused(tmp_path: Path, alone: None, capsys: Said) -> None:
    assert rcdeploy(["--import", str(tmp_path / "shelf.toys")]) == 1
    assert "shelf.toys: no installed package imports this kind of file; known: none" in capsys.readouterr().err


def test_a_plug_in_writes_interfaces_in_another_language(tmp_path: Path, install: Install) -> None:
    install(plugins.EXPORTERS, EXPORTER)
    (tmp_path / "Shop.idsl").write_text(IDSL)
    assert rcgen([str(tmp_path / "Shop.idsl"), "--to", "toy", "-o", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "all.toys").read_text().endswith("\nTill")


def test_the_example_of_the_page_is_a_plug_in(tmp_path: Path, install: Install) -> None:
    [text] = blocks(ROOT / "docs" / "guides" / "plugins.md", "python")
    install(plugins.EXPORTERS, text)
    (tmp_path / "Shop.idsl").write_text(IDSL)
    assert rcgen([str(tmp_path / "Shop.idsl"), "--to", "toy", "-o", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "Shop.proto").read_text() == "// Generated by rcgen for Shop\n"


def test_a_language_that_no_package_writes_is_refused(alone: None) -> None:
    with pytest.raises(ConfigurationError, match=r"no installed package has `toy` for robocomp_py\.exporters"):
        plugins.exporter("toy")


def test_a_plug_in_that_cannot_be_imported_is_named(install: Install) -> None:
    install(plugins.EXPORTERS, "import a_library_that_is_not_there")
    with pytest.raises(ConfigurationError, match=r"`toy` \(toys:write, for .*\) is not usable here"):
        plugins.exporter("toy")


@pytest.mark.parametrize("configured", [True, False])
def test_a_component_of_ours_imports_no_plug_in(tmp_path: Path, configured: bool) -> None:
    folder = generated(tmp_path)
    if not configured:
        (folder / "etc" / "config.toml").unlink()
    code = (
        "import sys; from pathlib import Path; from robocomp_py.runtime.load import load_worker; "
        "from robocomp_py.runtime.commandline import parser_of, prepare; "
        f"worker = load_worker(Path({str(folder)!r})); prepare(worker, parser_of(worker.component).parse_args([])); "
        "print(*sys.modules)"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "robocomp_py.runtime.commandline" in loaded
    assert [name for name in loaded if name.startswith("robocomp_py.classic")] == []
