"""`rcgen` with nothing to do: told from a record of the last run, which never hides a change."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from robocomp_py import installed
from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.codegen import unchanged
from robocomp_py.codegen.unchanged import Request, Trace, digest, generator, up_to_date

from ..remembered import entry_points
from .generated import snapshot

CDSL = """\
import "Arm.idsl"; import "Hand.idsl";
Component arm
{
    Communications { implements Arm; publishes Hand; };
    language python;
    params "arm.pdsl";
    statemachine "arm.smdsl";
};
"""
ARM = 'import "Pose.idsl"; module RoboCompArm { interface Arm { RoboCompPose::Pose where(); }; };\n'
POSE = "module RoboCompPose { struct Pose { float x; float y; }; };\n"
HAND = "module RoboCompHand { interface Hand { [publish] void closed(bool tight); }; };\n"
PDSL = 'import "more.pdsl"; ComponentParams arm { speed float 0.5 0:2; };\n'
MORE = "ComponentParams more { gain float 0.5 0:2; };\n"
SMDSL = "arm { initial_state still; };"

WORKER = """\
from .base import Base
from .generic.genericworker import GenericWorker


class SpecificWorker(Base, GenericWorker):
    pass
"""
BASE = """\
class Base:
    def Arm_where(self):
        return None

    def sm_still(self):
        pass
"""

Said = pytest.CaptureFixture[str]


@pytest.fixture
def shared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which imports are looked for, with Pose.idsl in it."""
    folder = tmp_path / "shared"
    folder.mkdir()
    (folder / "Pose.idsl").write_text(POSE)
    monkeypatch.setenv("ROBOCOMP_INTERFACES", str(folder))
    return folder


@pytest.fixture
def arm(tmp_path: Path, shared: Path, capsys: Said) -> Path:
    """The folder of a component that is up to date."""
    cdsl = tmp_path / "arm" / "arm.cdsl"
    cdsl.parent.mkdir()
    models = {
        "arm.cdsl": CDSL,
        "Arm.idsl": ARM,
        "Hand.idsl": HAND,
        "arm.pdsl": PDSL,
        "more.pdsl": MORE,
        "arm.smdsl": SMDSL,
    }
    for name, text in (models | {"base.py": BASE, "specificworker.py": WORKER}).items():
        (cdsl.parent / name).write_text(text)
    assert rcgen([str(cdsl)]) == 0
    assert is_known(cdsl.parent)
    capsys.readouterr()
    return cdsl.parent


def is_known(folder: Path, *include: Path) -> bool:
    """Whether a record says that a component is up to date."""
    return up_to_date(Request((folder / "arm.cdsl",), include), generator()) is not None


def edit(path: Path, before: str, after: str) -> None:
    """Change a text, but neither its size nor its times."""
    text, times = path.read_text(), path.stat()
    assert before in text
    assert len(before) == len(after)
    path.write_text(text.replace(before, after))
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def as_link(path: Path) -> None:
    """Move a file or folder away, and leave a link to it."""
    away = path.parents[1] / f"away-{path.name}"
    path.rename(away)
    path.symlink_to(away)


# Nothing has changed.


def test_a_second_run_loads_no_generator_and_prints_the_same(arm: Path, capsys: Said) -> None:
    code = f"""if True:
        import sys
        from robocomp_py.cli.rcgen import main
        for _ in range(2):
            assert main([{str(arm / "arm.cdsl")!r}]) == 0
            print(*sorted({{"lark", "jinja2", "numpy"}} & set(sys.modules)), flush=True)
            print("modules")
    """
    for loaded in ("jinja2 lark", ""):  # -c changes what is imported from where, so the first run does not know
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=arm, check=True)
        line = f"arm: up to date in {arm}/ (auto)\n"
        assert (done.stdout, done.stderr) == (f"{line}{loaded}\nmodules\n" * 2, "")
    before = snapshot(arm)
    assert rcgen([str(arm / "arm.cdsl")]) == 0
    assert (capsys.readouterr(), snapshot(arm)) == ((line, ""), before)


