"""Files to disk: all or nothing, and nothing that is not the generator's."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path, PurePosixPath

import pytest

from robocomp_py.codegen.generate import Artifact, GenerationError, Owner
from robocomp_py.codegen.write import Changes, compare, origin, write

from .generated import snapshot

MARK = "# Generated from arm.cdsl by rcgen 0: edits are lost.\n"


def generic(name: str, text: str = "", cdsl: str = "arm.cdsl") -> Artifact:
    return Artifact(PurePosixPath("generic") / name, MARK.replace("arm.cdsl", cdsl) + text)


def own(name: str, text: str = "") -> Artifact:
    return Artifact(PurePosixPath(name), text, Owner.USER)


FIRST = (generic("genericworker.py", "one\n"), generic("Old.py"), generic("Same.py"), own("etc/config.toml", "one\n"))
SECOND = (
    *(generic("genericworker.py", "two\n"), generic("New.py"), generic("Same.py")),
    *(own("etc/config.toml", "two\n"), own("tests/test_arm.py")),
)


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """A component's folder that was generated once, with files of its user's beside."""
    write((tmp_path / "arm", FIRST))
    (tmp_path / "arm" / "arm.cdsl").write_text("Component arm { };")
    (tmp_path / "arm" / "generic" / "notes.py").write_text("# mine\n")
    return tmp_path / "arm"


def written(root: Path, *artifacts: Artifact) -> Changes:
    [changes] = write((root, artifacts))
    return changes


def test_what_is_missing_is_written_with_its_folders(tmp_path: Path) -> None:
    changes = written(tmp_path / "new" / "arm", *FIRST)
    assert changes.missing == [str(each.path) for each in FIRST]
    assert snapshot(tmp_path / "new" / "arm") == {str(each.path): each.text.encode() for each in FIRST}


def test_what_the_generator_owns_is_replaced_and_removed_and_what_the_user_owns_is_kept(arm: Path) -> None:
    changes = written(arm, *SECOND)
    assert changes.missing == ["generic/New.py", "tests/test_arm.py"]
    assert changes.outdated == ["generic/genericworker.py"]
    assert changes.removed == ["generic/Old.py"]
    assert changes.kept == ["etc/config.toml"]
    texts = {path: data.decode() for path, data in snapshot(arm).items()}
    assert texts == {
        **{str(each.path): each.text for each in SECOND},
        "etc/config.toml": "one\n",
        "arm.cdsl": "Component arm { };",
        "generic/notes.py": "# mine\n",
    }


def test_what_is_up_to_date_is_not_touched(arm: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in arm.rglob("*")}
    assert written(arm, *FIRST).lines(arm) == []
    assert {path: path.stat().st_mtime_ns for path in arm.rglob("*")} == before


def test_comparing_writes_nothing_and_lists_what_writing_would_do(arm: Path) -> None:
    before = snapshot(arm)
    assert compare(SECOND, arm).lines(arm) == [
        f"missing: {arm / 'generic/New.py'}",
        f"missing: {arm / 'tests/test_arm.py'}",
        f"out of date: {arm / 'generic/genericworker.py'}",
        f"no longer generated: {arm / 'generic/Old.py'}",
    ]
    assert snapshot(arm) == before


def test_a_file_says_what_it_was_generated_from(tmp_path: Path) -> None:
    path = tmp_path / "file.py"
    path.write_text(MARK)
    assert origin(path) == "arm.cdsl"
    path.write_text(f"\n{MARK}")
    assert origin(path) == ""
    path.write_text(MARK.replace("#", "//"))
    assert origin(path) == "arm.cdsl"
    path.write_text('{\n  "about": "Generated from arm.cdsl by rcgen 0: edits are lost."\n}\n')
    assert origin(path) == "arm.cdsl"
    path.write_text('{\n  "mine": "Generated from arm.cdsl by rcgen 0: edits are lost."\n}\n')
    assert origin(path) == ""


NATIVE = (*FIRST, Artifact(PurePosixPath("generic/dds/Arm.idl"), MARK.replace("#", "//")))


def test_a_folder_of_which_nothing_is_generated_any_more_goes(arm: Path) -> None:
    write((arm, NATIVE))
    assert written(arm, *FIRST).removed == ["generic/dds/Arm.idl"]
    assert not (arm / "generic" / "dds").exists()


@pytest.mark.parametrize("name", ["Mine.idl", "notes.txt", "sub/Arm.idl"])
def test_a_folder_in_which_the_user_has_something_stays(arm: Path, name: str) -> None:
    write((arm, NATIVE))
    own_file = arm / "generic" / "dds" / name
    own_file.parent.mkdir(exist_ok=True)
    own_file.write_text("// mine\n")
    assert written(arm, *FIRST).removed == ["generic/dds/Arm.idl"]
    assert own_file.read_text() == "// mine\n"


def test_a_folder_that_is_a_link_is_not_looked_into(arm: Path) -> None:
    elsewhere = arm.parent / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "Arm.idl").write_text(MARK.replace("#", "//"))
    (arm / "generic" / "dds").symlink_to(elsewhere)
    assert written(arm, *FIRST).removed == []
    assert (elsewhere / "Arm.idl").exists()


# What is refused.


def foreign_file(arm: Path) -> None:
    (arm / "generic" / "New.py").write_text("# mine\n")


def folder_for_a_file(arm: Path) -> None:
    (arm / "generic" / "New.py").mkdir()


def file_for_a_folder(arm: Path) -> None:
    (arm / "tests").write_text("mine\n")


def link_for_a_folder(arm: Path) -> None:
    (arm.parent / "elsewhere").mkdir()
    (arm / "tests").symlink_to(arm.parent / "elsewhere")


def link_for_a_file(arm: Path) -> None:
    (arm.parent / "elsewhere.py").write_text(MARK)
    (arm / "generic" / "New.py").symlink_to(arm.parent / "elsewhere.py")


def link_that_leads_nowhere(arm: Path) -> None:
    (arm / "generic" / "New.py").symlink_to(arm.parent / "nowhere.py")


def another_component(arm: Path) -> None:
    worker = arm / "generic" / "genericworker.py"
    worker.write_text(worker.read_text().replace("arm.cdsl", "leg.cdsl"))
    (arm / "leg.cdsl").write_text("Component leg { };")


@pytest.mark.parametrize(
    ("obstacle", "said"),
    [
        (foreign_file, "was not written by rcgen; rename it"),
        (folder_for_a_file, "is not a file, but a file of that name is needed"),
        (file_for_a_folder, "is not a folder, but a folder of that name is needed"),
        (link_for_a_folder, "is a link, and rcgen does not write into linked folders"),
        (link_for_a_file, "was not written by rcgen; rename it"),
        (link_that_leads_nowhere, "is not a file, but a file of that name is needed"),
        (another_component, "was generated from leg.cdsl: give arm.cdsl another folder (-o DIR)"),
    ],
)
def test_what_is_in_the_way_is_refused_and_everything_left_as_it_was(
    arm: Path, obstacle: Callable[[Path], None], said: str
) -> None:
    obstacle(arm)
    before = snapshot(arm.parent)
    with pytest.raises(GenerationError) as raised:
        write((arm, SECOND))
    assert said in str(raised.value)
    assert str(raised.value).endswith("nothing was written")
    assert snapshot(arm.parent) == before


def test_a_link_that_leads_to_the_component_is_no_obstacle(arm: Path) -> None:
    link = arm.parent / "link"
    link.symlink_to(arm)
    assert written(link, *SECOND).outdated == ["generic/genericworker.py"]
    assert link.is_symlink()


def test_a_component_whose_model_was_renamed_is_the_same_component(arm: Path) -> None:
    (arm / "arm.cdsl").rename(arm / "hand.cdsl")
    assert written(arm, generic("genericworker.py", cdsl="hand.cdsl")).outdated == ["generic/genericworker.py"]


def test_a_component_whose_old_model_is_still_there_keeps_its_folder(arm: Path) -> None:
    (arm / "hand.cdsl").write_text("Component hand { };")
    with pytest.raises(GenerationError, match=r"was generated from arm\.cdsl"):
        write((arm, [generic("genericworker.py", cdsl="hand.cdsl")]))


# When the disk fails.


class Disk:
    """Fails at one of the operations that change something."""

    def __init__(self, patch: pytest.MonkeyPatch, fails_at: int, error: BaseException) -> None:
        self.operations = 0
        self._fails_at, self._error = fails_at, error
        for name in ("rename", "mkdir", "write_text"):
            patch.setattr(Path, name, self._failing(getattr(Path, name)))

    def _failing(self, real: Callable[..., object]) -> Callable[..., object]:
        def operation(*arguments: object, **options: object) -> object:
            self.operations += 1
            if self.operations == self._fails_at:
                raise self._error
            return real(*arguments, **options)

        return operation


def outcome(act: Callable[[], object]) -> str:
    """What an action raised, in words."""
    try:
        act()
    except GenerationError as exc:
        return str(exc)
    except KeyboardInterrupt:
        return "KeyboardInterrupt"
    return ""


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()], ids=["full", "Ctrl-C"])
def test_whichever_step_fails_everything_is_as_it_was(
    arm: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    """Of two components: neither is left half written, nor one without the other."""
    leg = arm.parent / "far" / "leg"
    before = snapshot(arm.parent)
    for step in itertools.count(1):
        with monkeypatch.context() as patch:
            Disk(patch, step, error)
            said = outcome(lambda: write((arm, SECOND), (leg, FIRST)))
        if not said:
            break
        assert said.endswith(("No space left on device; nothing was written", "KeyboardInterrupt")), f"step {step}"
        assert snapshot(arm.parent) == before, f"step {step}"
        assert not leg.parent.exists(), f"step {step}"
    assert step > 20
    assert (leg / "generic" / "genericworker.py").is_file()
    assert (arm / "generic" / "New.py").is_file()


def test_nothing_is_left_of_the_work_itself(arm: Path) -> None:
    write((arm, SECOND))
    assert not list(arm.glob(".rcgen*"))


def test_what_cannot_be_put_back_is_still_there_and_said_to_be(arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = Path.rename

    def rename(path: Path, target: Path) -> Path:
        if path.name.startswith("new-") or target == arm / "generic" / "genericworker.py":
            raise OSError(5, "Input/output error")
        return real(path, target)

    kept = (arm / "generic" / "genericworker.py").read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", rename)
        with pytest.raises(GenerationError, match="these files could not be restored") as raised:
            write((arm, [generic("genericworker.py", "two\n")]))
    [aside] = arm.glob(".rcgen-*/old-*")
    assert str(aside) in str(raised.value)
    assert aside.read_bytes() == kept
    write((arm, [generic("genericworker.py", "two\n")]))
    assert aside.exists(), "what was said to be there stays there"
