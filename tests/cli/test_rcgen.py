"""`rcgen` as people use it: a model, its Python, an edit, its Python again."""

from __future__ import annotations

import fcntl
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.codegen.stubs import Stubs, find_stubs
from robocomp_py.dsl.workspace import read_file
from robocomp_py.errors import ComponentError
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing.components import ComponentTest

from ..codegen.generated import linked, loaded, model_in, snapshot

CDSL = """\
import "Arm.idsl"; import "Hand.idsl";
// Moves things.
Component arm
{
    Communications { implements Arm; publishes Hand; };
    language python;
    params "arm.pdsl";
    period 10 ms;
};
"""
ARM = """\
module RoboCompArm
{
    struct Pose { float x; float y; };
    interface Arm { Pose where(); void move(Pose to); };
};
"""
HAND = "module RoboCompHand { interface Hand { [publish] void closed(bool tight); }; };\n"
PDSL = "ComponentParams arm { speed float 0.5 0:2; };\n"

SPECIFIC = ["README.md", "__init__.py", "__main__.py", "etc/config.toml", "specificworker.py", "tests/test_arm.py"]
GENERIC = [f"generic/{name}.py" for name in ("RoboCompArm", "RoboCompHand", "__init__", "fakes")]
GENERIC += ["generic/genericworker.py", "generic/params.py"]
GENERIC += ["generic/zeromq/channels.json"]
MODEL = ["Arm.idsl", "Hand.idsl", "arm.cdsl", "arm.pdsl"]

Said = pytest.CaptureFixture[str]


@pytest.fixture
def cdsl(tmp_path: Path) -> Path:
    """The model of a component that was not generated yet."""
    return model_in(tmp_path / "arm", arm_cdsl=CDSL, Arm_idsl=ARM, Hand_idsl=HAND, arm_pdsl=PDSL)


@pytest.fixture
def arm(cdsl: Path, capsys: Said) -> Path:
    """The folder of a generated component."""
    assert rcgen([str(cdsl)]) == 0
    capsys.readouterr()
    return cdsl.parent


def edit(path: Path, before: str, after: str) -> None:
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after))


def of(files: dict[str, bytes], *, generic: bool) -> dict[str, bytes]:
    """The part of a snapshot that is the generator's, or that is not."""
    return {name: data for name, data in files.items() if name.startswith("generic/") == generic}


_runs = count(1)


def worker_of(folder: Path) -> type[Worker[Any]]:
    """The worker as a new process would load it: modules that were imported before play no part."""
    fresh = folder.parent / f"run{next(_runs)}"
    shutil.copytree(folder, fresh)
    return loaded(fresh)


def starts(folder: Path) -> bool:
    with ComponentTest(worker_of(folder)) as component:
        component.wait_for_computes(1)
    return component.fine


# Generating.


def test_a_component_is_generated_beside_its_model(cdsl: Path, capsys: Said) -> None:
    assert rcgen([str(cdsl)]) == 0
    assert capsys.readouterr() == (f"arm: 13 written in {cdsl.parent}/ (auto)\n", "")
    assert sorted(snapshot(cdsl.parent)) == sorted([*MODEL, *GENERIC, *SPECIFIC])
    assert starts(cdsl.parent)


def test_a_component_is_generated_into_another_folder_if_one_is_given(cdsl: Path, tmp_path: Path) -> None:
    assert rcgen([str(cdsl), "-o", str(tmp_path / "out" / "left")]) == 0
    assert sorted(snapshot(tmp_path / "out" / "left")) == sorted([*GENERIC, *SPECIFIC])
    assert sorted(snapshot(cdsl.parent)) == MODEL
    assert starts(tmp_path / "out" / "left")


def test_imports_are_found_in_the_folders_that_are_given(cdsl: Path, tmp_path: Path, capsys: Said) -> None:
    for name in ("Arm.idsl", "Hand.idsl"):
        (tmp_path / Path(name).stem).mkdir()
        (cdsl.parent / name).rename(tmp_path / Path(name).stem / name)
    assert rcgen([str(cdsl), "-I", str(tmp_path / "Arm")]) == 1
    assert "error[missing-import]: `Hand.idsl` was not found" in capsys.readouterr().err
    assert rcgen([str(cdsl), "-I", str(tmp_path / "Arm"), "-I", str(tmp_path / "Hand")]) == 0


