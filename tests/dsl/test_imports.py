"""Where imports are found: each step of the search path, and each form an import may have."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from robocomp_py.dsl.workspace import MAX_IMPORTS, SHIPPED, Workspace

pytestmark = pytest.mark.usefixtures("standard_folders_are_empty")


@pytest.fixture
def component(tmp_path: Path) -> Path:
    """A component that requires `Arm` of Arm.idsl."""
    path = tmp_path / "components" / "hand" / "hand.cdsl"
    path.parent.mkdir(parents=True)
    return importing(path, "Arm.idsl")


def importing(path: Path, *names: str) -> Path:
    imports = "".join(f'import "{name}";\n' for name in names)
    path.write_text(f"{imports}Component hand {{ Communications {{ requires Arm; }}; language python; }};")
    return path


def define(folder: Path, operation: str = "stop", name: str = "Arm.idsl") -> Path:
    """An interface `Arm` whose operation tells where it was found."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(f"module RoboCompArm {{ interface Arm {{ void {operation}(); }}; }};")
    return folder


def found(component: Path, *include: Path) -> str:
    """The operation of the `Arm` that was found, or the codes of what is wrong."""
    workspace = Workspace(include)
    linked = workspace.component(component)
    if linked is None:
        return " ".join(each.code for each in workspace.report.diagnostics)
    return linked.component.ports[0].interface.operations[0].name


# The search path.