def test_all_forms_of_output_are_those_of_a_run_without_a_record(arm: Path, capsys: Said) -> None:
    cdsl = str(arm / "arm.cdsl")
    for options in ([], ["--json"], ["--check"], ["--stubs"], ["--middleware", "auto"]):
        assert is_known(arm)
        assert rcgen([cdsl, *options]) == 0
        short = capsys.readouterr()
        shutil.rmtree(arm / "__pycache__")
        assert rcgen([cdsl, *options]) == 0
        assert capsys.readouterr() == short
        assert is_known(arm) is ("--check" not in options)
        assert rcgen([cdsl]) == 0
        capsys.readouterr()


def test_the_choice_of_a_middleware_is_printed_as_without_a_record(arm: Path, capsys: Said) -> None:
    cdsl = str(arm / "arm.cdsl")
    for options, said in (
        (["--middleware", "zeromq"], "1 written in {arm}/ (zeromq)"),
        ([], "up to date in {arm}/ (zeromq, as before)"),
        (["--middleware", "zeromq"], "up to date in {arm}/ (zeromq)"),
        (["--middleware", "auto"], "1 written in {arm}/ (auto)"),
        ([], "up to date in {arm}/ (auto)"),
    ):
        assert rcgen([cdsl, *options]) == 0
        found = capsys.readouterr().out
        assert said.format(arm=arm).partition(" ")[2] in found
        assert is_known(arm)


# Something has.