def test_a_network_generates_each_of_its_components(cdsl: Path, tmp_path: Path, capsys: Said) -> None:
    model_in(tmp_path / "leg", leg_cdsl="Component leg { language python; };")
    (tmp_path / "net.ddsl").write_text(
        'import "arm/arm.cdsl"; import "leg/leg.cdsl";\n'
        "Deployment net { Component arm { }; Component left : leg { }; Component right : leg { }; };"
    )
    assert rcgen([str(tmp_path / "net.ddsl")]) == 0
    said = capsys.readouterr().out
    assert said == f"arm: 13 written in {cdsl.parent}/ (auto)\nleg: 8 written in {tmp_path}/leg/ (auto)\n"
    assert starts(tmp_path / "arm")
    assert starts(tmp_path / "leg")


def test_the_middleware_is_chosen_once_and_kept(cdsl: Path, capsys: Said) -> None:
    before = None
    for arguments, chosen in (([], "auto"), (["--middleware", "inproc"], "inproc"), ([], "inproc, as before")):
        assert rcgen([str(cdsl), *arguments]) == 0
        assert f"({chosen})" in capsys.readouterr().out
        assert worker_of(cdsl.parent).middleware == chosen.partition(",")[0]
        specific = of(snapshot(cdsl.parent), generic=False)
        assert before in (None, specific), "not one byte of the specific part changes"
        before = specific


def test_what_other_programs_need_is_that_of_the_middleware_chosen(arm: Path, capsys: Said) -> None:
    """What was for another one is out of date then, and goes; what is the user's there stays."""
    model = str(arm / "arm.cdsl")
    (arm / "generic" / "zeromq" / "notes.json").write_text('{"mine": true}')
    folders = {
        "dds": ["RoboCompArm.idl", "RoboCompHand.idl", "robocomp.idl"],
        "zenoh": ["RoboCompArm.idl"],
        "inproc": [],
    }
    for middleware, types in folders.items():
        capsys.readouterr()
        assert rcgen(["--check", model, "--middleware", middleware]) == 1
        assert "no longer generated: " in capsys.readouterr().out
        assert rcgen([model, "--middleware", middleware]) == 0
        there = {path.parent.name for path in (arm / "generic").glob("*/*") if path.suffix in (".idl", ".json")}
        assert there == {"zeromq", middleware} - {"inproc"}
        found = {path.name for path in (arm / "generic" / middleware).glob("*")}
        assert found >= {*types, "channels.json"} if types else not found
        assert rcgen(["--check", model]) == 0
    assert [path.name for path in (arm / "generic" / "zeromq").iterdir()] == ["notes.json"]
    assert not (arm / "generic" / "dds").exists()


