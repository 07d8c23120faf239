"""What installed packages add is found in their files, as Python's own library finds it."""

from __future__ import annotations

import sys
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

from robocomp_py import installed

NAMED = "[robocomp_py.exporters]\n# a comment\n toy = toys : write [more]\n[console_scripts]\ntoy = toys:main\n"


def information(site: Path, package: str, text: str) -> None:
    folder = site / f"{package}.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package.partition('-')[0]}\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(text)


def expected() -> set[tuple[str, str, str]]:
    every = metadata.entry_points()
    groups = [group for group in every.groups if group.startswith("robocomp_py.")]
    return {(group, each.name, each.value) for group in groups for each in every.select(group=group)}


def found() -> set[tuple[str, str, str]]:
    return {(each.group, each.name, each.value) for each in installed.entry_points()}


def test_entry_points_are_those_of_the_standard_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    information(tmp_path / "first", "toys-1.0", NAMED)
    information(tmp_path / "second", "Toys-2.0", NAMED.replace("toy =", "hidden ="))
    monkeypatch.setattr(sys, "path", [f"{tmp_path}/first", f"{tmp_path}/second", f"{tmp_path}/none", *sys.path])
    assert found() == expected()
    assert ("robocomp_py.exporters", "toy", "toys : write [more]") in found()
    assert "hidden" not in {name for _, name, _ in found()}


def test_packages_in_archives_add_entry_points_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with zipfile.ZipFile(tmp_path / "toys.zip", "w") as archive:
        archive.writestr("toys-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: toys\nVersion: 1.0\n")
        archive.writestr("toys-1.0.dist-info/entry_points.txt", NAMED)
    monkeypatch.syspath_prepend(tmp_path / "toys.zip")
    assert ("robocomp_py.exporters", "toy", "toys : write [more]") in found()


def test_an_entry_point_loads_a_module_or_what_is_in_it() -> None:
    assert installed.EntryPoint("group", "name", "robocomp_py.installed").load() is installed
    assert installed.EntryPoint("group", "name", "robocomp_py.installed : EntryPoint.load [more]").load() is (
        installed.EntryPoint.load
    )
