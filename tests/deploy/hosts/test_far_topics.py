"""Topics of other hosts, as tools hear them through scouts: in network namespaces. Needs root."""

from __future__ import annotations

import contextlib
import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.testing.patience import wait_until
from tests.deploy.hosts.site import LONG, Rcdeploy, Site, generate, gone, laid_out
from tests.deploy.hosts.test_several_hosts import ECHO, ECHOING, IDSL

pytestmark = pytest.mark.tool


@pytest.fixture(scope="module")
def components(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("components")
    (root / "Echo.idsl").write_text(IDSL)
    generate(root, "echo", ECHO, ECHOING)
    return root


@pytest.fixture
def site(tmp_path: Path, components: Path) -> Iterator[Site]:
    with laid_out(components) as made:
        yield made


def scouts(site: Site, name: str) -> list[int]:
    """The processes of scouts on a host."""
    found = []
    for pid in site.hosts[name].pids():
        with contextlib.suppress(OSError):
            if "robocomp_py.tools.scout" in Path(f"/proc/{pid}/cmdline").read_text():
                found.append(pid)
    return found


def numbers(tool: Rcdeploy, host: str) -> list[int]:
    """Those of the messages of a host that `rc echo --json` has printed."""
    heard = [json.loads(line) for line in tool.lines if line.startswith("{")]
    return [each["message"]["number"] for each in heard if each["host"] == host]


def test_robots_whose_components_have_one_name_are_heard_together(site: Site) -> None:
    runs = []
    for name in ("robot", "base"):
        site.host(name)
        instances = f"Component echo : Echo {{ host {name}; restart always; }};"
        net = site.network(instances, "security open; middleware shm;", called=f"of_{name}")
        runs.append(site.run("--insecure", net))
    for run in runs:
        run.says("is ready")

    hearing, stopped = (site.beginning("echo", "Tick", "--json") for _ in range(2))
    for tool in (hearing, stopped):
        for name in site.hosts:
            tool.says(f'"host": "{name}"')
    assert [len(scouts(site, name)) for name in site.hosts] == [2, 2]
    stopped.signal(signal.SIGSTOP)
    before = {name: len(numbers(hearing, name)) for name in site.hosts}
    wait_until(lambda: all(len(numbers(hearing, name)) > before[name] + 60 for name in site.hosts), LONG)
    stopped.kill()
    wait_until(lambda: [len(scouts(site, name)) for name in site.hosts] == [1, 1], LONG)

    unknown = site.rc("echo", "Tock", "--timeout", "0.1")
    assert (unknown.code, unknown.text) == (1, "rc echo: `Tock` is not there; did you mean `Tick`?")

    for pid in scouts(site, "robot"):
        os.kill(pid, signal.SIGKILL)
    hearing.says(r"rc echo: robot .*: its scout has ended \(exit code -9\); the others go on")
    hearing.says("rc echo: robot is heard again")
    site.hosts["base"].partition()
    hearing.says(r"rc echo: base .* is out of reach: .*; the others go on")
    without = site.rc("echo", "Tick", "-n", "1", "--json")
    assert (without.code, len(numbers(without, "robot"))) == (3, 1), without.text
    assert "base" in without.text
    site.hosts["base"].heal()
    hearing.says("rc echo: base is heard again")
    hearing.signal(signal.SIGINT)
    assert hearing.code == 130
    for run in runs:
        run.signal(signal.SIGINT)
    for run in runs:
        run.wait()
    gone(site, "robot", "base")
