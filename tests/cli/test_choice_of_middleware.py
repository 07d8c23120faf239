"""One meaning for the choice of a middleware: generated choice, then the deployment, then the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robocomp_py import installed
from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.cli.rcgen import main as rcgen

Said = pytest.CaptureFixture[str]

IDSL = "module Ask { interface Asking { int ask(); }; };"
CDSL = 'import "../Ask.idsl"; Component %s { Communications { %s Asking; }; language python; };'


@pytest.fixture
def network(tmp_path: Path) -> Path:
    (tmp_path / "Ask.idsl").write_text(IDSL)
    for name, verb in (("server", "implements"), ("client", "requires")):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}.cdsl").write_text(CDSL % (name, verb))
    return deployment(tmp_path)


def deployment(folder: Path, said: str = "") -> Path:
    path = folder / "net.ddsl"
    path.write_text(
        f'import "server/server.cdsl"; import "client/client.cdsl";'
        f"Deployment net {{ {said} Component server {{ }}; Component client {{ }}; }};"
    )
    return path


def ways(path: Path, said: Said, *more: str) -> set[tuple[str, str]]:
    """Over what the links go, and why."""
    said.readouterr()
    assert rc(["links", str(path), "--json", *more]) == 0
    return {(way["middleware"], way["why"]) for way in map(json.loads, said.readouterr().out.splitlines())}


def test_the_later_choice_wins_and_every_tool_names_its_origin(network: Path, capsys: Said) -> None:
    assert rcgen([str(network)]) == 0
    assert "(auto)" in capsys.readouterr().out
    assert ways(network, capsys) == {("shm", "one host")}

    assert rcgen([str(network), "--middleware", "dds"]) == 0
    assert ways(network, capsys) == {("dds", "named (client: generated for it)")}
    assert rcgen([str(network)]) == 0
    assert "(dds, as before)" in capsys.readouterr().out
    assert rcdeploy(["plan", str(network)]) == 0
    assert "Asking of server over dds (client: generated for it)" in capsys.readouterr().out
    assert rc(["run", str(network.parent / "client"), "--print-config"]) == 0
    assert any(
        line.split() == ["middleware", "=", '"dds"', "#", "what", "it", "was", "generated", "for"]
        for line in capsys.readouterr().out.splitlines()
    )

    deployed = deployment(network.parent, "middleware zenoh;")
    assert ways(deployed, capsys) == {("zenoh", f"named (client: {deployed})")}
    assert ways(deployed, capsys, "--middleware", "zeromq") == {("zeromq", "named (client: --middleware zeromq)")}
    assert ways(deployed, capsys, "--middleware", "auto") == {("shm", "one host")}
    assert ways(deployment(network.parent, "middleware auto;"), capsys) == {("shm", "one host")}
    assert rcgen([str(network), "--middleware", "auto"]) == 0
    assert ways(deployment(network.parent), capsys) == {("shm", "one host")}


def test_what_an_earlier_choice_wrote_is_found_and_removed(network: Path, capsys: Said) -> None:
    folder = network.parent / "client"
    cdsl = str(folder / "client.cdsl")
    generic = folder / "generic"

    def files() -> set[str]:
        return {str(path.relative_to(generic)) for path in generic.rglob("*") if path.is_file()}

    fresh: dict[str, set[str]] = {}
    for middleware in installed.transports():
        assert rcgen([cdsl, "-o", str(network.parent / middleware), "--middleware", middleware]) == 0
        made = network.parent / middleware / "generic"
        fresh[middleware] = {str(path.relative_to(made)) for path in made.rglob("*") if path.is_file()}
    for middleware in (*fresh, *fresh):
        assert rcgen([cdsl, "--middleware", middleware]) == 0
        assert files() == fresh[middleware]
        assert rcgen(["--check", cdsl]) == 0

    stale = generic / "dds" / "Ask.idl"
    stale.parent.mkdir(exist_ok=True)
    stale.write_bytes((network.parent / "dds" / "generic" / "dds" / "Ask.idl").read_bytes())
    assert rcgen([cdsl, "--middleware", "zeromq"]) == 0
    stale.parent.mkdir(exist_ok=True)
    stale.write_bytes((network.parent / "dds" / "generic" / "dds" / "Ask.idl").read_bytes())
    capsys.readouterr()
    assert rcgen(["--check", cdsl]) == 1
    assert f"no longer generated: {stale}" in capsys.readouterr().out


def test_a_bad_name_written_into_the_generated_code_is_reported(network: Path, capsys: Said) -> None:
    assert rcgen([str(network)]) == 0
    worker = network.parent / "client" / "generic" / "genericworker.py"
    worker.write_text(worker.read_text().replace('middleware = "auto"', 'middleware = "zerom-q"'))
    for arguments in ([str(network)], ["--check", str(network)]):
        capsys.readouterr()
        assert rcgen(arguments) == 1
        assert f"{worker}: unknown middleware `zerom-q`" in capsys.readouterr().err
    assert rcgen([str(network), "--middleware", "auto"]) == 0
    assert 'middleware = "auto"' in worker.read_text()
