"""The example of a transport, a package of its own, carries a network over two hosts. Needs root."""

from __future__ import annotations

import shutil
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.deploy.hosts.site import Site, gone, laid_out
from tests.deploy.hosts.test_several_hosts import components

pytestmark = pytest.mark.tool

__all__ = ["components"]

EXAMPLE = Path(__file__).parents[3] / "examples" / "unixsock"
INSTANCES = "Component echo : Echo { host robot; }; Component asker : Asker { host base; };"


def install(folder: Path) -> None:
    """The package as pip would install it."""
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())
    about = folder / "robocomp_unixsock-0.1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: robocomp-unixsock\nVersion: 0.1.0\n")
    groups = project["project"]["entry-points"].items()
    lines = [line for group, named in groups for line in (f"[{group}]", *(f"{n} = {v}" for n, v in named.items()))]
    (about / "entry_points.txt").write_text("\n".join(lines))
    for name in project["tool"]["hatch"]["build"]["targets"]["wheel"]["include"]:
        shutil.copy(EXAMPLE / name, folder)


@pytest.fixture
def site(tmp_path: Path, components: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    packages = tmp_path / "packages"
    install(packages)
    monkeypatch.setenv("PYTHONPATH", str(packages))
    with laid_out(components) as made:
        made.of_hosts["PYTHONPATH"] = str(packages)
        made.host("robot")
        made.host("base")
        yield made


@pytest.mark.parametrize("security", ["open", "lan"])
def test_components_on_two_hosts_talk_to_each_other_over_the_example(site: Site, security: str) -> None:
    net = site.network(INSTANCES, f"security {security}; middleware unixsock;")
    if security == "lan":
        made = site.done("keys", net)
        assert made.code == 0, made.text
    run = site.done(*(["--insecure"] if security == "open" else []), net, "--until", "asker")
    assert run.code == 0, run.text
    assert "asked and heard" in run.text
    gone(site, "robot", "base")


STRANGER = """
import socket, ssl, sys
address, port, keys = sys.argv[1:]
connection = socket.create_connection((address, int(port)), 5)
try:
    if keys:
        context = ssl.create_default_context(cafile=f"{keys}/ca.pem")
        context.load_cert_chain(f"{keys}/certificate.pem", f"{keys}/key.pem")
        connection = context.wrap_socket(connection, server_hostname=address)
    connection.sendall(b"{}\\n")
    print("told" if connection.recv(99).startswith(b"[") else "refused")
except OSError:
    print("refused")
"""


def test_a_relay_of_the_example_talks_to_relays_of_its_network_alone(site: Site) -> None:
    net = site.network(
        INSTANCES.replace("host base;", "host base; restart always;"), "security lan; middleware unixsock;"
    )
    made = site.done("keys", net)
    assert made.code == 0, made.text
    run = site.run(net)
    run.says(r"asker │ .*asked and heard")
    robot, keys = site.hosts["robot"], site.folder / "keys" / "Lab"
    listening = (line.split()[3].rpartition(":")[2] for line in robot.do("ss", "-Hltn").splitlines())
    port = next(port for port in listening if port != "22")

    def asked(*keys: Path) -> str:
        words = (sys.executable, "-c", STRANGER, robot.address, port, *(map(str, keys) if keys else [""]))
        return site.hosts["base"].do(*words).strip()

    assert asked() == "refused"
    assert asked(keys / "asker") == "refused"
    assert asked(keys / "router@base") == "told"
    run.interrupt()
    gone(site, "robot", "base")


def test_security_local_does_not_let_the_example_cross_hosts(site: Site) -> None:
    net = site.network(INSTANCES, "security local; middleware unixsock;")
    run = site.done("plan", net)
    assert run.code == 1
    assert "which `security local` does not allow" in run.text