def test_a_middleware_that_is_not_installed_is_told_with_the_remedy(cdsl: Path, tmp_path: Path) -> None:
    """A process of its own cannot import any of them."""
    code = """
import sys
from robocomp_py.transports.deployment import deployments

needed = {name: each.modules for name, each in deployments().items() if each.modules}
sys.modules |= {module: None for modules in needed.values() for module, _ in modules}
from robocomp_py.cli.rcgen import main

for name in needed:
    print(name, main([sys.argv[1], "--middleware", name]), flush=True)
main(["--new", "greeter", "-o", sys.argv[2], "--middleware", f"auto({name})"])
main([sys.argv[1], "--middleware", "auto"])
main([sys.argv[3]])
"""
    theirs = tmp_path / "leg.cdsl"
    theirs.write_text(
        'import "arm/Arm.idsl";\nComponent leg { Communications { requires Arm(dds); }; language python; };\n'
    )
    command = [sys.executable, "-c", code, str(cdsl), str(tmp_path / "greeter"), str(theirs)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    names = [line.partition(" ")[0] for line in done.stdout.splitlines() if line.endswith(" 0")]
    warnings = [line for line in done.stderr.splitlines() if "warning: " in line]
    assert len(names) >= 4
    assert [line.split("'")[1] for line in warnings] == [*names, names[-1], "dds"]
    assert all("is not usable here: " in line and "pip install " in line for line in warnings), warnings
    assert (tmp_path / "greeter" / "specificworker.py").is_file()


def test_an_unknown_middleware_is_refused_before_anything_is_written(cdsl: Path, capsys: Said) -> None:
    assert rcgen([str(cdsl), "--middleware", "zermq"]) == 2
    assert capsys.readouterr() == (
        "",
        "rcgen: --middleware zermq: unknown middleware `zermq`; did you mean `zeromq`?\n",
    )
    assert sorted(snapshot(cdsl.parent)) == MODEL


# Checking.


def test_checking_lists_what_is_out_of_date_and_writes_nothing(arm: Path, capsys: Said) -> None:
    model = str(arm / "arm.cdsl")
    assert rcgen(["--check", model]) == 0
    assert capsys.readouterr() == ("", "")
    edit(arm / "arm.cdsl", ' import "Hand.idsl";', ' import "Laser.idsl";')
    edit(arm / "arm.cdsl", "publishes Hand;", "requires Laser;")
    (arm / "README.md").unlink()
    before = snapshot(arm)
    assert rcgen(["--check", model]) == 1
    assert capsys.readouterr().out.splitlines() == [
        f"missing: {arm}/generic/RoboCompGenericBase.py",
        f"missing: {arm}/generic/RoboCompLaser.py",
        f"missing: {arm}/README.md",
        f"out of date: {arm}/generic/genericworker.py",
        f"out of date: {arm}/generic/fakes.py",
        f"out of date: {arm}/generic/zeromq/channels.json",
        f"no longer generated: {arm}/generic/RoboCompHand.py",
    ]
    assert snapshot(arm) == before
    assert rcgen([model]) == 0
    assert rcgen(["--check", model]) == 0


def test_a_component_that_was_never_generated_is_out_of_date(cdsl: Path, capsys: Said) -> None:
    assert rcgen(["--check", str(cdsl)]) == 1
    assert len(capsys.readouterr().out.splitlines()) == len(GENERIC) + len(SPECIFIC)
    assert sorted(snapshot(cdsl.parent)) == MODEL


# After an edit of the model.

EDITS: dict[str, tuple[str, str, str]] = {
    "a port more": ("arm.cdsl", "publishes Hand;", "publishes Hand; subscribesTo Hand;"),
    "a port less": ("arm.cdsl", "publishes Hand;", ""),
    "another verb": ("arm.cdsl", "implements Arm", "requires Arm"),
    "another interface": ("arm.cdsl", "implements Arm", "implements Speech"),
    "another name": ("arm.cdsl", "Component arm", "Component elbow"),
    "another period": ("arm.cdsl", "10 ms", "20 ms"),
    "another comment": ("arm.cdsl", "Moves things", "Moves everything"),
    "no parameters": ("arm.cdsl", 'params "arm.pdsl";', ""),
    "an operation more": ("Arm.idsl", "Pose where();", "Pose where(); Pose next(int step, out bool last);"),
    "an operation less": ("Arm.idsl", "void move(Pose to);", ""),
    "an operation renamed": ("Arm.idsl", "where()", "whereabouts()"),
    "a parameter of an operation more": ("Arm.idsl", "move(Pose to)", "move(Pose to, float speed)"),
    "another result": ("Arm.idsl", "Pose where()", "float where()"),
    "another type": ("Arm.idsl", "float x;", "sequence<float> x;"),
    "a type renamed": ("Arm.idsl", "Pose", "Place"),
    "another module": ("Arm.idsl", "RoboCompArm", "RoboCompArms"),
    "a pattern": ("Arm.idsl", "void move", "[command] void move"),
    "a parameter more": ("arm.pdsl", "speed", "gain int 1; speed"),
    "another default": ("arm.pdsl", "0.5", "0.7"),
    "a parameter less": ("arm.pdsl", "speed float 0.5 0:2;", ""),
}


@pytest.mark.parametrize("name", EDITS)
def test_after_an_edit_the_generic_part_follows_and_the_specific_part_keeps_its_bytes(
    arm: Path, tmp_path: Path, capsys: Said, name: str
) -> None:
    """And the component starts, or says which method to add or to change: then it starts."""
    file, before, after = EDITS[name]
    edit(arm / "specificworker.py", "def compute(self)", "# Mine.\n    def compute(self)")
    edit(arm / file, before, after)
    if "Speech" in after:
        edit(arm / "arm.cdsl", 'import "Hand.idsl";', 'import "Hand.idsl"; import "Speech.idsl";')
    specific = of(snapshot(arm), generic=False)
    assert rcgen([str(arm / "arm.cdsl")]) == 0
    now = snapshot(arm)
    assert specific.items() <= of(now, generic=False).items()
    assert rcgen([str(arm / "arm.cdsl"), "-o", str(tmp_path / "fresh")]) == 0
    assert of(now, generic=True) == of(snapshot(tmp_path / "fresh"), generic=True)
    mend(arm, capsys.readouterr().out)
    assert starts(arm)


def mend(folder: Path, said: str) -> None:
    """Do to the specific part what rcgen said, and nothing else; the component says the same."""
    path = folder / "specificworker.py"
    source = path.read_text()
    stubs = find_stubs(folder, linked(folder / "arm.cdsl"), read_file)
    for method in [*stubs.missing, *stubs.unfit][:1]:
        with pytest.raises(ComponentError, match=f"SpecificWorker(\\.| lacks the method ){method}\\b"):
            ComponentTest(worker_of(folder))
    if stubs.missing:
        command = f"rcgen --stubs {folder / 'arm.cdsl'}"
        assert f"\n{path} lacks {', '.join(stubs.missing)}; run `{command}`, or add to SpecificWorker:\n" in said
        assert stubs.imports in said
        pasted = "\n".join(stubs.missing.values())
        assert pasted in said
        path.write_text(f"{source}\n{pasted}")
        edit(path, "from .generic", f"{stubs.imports}\nfrom .generic")
    for method, begins in stubs.unfit.items():
        assert f"\n{path}: {method} does not take what it is given; it must begin with:\n\n    {begins}\n" in said
        [old] = [line for line in path.read_text().splitlines() if f"def {method}(" in line]
        edit(path, old, f"    {begins}")
    if stubs.gone:
        assert f"\n{path} imports RoboCompArm of generic/, where it is not generated any more; change that\n" in said
        path.write_text(path.read_text().replace("RoboCompArm", "RoboCompArms"))
    if stubs == Stubs({}, {}, ""):
        assert "SpecificWorker" not in said


def test_a_handler_missing_after_a_change_is_reported_before_the_start(arm: Path, capsys: Said) -> None:
    (arm / "net.ddsl").write_text('import "arm.cdsl"; Deployment net { Component arm {}; };')
    cdsl, net = str(arm / "arm.cdsl"), str(arm / "net.ddsl")
    assert rcdeploy(["plan", net]) == 0
    edit(arm / "Arm.idsl", "Pose where()", "Pose pose()")
    capsys.readouterr()
    assert rcgen([cdsl]) == 0
    said = capsys.readouterr()
    assert "warning[missing-handler]: `SpecificWorker` lacks `Arm_pose`, which `implements Arm` asks for" in said.err
    assert "warning[uncalled-handler]: `Arm_where` is not called by anything" in said.err
    assert "was it renamed to `Arm_pose`?" in said.err
    for command in (["lint", cdsl], ["lint", net]):
        assert rc(command) == 1
        assert "error[missing-handler]" in capsys.readouterr().err
    for main, command in ((rcgen, ["--check", cdsl]), (rcdeploy, ["plan", net]), (rcdeploy, ["up", net, "--for", "1"])):
        assert main(command) == 1
        assert "error[missing-handler]" in capsys.readouterr().err
    assert rcgen([cdsl, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["diagnostics"]
    assert {(each["code"], each["severity"]) for each in found} == {
        ("missing-handler", "warning"),
        ("uncalled-handler", "warning"),
    }


def test_stubs_are_appended_on_request_and_the_component_starts(arm: Path, capsys: Said) -> None:
    edit(arm / "arm.cdsl", 'import "Hand.idsl";', 'import "Hand.idsl"; import "Speech.idsl"; import "LaserPub.idsl";')
    edit(arm / "arm.cdsl", "implements Arm;", "implements Arm, Speech; subscribesTo LaserPub;")
    edit(arm / "arm.cdsl", "period", 'statemachine "arm.smdsl"; period')
    (arm / "arm.smdsl").write_text("arm { initial_state still; };")
    path = arm / "specificworker.py"
    path.chmod(0o640)
    before = path.read_text()
    assert rcgen(["--stubs", str(arm / "arm.cdsl")]) == 0
    said = capsys.readouterr()
    assert f"{path}: stubs of the missing methods are at the end of its class\n" in said.out
    assert (said.err, "lacks" in said.out) == ("", False)

    assert [line for line in before.splitlines() if line not in path.read_text()] == []
    assert path.stat().st_mode & 0o777 == 0o640
    assert starts(arm)
    with pytest.raises(SystemExit, match="2"):
        rcgen(["--stubs", "--check", str(arm / "arm.cdsl")])


def test_every_way_to_mend_a_component_occurs_among_the_edits(arm: Path) -> None:
    kinds = set()
    original = snapshot(arm)
    for file, before, after in EDITS.values():
        if "Speech" not in after:
            edit(arm / file, before, after)
            found = find_stubs(arm, linked(arm / "arm.cdsl"), read_file)
            kinds.add((bool(found.missing), bool(found.unfit), bool(found.gone)))
            (arm / file).write_bytes(original[file])
    assert kinds == {(False, False, False), (True, False, False), (False, True, False), (False, False, True)}


def test_a_history_of_edits_ends_where_the_last_model_begins(arm: Path, tmp_path: Path) -> None:
    """Whatever was generated in between: nothing of it is left."""
    for name in ("another interface", "no parameters", "another module", "a port less", "a type renamed"):
        file, before, after = EDITS[name]
        edit(arm / file, before, after)
        edit(arm / "arm.cdsl", "import", 'import "Speech.idsl"; import')
        assert rcgen([str(arm / "arm.cdsl")]) == 0
    assert rcgen([str(arm / "arm.cdsl"), "-o", str(tmp_path / "fresh")]) == 0
    assert of(snapshot(arm), generic=True) == of(snapshot(tmp_path / "fresh"), generic=True)
    assert sorted(of(snapshot(arm), generic=True)) == [
        *("generic/RoboCompArms.py", "generic/RoboCompHand.py", "generic/RoboCompSpeech.py"),
        *("generic/__init__.py", "generic/genericworker.py", "generic/zeromq/channels.json"),
    ]


# What is wrong.


def test_a_model_with_errors_changes_no_file(arm: Path, capsys: Said) -> None:
    edit(arm / "Arm.idsl", "float x;", "flaot x; int x;")
    edit(arm / "arm.pdsl", "0.5", "5")
    before = snapshot(arm)
    assert rcgen([str(arm / "arm.cdsl")]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert [line.split(": ")[1] for line in said.err.splitlines() if ": error[" in line] == [
        *("error[unknown-type]", "error[duplicate]", "error[bad-default]"),
    ]
    assert snapshot(arm) == before
    assert rcgen(["--check", str(arm / "arm.cdsl")]) == 1


def test_warnings_are_shown_and_do_not_hinder(cdsl: Path, capsys: Said) -> None:
    edit(cdsl, "language python;", "language Cpp;")
    assert rcgen([str(cdsl)]) == 0
    assert "warning[not-python]" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("Arm.idsl", "is not a component: give rcgen a .cdsl or .ddsl that uses it"),
        ("arm.pdsl", "is not a component: give rcgen a .cdsl or .ddsl that uses it"),
        ("missing.cdsl", "error[unreadable]: cannot be read: No such file or directory"),
        ("missing.ddsl", "error[unreadable]: cannot be read: No such file or directory"),
        ("notes.txt", "error[unreadable]: cannot be read: No such file or directory"),
    ],
)
def test_what_is_no_component_is_refused(cdsl: Path, capsys: Said, file: str, said: str) -> None:
    assert rcgen([str(cdsl.parent / file)]) == 1
    assert said in capsys.readouterr().err
    assert sorted(snapshot(cdsl.parent)) == MODEL


@pytest.fixture
def two(arm: Path, tmp_path: Path) -> tuple[Path, Path]:
    """A component whose model was edited, and another one that was never generated."""
    edit(arm / "arm.cdsl", "10 ms", "20 ms")
    return arm, model_in(tmp_path / "leg", leg_cdsl="Component leg { language python; };").parent


def test_several_components_are_generated_all_or_none(two: tuple[Path, Path], capsys: Said) -> None:
    arm, leg = two
    (leg / "generic").mkdir()
    (leg / "generic" / "genericworker.py").write_text("# mine\n")
    before = snapshot(arm.parent)
    models = [str(arm / "arm.cdsl"), str(leg / "leg.cdsl")]
    assert rcgen(models) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.endswith("was not written by rcgen; rename it, as rcgen needs the name; nothing was written\n")
    assert snapshot(arm.parent) == before
    (leg / "generic" / "genericworker.py").unlink()
    assert rcgen(models) == 0


def test_when_the_disk_fails_for_one_component_the_others_are_as_they_were(
    two: tuple[Path, Path], capsys: Said, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm, leg = two
    before, rename = snapshot(arm.parent), Path.rename

    def failing(path: Path, target: Path) -> Path:
        if target == leg / "specificworker.py":
            raise OSError(28, "No space left on device", str(target))
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", failing)
    assert rcgen([str(arm / "arm.cdsl"), str(leg / "leg.cdsl")]) == 1
    said = capsys.readouterr()
    assert said == ("", f"rcgen: {leg}/specificworker.py: No space left on device; nothing was written\n")
    assert snapshot(arm.parent) == before


def test_two_components_cannot_share_a_folder(arm: Path, tmp_path: Path, capsys: Said) -> None:
    (arm / "leg.cdsl").write_text("Component leg { language python; };")
    before = snapshot(arm)
    assert rcgen([str(arm / "arm.cdsl"), str(arm / "leg.cdsl")]) == 1
    assert "arm.cdsl and leg.cdsl would share" in capsys.readouterr().err
    assert rcgen([str(arm / "leg.cdsl")]) == 1
    assert "was generated from arm.cdsl: give leg.cdsl another folder (-o DIR)" in capsys.readouterr().err
    assert snapshot(arm) == before


@pytest.mark.parametrize("kind", ["file", "link"])
def test_what_a_user_has_is_never_overwritten(cdsl: Path, kind: str) -> None:
    for name in SPECIFIC:
        path = cdsl.parent / name
        path.parent.mkdir(exist_ok=True)
        if kind == "file":
            path.write_text("mine")
        else:
            (cdsl.parents[1] / path.name).write_text("mine")
            path.symlink_to(cdsl.parents[1] / path.name)
    assert rcgen([str(cdsl)]) == 0
    assert {(cdsl.parent / name).read_text() for name in SPECIFIC} == {"mine"}


@pytest.mark.parametrize(
    "arguments", [[], ["--new", "Hello", "x.cdsl"], ["--new", "Hello", "--check"], ["--bogus"], ["x.cdsl", "-o"]]
)
def test_wrong_usage_exits_with_2(arguments: list[str], capsys: Said) -> None:
    with pytest.raises(SystemExit) as ended:
        rcgen(arguments)
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith("usage: rcgen ")


# A new component.


@pytest.fixture
def inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_new_component_names_pytest_if_it_is_missing(
    inside: Path, capsys: Said, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pytest", None)
    assert rcgen(["--new", "Hello"]) == 0
    assert "\n    pytest hello    # needs: pip install pytest\n" in capsys.readouterr().out


def test_a_new_component_runs_passes_its_test_and_is_up_to_date(inside: Path, capsys: Said) -> None:
    assert rcgen(["--new", "Hello"]) == 0
    assert capsys.readouterr().out == (
        "hello/ holds a component that runs as it is:\n\n    rc run hello\n    pytest hello\n\n"
    )
    assert rcgen(["--check", "hello/hello.cdsl"]) == 0
    with ComponentTest(worker_of(inside / "hello"), {"params.greeting": "Hi"}) as component:
        assert component.call("Hello.greet", "Ada") == "Hi, Ada!"
    assert component.fine
    tested = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "hello"], capture_output=True, text=True
    )
    assert tested.returncode == 0, tested.stdout
    assert "1 passed" in tested.stdout


def test_a_new_component_uses_the_given_folder_and_middleware(inside: Path) -> None:
    assert rcgen(["--new", "greeter", "-o", "deep/er", "--middleware", "inproc"]) == 0
    worker = worker_of(inside / "deep" / "er")
    assert (worker.component.name, worker.middleware) == ("greeter", "inproc")
    assert worker.component.ports[0].interface.name == "RoboCompGreeter::Greeter"
    assert (inside / "deep" / "er" / "Greeter.idsl").is_file()


def test_a_new_component_may_have_a_name_of_several_words(inside: Path) -> None:
    assert rcgen(["--new", "my_robot"]) == 0
    worker = worker_of(inside / "my_robot")
    assert (worker.component.name, worker.component.ports[0].interface.name) == ("my_robot", "RoboCompMyRobot::MyRobot")
    assert rcgen(["--check", "my_robot/my_robot.cdsl"]) == 0
    with ComponentTest(worker) as component:
        assert component.call("MyRobot.greet", "Ada") == "Hello, Ada!"


@pytest.mark.parametrize("name", ["", "5", "a b", "../x", "Hällo", "a-b", "a_", "a__b"])
def test_a_new_component_needs_a_name(inside: Path, capsys: Said, name: str) -> None:
    if not name:
        with pytest.raises(SystemExit):
            rcgen(["--new", name])
        return
    assert rcgen(["--new", name]) == 1
    assert "is not a component name" in capsys.readouterr().err
    assert snapshot(inside) == {}


def a_file(path: Path) -> None:
    path.write_text("mine")


def a_folder_with_a_file(path: Path) -> None:
    path.mkdir()
    (path / "notes").write_text("mine")


@pytest.mark.parametrize("obstacle", [a_file, a_folder_with_a_file])
def test_a_new_component_needs_room(inside: Path, capsys: Said, obstacle: Callable[[Path], None]) -> None:
    obstacle(inside / "hello")
    before = snapshot(inside)
    assert rcgen(["--new", "Hello"]) == 1
    assert capsys.readouterr().err == "rcgen: hello exists and is not an empty folder; nothing was written\n"
    assert snapshot(inside) == before


def uncommented(path: Path) -> str:
    """The text of a model with all that its comments propose."""
    proposal = re.compile(r"^( *)// (?=import|requires|subscribesTo|publishes|max_speed)", re.MULTILINE)
    return proposal.sub(r"\1", path.read_text())


def test_everything_that_a_new_component_proposes_works(inside: Path, capsys: Said) -> None:
    assert rcgen(["--new", "Hello"]) == 0
    model = inside / "hello" / "hello.cdsl"
    proposed = re.findall(r"self\.(\w+)\.(\w+)\(", model.read_text())
    handlers = re.findall(r"a method (\w+)", model.read_text())
    assert (len(proposed), len(handlers)) == (2, 1)
    for path in (model, model.with_suffix(".pdsl")):
        path.write_text(uncommented(path))
    capsys.readouterr()
    assert rcgen([str(model)]) == 0
    said = capsys.readouterr()
    assert re.findall(r"(?:error|warning)\S+ .*", said.err) == [
        "warning[missing-handler]: `SpecificWorker` lacks `LaserPub_pushLaserData`, "
        "which `subscribesTo LaserPub` asks for"
    ]
    assert all(f"lacks {name}; run `rcgen --stubs {model}`, or add" in said.out for name in handlers)
    worker = worker_of(inside / "hello")
    proxies = {port.attribute: port.proxy for port in worker.component.ports if port.verb.has_proxy}
    assert all(hasattr(proxies[attribute], operation) for attribute, operation in proposed)
    assert [each.name for each in worker.component.params.parameters] == ["greeting", "max_speed"]


@pytest.mark.parametrize("name", ["zmq", "Numpy", "msgpack", "queue"])
def test_a_new_component_is_not_called_like_a_library(inside: Path, capsys: Said, name: str) -> None:
    assert rcgen(["--new", name]) == 1
    assert f"rcgen: {name.lower()} has the name of a" in capsys.readouterr().err
    assert snapshot(inside) == {}
    assert rcgen(["--new", name, "-o", f"my_{name}"]) == 0


def test_a_new_component_is_not_called_by_a_word_of_python(inside: Path, capsys: Said) -> None:
    assert rcgen(["--new", "Class"]) == 1
    assert capsys.readouterr().err == "rcgen: `class` is a Python keyword; choose another name\n"
    assert snapshot(inside) == {}


def test_a_component_in_a_folder_that_is_called_like_a_library_is_warned_about(inside: Path, capsys: Said) -> None:
    model_in(inside / "zmq", arm_cdsl="Component arm { language python; };")
    assert rcgen(["zmq/arm.cdsl"]) == 0
    assert capsys.readouterr().err.startswith("rcgen: warning: zmq has the name of a library that components need: ")


def test_the_tests_of_components_called_alike_run_together_as_their_readme_says(inside: Path) -> None:
    for folder in ("left", "right", "a/hello", "b/hello"):
        assert rcgen(["--new", "Hello", "-o", folder]) == 0
    model_in(inside / "leg", leg_cdsl="Component leg { language python; };")
    assert rcgen(["leg/leg.cdsl"]) == 0
    [option] = re.findall(r"of one name need (\S+)", (inside / "leg" / "README.md").read_text())
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", option, "left", "right", "a", "b", "leg"]
    tested = subprocess.run(command, capture_output=True, text=True)
    assert tested.returncode == 0, tested.stdout
    assert "5 passed" in tested.stdout


# When it is ended.

KILLED = """
import os, signal, sys
from pathlib import Path
from robocomp_py.cli.rcgen import main

number, name, steps = getattr(signal, sys.argv[1]), sys.argv[2], 0

def ending(real):
    def operation(*arguments, **options):
        global steps
        steps += 1
        result = real(*arguments, **options)
        if steps == step:
            os.kill(os.getpid(), number)
        return result
    return operation

for each in ("rename", "mkdir", "write_text"):
    setattr(Path, each, ending(getattr(Path, each)))
for step in range(1, 1000):
    steps, folder = 0, Path(f"run{step}")
    code = main(["--new", "Hello", "-o", str(folder)])
    print(code, len([path for path in folder.rglob("*") if path.is_file()]), flush=True)
    if steps < step:
        break
"""


@pytest.mark.parametrize(("number", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_an_interrupted_generation_leaves_a_whole_component_or_no_component(
    inside: Path, number: str, code: int
) -> None:
    done = subprocess.run([sys.executable, "-c", KILLED, number, "Hello"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    *ended, fine = [tuple(map(int, line.split())) for line in done.stdout.splitlines() if line[:1].isdigit()]
    assert len(ended) > 20
    assert fine[0] == 0
    assert set(ended) <= {(code, 0), (code, fine[1])}
    assert not list(inside.rglob(".rcgen-*"))


def test_what_a_killed_run_left_behind_is_removed_by_the_next_one(arm: Path) -> None:
    """Nothing is removed that belongs to one that still runs, or of which that cannot be told."""
    stale, busy, unknown = (arm / f".rcgen-{name}" for name in ("stale", "busy", "unknown"))
    for folder in (stale, busy, unknown):
        folder.mkdir()
        (folder / "old-0").write_text("# generated once\n")
    (stale / "lock").touch()
    with (busy / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert rcgen([str(arm / "arm.cdsl")]) == 0
    assert [folder.exists() for folder in (stale, busy, unknown)] == [False, True, True]


def test_a_configuration_is_no_model(tmp_path: Path, capsys: Said) -> None:
    path = tmp_path / "etc" / "config"
    path.parent.mkdir()
    path.write_text("Period = 100\n")
    assert rcgen([str(path)]) == 1
    assert f"check a configuration with: rc lint {path}" in "".join(capsys.readouterr())