CHANGES: dict[str, Callable[[Path, Path], object]] = {
    "the component": lambda arm, _: edit(arm / "arm.cdsl", "publishes Hand", "requires  Hand"),
    "an interface": lambda arm, _: edit(arm / "Hand.idsl", "bool tight", "bool loose"),
    "an interface that another imports": lambda _, shared: edit(shared / "Pose.idsl", "float x", "float z"),
    "the parameters": lambda arm, _: edit(arm / "arm.pdsl", "float 0.5", "float 0.7"),
    "parameters that others import": lambda arm, _: edit(arm / "more.pdsl", "float 0.5", "float 0.7"),
    "the state machine": lambda arm, _: edit(arm / "arm.smdsl", "still", "quiet"),
    "only a comment": lambda arm, _: (arm / "Hand.idsl").write_text(f"// Closes.\n{HAND}"),
    "a new file that hides an import": lambda arm, _: (arm / "Pose.idsl").write_text(POSE.replace("x", "z")),
    "an import that is gone": lambda _, shared: (shared / "Pose.idsl").unlink(),
    "an import that is a link now": lambda arm, _: as_link(arm / "Hand.idsl"),
    "a file that is a folder now": lambda arm, _: [(arm / "arm.pdsl").unlink(), (arm / "arm.pdsl").mkdir()],
    "a file that is a pipe now": lambda arm, _: [(arm / "arm.pdsl").unlink(), os.mkfifo(arm / "arm.pdsl")],
    "a generated file": lambda arm, _: edit(arm / "generic" / "fakes.py", "import", "IMPORT"),
    "a generated file that is gone": lambda arm, _: (arm / "generic" / "params.py").unlink(),
    "a generated file that is a link now": lambda arm, _: as_link(arm / "generic" / "params.py"),
    "a generated file deeper inside": lambda arm, _: (arm / "generic/zeromq/channels.json").unlink(),
    "the generic part": lambda arm, _: shutil.rmtree(arm / "generic"),
    "the generic part, which is a link now": lambda arm, _: as_link(arm / "generic"),
    "a file that is generated no more": lambda arm, _: shutil.copy(arm / "generic/params.py", arm / "generic/old.py"),
    "the configuration, which is gone": lambda arm, _: (arm / "etc" / "config.toml").unlink(),
    "the tests, which are gone": lambda arm, _: shutil.rmtree(arm / "tests"),
    "a folder that is a link now": lambda arm, _: as_link(arm / "etc"),
    "the specific part": lambda arm, _: edit(arm / "specificworker.py", "class S", "class s"),
    "the specific part, which is gone": lambda arm, _: (arm / "specificworker.py").unlink(),
    "a class that the specific part inherits from": lambda arm, _: edit(arm / "base.py", "Arm_where", "Arm_which"),
    "what a killed run left behind": lambda arm, _: (arm / ".rcgen-x").mkdir(),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_is_seen(change: str, arm: Path, shared: Path, capsys: Said) -> None:
    CHANGES[change](arm, shared)
    assert not is_known(arm)
    cdsl = str(arm / "arm.cdsl")
    with_record = (rcgen(["--check", cdsl]), capsys.readouterr())
    shutil.rmtree(arm / "__pycache__")
    assert (rcgen(["--check", cdsl]), capsys.readouterr()) == with_record


def test_an_include_folder_more_is_seen(arm: Path, tmp_path: Path) -> None:
    assert not is_known(arm, tmp_path)


@pytest.mark.parametrize("name", ["ROBOCOMP_INTERFACES", "ROBOCOMP", "HOME"])
def test_another_search_path_is_seen(name: str, arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(name, str(tmp_path / "elsewhere"))
    assert not is_known(arm)


def test_another_working_directory_is_seen(arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert not is_known(arm)


def test_another_output_folder_is_seen(arm: Path, tmp_path: Path) -> None:
    assert up_to_date(Request((arm / "arm.cdsl",), output=tmp_path / "out"), generator()) is None


def test_a_folder_with_a_second_model_is_seen(arm: Path, capsys: Said) -> None:
    (arm / "__pycache__" / "arm.cdsl.rcgen").unlink()
    for _ in range(2):
        assert rcgen([str(arm)]) == 0
    assert up_to_date(Request((arm,)), generator()) is not None
    (arm / "arm.cdsl").rename(arm / "left.cdsl")
    assert up_to_date(Request((arm,)), generator()) is None
    (arm / "left.cdsl").rename(arm / "arm.cdsl")
    (arm / "right.cdsl").write_text(CDSL)
    assert up_to_date(Request((arm,)), generator()) is None


def test_a_component_more_in_a_network_is_seen(arm: Path, capsys: Said) -> None:
    net = arm.parent / "net.ddsl"
    net.write_text('import "arm/arm.cdsl"; Deployment net { Component arm {}; };')
    assert rcgen([str(net)]) == 0
    assert [each.name for each in up_to_date(Request((net,)), generator()) or ()] == ["arm"]
    shutil.copytree(arm, arm.parent / "leg")
    net.write_text('import "arm/arm.cdsl"; import "leg/arm.cdsl"; Deployment net { Component arm {}; };')
    assert up_to_date(Request((net,)), generator()) is None


def test_a_plan_sees_what_is_out_of_date(arm: Path, shared: Path, capsys: Said) -> None:
    net = arm.parent / "net.ddsl"
    net.write_text('import "arm/arm.cdsl"; Deployment net { Component arm {}; };')
    assert rcgen([str(net)]) == 0
    record = net.parent / "__pycache__" / "net.ddsl.rcgen"
    before = record.read_bytes()
    assert rcdeploy(["plan", str(net)]) == 0
    with_record = capsys.readouterr()
    record.unlink()
    assert rcdeploy(["plan", str(net)]) == 0
    assert with_record.out.endswith(capsys.readouterr().out)
    assert not record.exists()
    for change, code in (
        (lambda: edit(shared / "Pose.idsl", "float x", "float z"), "out-of-date"),
        (lambda: edit(shared / "Pose.idsl", "float z", "float x"), ""),
        (lambda: edit(arm / "generic" / "fakes.py", "import", "IMPORT"), "out-of-date"),
        (lambda: edit(arm / "generic" / "fakes.py", "IMPORT", "import"), ""),
        (lambda: edit(arm / "base.py", "Arm_where", "Arm_which"), "missing-handler"),
    ):
        change()
        record.write_bytes(before)
        assert rcdeploy(["plan", str(net)]) == bool(code)
        assert (f"error[{code}]" in capsys.readouterr().err) is bool(code)


def test_a_changed_generator_is_seen(tmp_path: Path) -> None:
    own = tmp_path / "robocomp_py"
    shutil.copytree(Path(unchanged.__file__).parent, own / "codegen", ignore=shutil.ignore_patterns("__pycache__"))
    before = generator(own)
    edit(own / "codegen" / "templates" / "genericworker.py.j2", "class", "CLASS")
    changed = generator(own)
    (own / "codegen" / "templates" / "more.j2").touch()
    assert len({before, changed, generator(own)}) == 3
    (own / "codegen" / "__pycache__").mkdir()
    (own / "codegen" / "__pycache__" / "more.pyc").touch()
    assert generator(own) == generator(own)


def test_what_is_installed_beside_it_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installed, "entry_points", entry_points)  # not remembered, as it is in other tests
    package = tmp_path / "plug_in_of_unchanged"
    package.mkdir()
    (package / "__init__.py").write_text("def native(uses, about): return {}, {}\n")
    seen = [generator()]
    monkeypatch.syspath_prepend(tmp_path)
    seen.append(generator())
    info = tmp_path / "plug_in_of_unchanged-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: plug-in-of-unchanged\nVersion: 1.0\n")
    seen.append(generator())
    (info / "entry_points.txt").write_text("[robocomp_py.natives]\nfoo = plug_in_of_unchanged:native\n")
    seen.append(generator())
    edit(package / "__init__.py", "{}, {}", "{}, []")
    seen.append(generator())
    info.rename(tmp_path / "plug_in_of_unchanged-1.1.dist-info")
    seen.append(generator())
    assert len(set(seen)) == len(seen)
    assert generator() == seen[-1]


# What is not recorded.


def test_a_warning_is_repeated_in_every_run(arm: Path, capsys: Said) -> None:
    (arm / "Hand.idsl").write_bytes(f"// \xe4\n{HAND}".encode("latin-1"))
    for _ in range(3):
        assert rcgen([str(arm / "arm.cdsl")]) == 0
        assert "warning[not-utf8]" in capsys.readouterr().err
        assert not is_known(arm)


def test_a_missing_handler_is_repeated_in_every_run(arm: Path, capsys: Said) -> None:
    (arm / "base.py").write_text("class Base: ...\n")
    for form in ([], [], ["--json"], ["--json"]):
        assert rcgen([str(arm / "arm.cdsl"), *form]) == 0
        said = capsys.readouterr()
        assert "missing-handler" in said.out + said.err
        assert not is_known(arm)


def test_a_file_that_changes_between_two_reads_is_not_recorded(tmp_path: Path) -> None:
    texts = iter([b"before", b"before", b"after"])
    trace = Trace(lambda _: next(texts))
    path = tmp_path / "file"
    path.touch()
    for is_steady in (True, True, False):
        trace.read(path)
        assert trace.is_steady is is_steady


# The record itself.


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: data[:-1],
        lambda data: data[: len(data) // 2],
        lambda data: data.replace(b'"files"', b'"flies"'),
        lambda data: b"\xff" * 100,
        lambda data: sealed(b"[]"),
        lambda data: sealed(b"{"),
        lambda data: sealed(json.dumps(json.loads(data.partition(b"\n")[2]) | {"components": [1]}).encode()),
        lambda data: sealed(json.dumps(json.loads(data.partition(b"\n")[2]) | {"files": {"a": 1}}).encode()),
        lambda data: sealed(json.dumps(json.loads(data.partition(b"\n")[2]) | {"listings": {"/none": []}}).encode()),
    ],
)
def test_a_damaged_record_is_ignored_and_written_again(
    damage: Callable[[bytes], bytes], arm: Path, capsys: Said
) -> None:
    record = arm / "__pycache__" / "arm.cdsl.rcgen"
    data = record.read_bytes()
    record.write_bytes(damage(data))
    assert not is_known(arm)
    assert rcgen([str(arm / "arm.cdsl")]) == 0
    assert capsys.readouterr() == (f"arm: up to date in {arm}/ (auto)\n", "")
    assert record.read_bytes() == data


def sealed(body: bytes) -> bytes:
    """A record with the right digest."""
    return digest(body).encode() + b"\n" + body


def test_a_record_that_cannot_be_written_is_left_out(arm: Path, capsys: Said) -> None:
    shutil.rmtree(arm / "__pycache__")
    (arm / "__pycache__").touch()
    for _ in range(2):
        assert rcgen([str(arm / "arm.cdsl")]) == 0
        assert capsys.readouterr() == (f"arm: up to date in {arm}/ (auto)\n", "")


def test_nothing_else_stays_behind(arm: Path) -> None:
    assert rcgen([str(arm / "arm.cdsl")]) == 0
    assert [each.name for each in (arm / "__pycache__").iterdir()] == ["arm.cdsl.rcgen"]