def test_every_folder_is_searched_in_the_documented_order(
    component: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = tmp_path / "home"
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("ROBOCOMP", str(tmp_path / "robocomp"))
    monkeypatch.setenv("ROBOCOMP_INTERFACES", os.pathsep.join([str(tmp_path / "one"), "", str(tmp_path / "two")]))
    include = (tmp_path / "left", tmp_path / "right")
    folders = [
        component.parent,
        *include,
        tmp_path / "one",
        tmp_path / "two",
        tmp_path / "robocomp" / "interfaces" / "IDSLs",
        home / "robocomp" / "interfaces" / "IDSLs",
    ]
    assert Workspace(include).search_path(component) == [*folders, Path("/opt/robocomp/interfaces/IDSLs"), SHIPPED]
    for number, folder in reversed(list(enumerate(folders))):
        define(folder, f"number{number}")
        assert found(component, *include) == f"number{number}"


def test_shipped_interfaces_are_found_last(component: Path) -> None:
    workspace = Workspace()
    assert workspace.find("Laser.idsl", component, ".idsl") == SHIPPED / "Laser.idsl"
    define(component.parent, name="Laser.idsl")
    assert workspace.find("Laser.idsl", component, ".idsl") == component.parent / "Laser.idsl"


def test_no_home_is_no_reason_to_fail(component: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HOME")
    define(component.parent)
    assert found(component) == "stop"


def test_a_missing_import_names_every_folder_that_was_searched(component: Path, tmp_path: Path) -> None:
    workspace = Workspace([tmp_path / "left"])
    workspace.component(component)
    [missing] = workspace.report.errors
    assert missing.code == "missing-import"
    assert missing.span.text == "Arm.idsl"
    assert all(str(folder) in missing.message for folder in workspace.search_path(component))
    assert missing.hint == "add its folder by -I or ROBOCOMP_INTERFACES"


def test_a_misspelt_import_gets_a_proposal(component: Path) -> None:
    define(component.parent, name="Armm.idsl")
    workspace = Workspace()
    workspace.component(component)
    assert workspace.report.errors[0].hint == "did you mean `Armm`? else add its folder by -I or ROBOCOMP_INTERFACES"


@pytest.mark.parametrize(
    ("imported", "proposed"),
    [
        ("../amr/Arm.idsl", "../arm/Arm.idsl"),
        ("../arm/Amr.idsl", "../arm/Arm.idsl"),
        ("../../componets/arm/Arm.idsl", ""),
        ("../leg/Arm.idsl", ""),
        ("../amr/Leg.idsl", ""),
    ],
)
def test_an_import_from_a_misspelt_folder_gets_the_file_in_the_one_beside_it_proposed(
    component: Path, imported: str, proposed: str
) -> None:
    define(component.parent.parent / "arm")
    importing(component, imported)
    workspace = Workspace()
    workspace.component(component)
    hint = "add its folder by -I or ROBOCOMP_INTERFACES"
    assert workspace.report.errors[0].hint == (f"did you mean `{proposed}`? else {hint}" if proposed else hint)


@pytest.mark.parametrize(
    ("imported", "there"),
    [
        ("Webots2Robocomp", "Gazebo2Robocomp"),
        ("ActivityRecognition", "FaceRecognition"),
        ("PoseEstimation", "FullPoseEstimation"),
        ("Arm", "Farm2"),
    ],
)
def test_an_import_that_only_shares_a_part_of_its_name_with_another_file_gets_no_proposal(
    component: Path, imported: str, there: str
) -> None:
    define(component.parent, name=f"{there}.idsl")
    importing(component, f"{imported}.idsl")
    workspace = Workspace()
    workspace.component(component)
    assert workspace.report.errors[0].hint == "add its folder by -I or ROBOCOMP_INTERFACES"


@pytest.mark.parametrize("exists", [True, False])
@pytest.mark.parametrize(
    ("importing_file", "imported", "remedy"),
    [
        ("net.ddsl", "Arm.idsl", "import the .cdsl file of each component of the network"),
        ("net.ddsl", "arm.pdsl", "import the .cdsl file of each component of the network"),
        ("arm.cdsl", "leg.cdsl", "import the .idsl files of the interfaces that both use"),
        ("Arm.idsl", "arm.cdsl", "import the .idsl files of the interfaces that both use"),
        ("arm.pdsl", "Arm.idsl", "remove it"),
    ],
)
def test_a_file_of_another_language_is_refused_where_it_is_imported(
    tmp_path: Path, exists: bool, importing_file: str, imported: str, remedy: str
) -> None:
    begins = {".ddsl": "Deployment", ".cdsl": "Component", ".idsl": "module", ".pdsl": "ComponentParams"}
    path = tmp_path / importing_file
    path.write_text(f'import "{imported}"; {begins[path.suffix]} arm {{ }};')
    if exists:
        (tmp_path / imported).write_text("what it says does not matter")
    workspace = Workspace()
    if path.suffix == ".ddsl":
        workspace.components_of(path)
    else:
        workspace.check(path)
    [found] = workspace.report.errors
    assert (found.code, found.span.source.path, found.span.text) == ("wrong-import", path, imported)
    assert found.hint == remedy


# The forms of an import.


@pytest.mark.parametrize(
    "name",
    [
        "Arm.idsl",
        "Arm",
        "./Arm.idsl",
        "../interfaces/Arm.idsl",
        "../interfaces/Arm",
        "..\\\\interfaces\\\\Arm.idsl",
        "/robocomp/interfaces/IDSLs/Arm.idsl",
        "/robocomp/interfaces/IDSLs/Arm",
        "/home/somebody/robocomp/interfaces/IDSLs/Arm.idsl",
    ],
)
def test_every_form_of_an_import_finds_the_file(component: Path, name: str) -> None:
    folder = define(component.parents[1] / "interfaces")
    importing(component, name)
    assert found(component, folder) == "stop"


def test_a_relative_path_is_found_without_its_folder_being_searched(component: Path) -> None:
    define(component.parents[1] / "interfaces")
    importing(component, "../interfaces/Arm.idsl")
    assert found(component) == "stop"


def test_an_absolute_path_that_exists_is_taken_before_anything_else(component: Path, tmp_path: Path) -> None:
    define(component.parent, "near")
    importing(component, str(define(tmp_path / "far", "far") / "Arm.idsl"))
    assert found(component) == "far"


def test_a_file_without_ending_may_be_meant(component: Path) -> None:
    define(component.parent, name="Arm")
    importing(component, "Arm")
    assert found(component) == "stop"


@pytest.mark.parametrize("name", ["", "/", ".", "..", "x" * 300, "a/" * 3000 + "Arm.idsl", "\0", "Arm.idsl/"])
def test_what_cannot_be_a_file_name_is_a_missing_import(component: Path, name: str) -> None:
    importing(component, name)
    assert found(component) == "missing-import"


def test_an_interface_need_not_live_in_the_file_of_its_name(component: Path) -> None:
    define(component.parent, name="Everything.idsl")
    importing(component, "Everything.idsl")
    assert found(component) == "stop"


def test_an_interface_may_come_by_way_of_another_file(component: Path) -> None:
    define(component.parent)
    (component.parent / "All.idsl").write_text('import "Arm.idsl"; module All { };')
    importing(component, "All.idsl")
    assert found(component) == "stop"


def test_common_behavior_is_always_known(component: Path) -> None:
    component.write_text("Component hand { Communications { requires CommonBehavior; }; language python; };")
    assert found(component) == "getPeriod"


# Several files, and files that share.


def test_a_file_imported_by_several_ways_is_read_once(component: Path) -> None:
    define(component.parent)
    (component.parent / "Left.idsl").write_text('import "Arm.idsl"; module Left { };')
    (component.parent / "Right.idsl").write_text('import "./Arm"; module Right { };')
    importing(component, "Left.idsl", "Right.idsl", "Arm.idsl", "Arm")
    assert found(component) == "stop"


def test_files_may_share_a_module(component: Path) -> None:
    folder = component.parent
    (folder / "Types.idsl").write_text("module RoboCompArm { struct Joint { float angle; }; };")
    (folder / "Arm.idsl").write_text(
        'import "Types.idsl"; module RoboCompArm { interface Arm { void move(Joint to); }; };'
    )
    workspace = Workspace()
    linked = workspace.component(component)
    assert linked is not None
    [module] = linked.modules
    assert [definition.name for definition in module.definitions] == ["RoboCompArm::Joint", "RoboCompArm::Arm"]
    assert module.files == ("Types.idsl", "Arm.idsl")


def test_the_same_definition_in_two_files_is_one_definition(component: Path) -> None:
    define(component.parent)
    define(component.parent / "copy")
    importing(component, "Arm.idsl", "copy/Arm.idsl")
    assert found(component) == "stop"


def test_different_definitions_of_one_name_are_refused(component: Path) -> None:
    define(component.parent, "stop")
    define(component.parent / "copy", "go")
    importing(component, "Arm.idsl", "copy/Arm.idsl")
    workspace = Workspace()
    assert workspace.component(component) is None
    [clash] = workspace.report.errors
    assert clash.code == "duplicate"
    assert clash.span.source.path == component.parent / "copy" / "Arm.idsl"
    assert [span.source.path for _, span in clash.related] == [component.parent / "Arm.idsl"]


def test_different_definitions_are_refused_in_an_interface_file_too(tmp_path: Path) -> None:
    define(tmp_path, "stop")
    define(tmp_path / "copy", "go")
    path = tmp_path / "Both.idsl"
    path.write_text('import "Arm.idsl"; import "copy/Arm.idsl"; module Both { };')
    workspace = Workspace()
    workspace.check(path)
    assert [each.code for each in workspace.report.errors] == ["duplicate"]


def test_a_cycle_of_imports_is_said_where_it_closes(component: Path) -> None:
    folder = component.parent
    (folder / "Arm.idsl").write_text('import "Leg.idsl"; module RoboCompArm { interface Arm { void stop(); }; };')
    (folder / "Leg.idsl").write_text('import "Arm.idsl"; module RoboCompLeg { };')
    workspace = Workspace()
    assert workspace.component(component) is None
    [cycle] = workspace.report.errors
    assert (cycle.code, cycle.span.source.path.name) == ("import-cycle", "Leg.idsl")


@pytest.mark.parametrize(
    "make", [lambda path: path.mkdir(), lambda path: path.symlink_to(path)], ids=["folder", "loop"]
)
def test_a_folder_with_the_name_of_an_import_is_not_found(component: Path, make: Callable[[Path], None]) -> None:
    make(component.parent / "Arm.idsl")
    assert found(component) == "missing-import"


def test_a_folder_with_the_name_of_an_import_does_not_hide_a_file(component: Path, tmp_path: Path) -> None:
    (component.parent / "Arm.idsl").mkdir()
    assert found(component, define(tmp_path / "elsewhere")) == "stop"


def test_a_file_that_imports_itself_by_way_of_a_link_is_a_cycle(component: Path) -> None:
    folder = component.parent
    (folder / "Arm.idsl").write_text('import "again/Arm.idsl"; module RoboCompArm { interface Arm { void stop(); }; };')
    (folder / "again").symlink_to(folder)
    assert found(component) == "import-cycle"


def test_a_file_that_is_wrong_is_reported_once_however_often_it_is_imported(component: Path) -> None:
    folder = component.parent
    (folder / "Arm.idsl").write_text("module RoboCompArm { interface Arm { void stop(Joint j); }; };")
    (folder / "Leg.idsl").write_text('import "Arm.idsl"; module Leg { struct Foot { RoboCompArm::Joint j; }; };')
    importing(component, "Arm.idsl", "Leg.idsl")
    workspace = Workspace()
    assert workspace.component(component) is None
    assert [(each.code, each.span.source.path.name) for each in workspace.report.errors] == [
        ("unknown-type", "Arm.idsl"),
        ("unknown-type", "Leg.idsl"),
    ]


def test_a_very_long_chain_of_imports_is_refused(component: Path) -> None:
    folder = component.parent
    for number in range(MAX_IMPORTS * 2):
        (folder / f"A{number}.idsl").write_text(f'import "A{number + 1}.idsl"; module A{number} {{ }};')
    importing(component, "A0.idsl")
    assert found(component) == "too-deep"


def test_base_interfaces_are_looked_up_in_their_own_module(component: Path) -> None:
    folder = component.parent
    (folder / "Base.idsl").write_text(
        "module Base { interface Root { void rest(); }; interface Limb extends Root { void move(); }; };"
    )
    (folder / "Arm.idsl").write_text(
        'import "Base.idsl"; module RoboCompArm { interface Arm extends Base::Limb { }; };'
    )
    assert found(component) == "rest"


def test_only_names_that_a_wrong_import_may_define_are_not_reported_as_missing(tmp_path: Path) -> None:
    (tmp_path / "Arm.idsl").write_text("module RoboCompArm { interface Hand { void grip(flot force); }; };")
    (tmp_path / "c.cdsl").write_text(
        'import "Arm.idsl"; import "Laser.idsl"; Component c { language python;'
        " Communications { requires Hand, Hnad, Lsaer, LaserPub, Foo; }; };"
    )
    workspace = Workspace()
    assert workspace.component(tmp_path / "c.cdsl") is None
    assert [(each.code, each.span.text) for each in workspace.report.errors] == [
        ("unknown-type", "flot"),
        ("unknown-interface", "Lsaer"),
        ("missing-import", "LaserPub"),
    ]


@pytest.mark.parametrize("text", ["", "nothing of the kind", "Component arm {};", "\xff\xfe"])
def test_an_import_of_which_nothing_can_be_made_is_the_only_mistake(tmp_path: Path, text: str) -> None:
    (tmp_path / "Base.idsl").write_bytes(text.encode("latin-1"))
    path = tmp_path / "Arm.idsl"
    path.write_text('import "Base.idsl";\nmodule Arm { interface Arm { Base::S f(); }; };\n')
    workspace = Workspace()
    assert workspace.interfaces(path) is None
    assert {each.span.source.path.name for each in workspace.report.errors} == {"Base.idsl"}


def test_an_interface_that_its_own_file_does_not_have_is_not_to_be_imported_again(component: Path) -> None:
    (component.parent / "Arm.idsl").write_text("module RoboCompArm { interface Gripper { void stop(); }; };")
    workspace = Workspace()
    assert workspace.component(component) is None
    [told] = workspace.report.diagnostics
    assert (told.code, told.hint) == (
        "unknown-interface",
        "`Arm.idsl` is imported, but has no interface of this name",
    )
