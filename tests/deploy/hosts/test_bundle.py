"""What a host is sent."""

from __future__ import annotations

import fcntl
import gzip
import hashlib
import io
import os
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

from robocomp_py.deploy.hosts import bootstrap, bundle
from robocomp_py.deploy.hosts.bundle import Content, collect, pack
from robocomp_py.errors import DeploymentError


@pytest.fixture
def component(tmp_path: Path) -> Path:
    folder = tmp_path / "laser"
    (folder / "generic").mkdir(parents=True)
    (folder / "specificworker.py").write_text("1\n")
    (folder / "generic" / "genericworker.py").write_text("2\n")
    return folder


def members(packed: bytes) -> dict[str, tarfile.TarInfo]:
    with tarfile.open(fileobj=io.BytesIO(gzip.decompress(packed))) as archive:
        return {member.name: member for member in archive}


def test_the_same_files_make_the_same_bundle_whenever_they_were_written(component: Path):
    first = pack(collect({component: "files/laser"}))
    os.utime(component / "specificworker.py", (1, 1))
    assert pack(collect({component: "files/laser"})) == first


def test_another_file_makes_another_bundle(component: Path):
    first = pack(collect({component: "files/laser"}))
    (component / "specificworker.py").write_text("3\n")
    assert pack(collect({component: "files/laser"})).name != first.name


def test_a_bundle_is_called_by_the_sha256_of_its_archive():
    made = pack({"a": Content(b"b")})
    assert made.name == hashlib.sha256(gzip.decompress(made.packed)).hexdigest()


def test_what_runs_is_sent_and_what_generates_is_not():
    parts = {name.split("/")[1] for name in collect({}) if name.startswith("robocomp_py/")}
    assert {"runtime", "transports"} <= parts
    assert not {"codegen", "lsp", "graph"} & parts


def test_files_are_for_their_user_alone(component: Path):
    (component / "driver").write_text("#!/bin/sh\n")
    (component / "driver").chmod(0o755)
    found = members(pack(collect({component: "files/laser"})).packed)
    assert {member.mode for member in found.values()} == {0o600, 0o700}
    assert found["files/laser/driver"].mode == 0o700


def test_folders_are_sent_completely_except_for_what_is_built_again(component: Path):
    (component / "__pycache__").mkdir()
    (component / "__pycache__" / "specificworker.pyc").write_bytes(b"")
    found = {name for name in collect({component: "files/laser"}) if name.startswith("files/")}
    assert found == {"files/laser/specificworker.py", "files/laser/generic/genericworker.py"}


def test_links_are_followed_but_not_in_circles(component: Path, tmp_path: Path):
    maps = tmp_path / "maps"
    maps.mkdir()
    (maps / "house.toml").write_text("")
    (component / "maps").symlink_to(maps)
    (component / "here").symlink_to(component)
    found = collect({component: "files/laser"})
    assert "files/laser/maps/house.toml" in found
    assert not [name for name in found if name.startswith("files/laser/here")]


def test_keys_are_sent_where_they_are_looked_for(tmp_path: Path):
    (tmp_path / "key.pem").write_text("secret")
    assert collect({}, {tmp_path / "key.pem": "key.pem"})["keys/key.pem"].data == b"secret"


def test_what_is_too_large_is_not_sent(component: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(bundle, "LARGEST", 1_000_000)
    (component / "world.bin").write_bytes(bytes(2_000_000))
    with pytest.raises(DeploymentError, match=r"world\.bin"):
        collect({component: "files/laser"})


def test_what_cannot_be_read_is_named(tmp_path: Path):
    with pytest.raises(DeploymentError, match="gone"):
        collect({tmp_path / "gone": "files/gone"})


def test_of_the_bundles_on_a_host_the_newest_stay_and_those_in_use(tmp_path: Path):
    names = [f"{number:064x}" for number in range(6)]
    for age, name in enumerate(names):
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (1000 - age, 1000 - age))
    draft = tmp_path / f"{names[0]}.4194999.draft"  # no process has that number
    draft.mkdir()
    used = bootstrap.hold(str(tmp_path / f"{names[5]}.lock"), fcntl.LOCK_SH)
    try:
        bootstrap.remove_old(str(tmp_path), names[0])
    finally:
        os.close(used)
    there = {path.name for path in tmp_path.iterdir() if path.is_dir()}
    assert there == {names[0], names[1], names[2], names[3], names[5]}


def test_the_folder_on_a_host_is_closed_to_others_and_never_one_of_theirs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    folder = tmp_path / "patrol" / ".robocomp"
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    bootstrap.own(str(folder))
    assert folder.stat().st_mode & 0o777 == 0o700
    (tmp_path / "link").symlink_to(folder)
    with pytest.raises(SystemExit):
        bootstrap.own(str(tmp_path / "link"))
    assert "is a symbolic link" in capfd.readouterr().out
    monkeypatch.setattr(os, "getuid", lambda: folder.stat().st_uid + 1)
    with pytest.raises(SystemExit):
        bootstrap.own(str(folder))
    assert "belongs to another user" in capfd.readouterr().out


def test_an_agent_and_components_run_from_a_bundle_alone(tmp_path: Path):
    with tarfile.open(fileobj=io.BytesIO(gzip.decompress(pack(collect({})).packed))) as archive:
        archive.extractall(tmp_path, filter="data")
    code = """
import sys
for name in ("lark", "jinja2", "rich", "asyncssh", "pygls"):
    sys.modules[name] = None                       # as if it were not installed
import robocomp_py.cli.rc, robocomp_py.cli.run, robocomp_py.deploy.agent, robocomp_py.runtime.run
import robocomp_py.deploy.launcher.keeper, robocomp_py.deploy.launcher.forkserver
from robocomp_py import installed
assert robocomp_py.deploy.agent.__file__.startswith(sys.argv[1]), robocomp_py.deploy.agent.__file__
print(*(entry.load().__name__ for name, entry in installed.transports().items() if name in ("inproc", "zeromq")))
"""
    command = [sys.executable, "-P", "-c", code, str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout == "InprocTransport ZeroMQTransport\n", done.stderr
