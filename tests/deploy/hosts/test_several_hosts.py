"""Networks over several hosts, as a user starts them: OpenSSH's own servers, in network namespaces. Needs root."""

from __future__ import annotations

import json
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.tools.recording.reader import Recording
from tests.actions import flight
from tests.browser import browsing
from tests.deploy.hosts.site import Site, generate, gone, laid_out

pytestmark = pytest.mark.tool

IDSL = """
module RoboCompEcho
{
    interface Echo { idempotent int twice(int value); };
    interface Tick { void tick(int number); };
};
"""
ECHO = """
import "../Echo.idsl";
Component Echo { Communications { implements Echo; publishes Tick; }; language python; period 20 ms; };
"""
ASKER = """
import "../Echo.idsl";
Component Asker { Communications { requires Echo; subscribesTo Tick; }; language python; period 20 ms; };
"""
ECHOING = """
    number = 0

    def compute(self) -> None:
        self.number += 1
        self.tick_proxy.tick(self.number)

    def Echo_twice(self, value: int) -> int:
        return 2 * value
"""
ASKING = """
    heard = 0

    def compute(self) -> None:
        if self.echo_proxy.twice(21) == 42 and self.heard >= 3:
            self.log.info("asked and heard")
            self.stop()

    def Tick_tick(self, number: int) -> None:
        self.heard += 1
"""

EAR = """
import "../Echo.idsl";
Component Ear { Communications { subscribesTo Tick; }; language python; };
"""
HEARING = """
    def Tick_tick(self, number: int) -> None:
        if number < 0:
            self.log.info("told %d", number)
"""
SCRIPT = """
from robocomp_py import connect
from robocomp_py.errors import HostUnreachable

with connect("Lab", timeout=30) as net:
    echo = net.wait("echo/Echo")
    print("twice", echo.twice(21))
    first, second = (number for number, _ in zip(net.echo.Tick, range(2)))
    print("next", second - first)
"""
LOST = """
from robocomp_py import connect

try:
    connect("Lab").echo.Echo.twice(21)
except Exception as exc:
    print(type(exc).__name__, exc)
"""


@pytest.fixture(scope="module")
def components(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("components")
    (root / "Echo.idsl").write_text(IDSL)
    generate(root, "echo", ECHO, ECHOING)
    generate(root, "asker", ASKER, ASKING)
    generate(root, "ear", EAR, HEARING)
    flight.write(root)
    return root


@pytest.fixture
def site(tmp_path: Path, components: Path) -> Iterator[Site]:
    with laid_out(components) as made:
        yield made


def test_components_on_two_hosts_talk_to_each_other(site: Site):
    """Over every middleware, and with keys: see test_grid."""
    site.host("robot")
    site.host("base")
    net = site.network("Component echo : Echo { host robot; }; Component asker : Asker { host base; };")
    run = site.done("--insecure", net, "--until", "asker", "--record-logs", "json")
    assert run.code == 0, run.text
    assert "asked and heard" in run.text
    logs = site.done("logs", net, "--json", "--level", "info", "--grep", "^asked")
    (record,) = (json.loads(line) for line in logs.lines if line.startswith("{"))
    assert [record[key] for key in ("instance", "level", "text")] == ["asker", "info", "asked and heard"]
    assert record["file"].endswith("specificworker.py")
    gone(site, "robot", "base")


@pytest.mark.parametrize("middleware", ["zeromq", "zenoh"])
def test_goals_are_awaited_over_two_hosts_with_keys(site: Site, middleware: str):
    site.host("robot")
    site.host("base")
    instances = "Component ship : ship { host robot; }; Component crew : crew { host base; };"
    net = site.network(instances, f"security lan; middleware {middleware};")
    made = site.done("keys", net)
    assert made.code == 0, made.text
    run = site.done(net, "--until", "crew")
    assert run.code == 0, run.text
    for line in flight.TOLD:
        assert line in run.text, run.text
    gone(site, "robot", "base")


@pytest.mark.parametrize("middleware", ["zeromq", "zenoh", "dds"])
def test_three_hosts_and_this_machine_run_one_network(site: Site, middleware: str):
    for name in ("robot", "base", "tower"):
        site.host(name)
    net = site.network(
        "Component echo : Echo { host robot; };"
        "Component one : Asker { host base; }; Component two : Asker { host tower; }; Component here : Asker { };",
        f"security open; middleware {middleware};",
    )
    run = site.run("--insecure", net)
    for name in ("one", "two", "here"):
        run.says(rf"{name} │ .*asked and heard")
    run.signal(signal.SIGINT)
    assert run.code == 130, run.text
    gone(site, "robot", "base", "tower")


def test_tools_see_what_runs_on_all_hosts(site: Site):
    site.host("robot")
    site.host("base")
    net = site.network(
        "Component echo : Echo { host robot; }; Component other : Echo { host base; };",
        "security open; middleware ice;",
    )
    run = site.run("--insecure", net)
    run.says("both components")
    found = [json.loads(line) for line in site.rc("list", "--json").lines]
    assert [(each["owner"], each["host"]) for each in found] == [("echo", "robot"), ("other", "base")]
    heard = [json.loads(line) for line in site.rc("echo", "other/Tick", "-n", "2", "--json").lines]
    assert heard[1]["message"]["number"] == heard[0]["message"]["number"] + 1
    assert site.rc("call", "other/Echo/twice", "value=21").text == "42"
    measured = [json.loads(line) for line in site.rc("top", "--once", "--json").lines]
    assert {(each["component"], each["host"]) for each in measured} == {("echo", "robot"), ("other", "base")}
    examined = site.rc("doctor", "--json", "--check", "plan", "--check", "clocks", "--check", "unheard")
    assert examined.code == 0, examined.text
    noted = [json.loads(line)["text"].partition(",")[0] for line in examined.lines if line.startswith("{")]
    assert noted == ["echo publishes echo/Tick/tick", "other publishes other/Tick/tick"]
    site.hosts["base"].partition()
    run.says("base.* (out of reach|lost)")
    lost = site.rc("list")
    assert lost.code == 3, lost.text
    assert "base" in lost.text
    assert "echo" in lost.text
    site.hosts["base"].heal()
    run.signal(signal.SIGINT)
    assert run.code == 3, run.text
    gone(site, "robot", "base")


@pytest.mark.parametrize("middleware", ["zeromq", "dds"])
def test_tools_measure_publish_record_and_script_over_hosts(site: Site, middleware: str):
    site.host("robot")
    site.host("base")
    net = site.network(
        "Component echo : Echo { host robot; }; Component ear : Ear { host base; };",
        f"security open; middleware {middleware};",
    )
    run = site.run("--insecure", net)
    run.says("both components")
    for seconds in (1.5, 6, 24):  # on a busy machine, nothing may come in a short time
        rate = site.rc("hz", "echo/Tick", "--for", seconds, "--json")
        if rate.code == 0:
            break
    measured = [json.loads(line) for line in rate.lines]
    assert (measured[-1]["channel"], measured[-1]["missing"]) == ("echo/Tick/tick", 0)
    assert measured[-1]["hz"] > 1
    assert site.rc("pub", "echo/Tick", "number=-7").code == 0
    run.says(r"ear │ .*told -7")
    for seconds in (1, 4, 16):
        folder = site.folder / f"recording-{seconds}"
        recorded = site.rc("record", "Tick", "--for", seconds, "-o", folder, "--json")
        assert recorded.code == 0, recorded.text
        (topic,) = json.loads(recorded.lines[-1])["topics"]
        if topic["messages"]:
            break
    assert (topic["channel"], topic["host"], topic["lost"]) == ("echo/Tick/tick", "robot", 0)
    with Recording(folder) as recording:
        assert recording.counts["echo/Tick/tick"] == topic["messages"] > 0
    assert site.script(SCRIPT).lines == ["twice 42", "next 1"]
    if middleware == "zeromq":
        site.hosts["robot"].partition()
        run.says("robot.* (out of reach|lost)")
        lost = site.script(LOST).lines
        assert any(line.startswith("NotThere") and "robot" in line for line in lost), lost
        site.hosts["robot"].heal()
    run.signal(signal.SIGINT)
    run.wait()
    gone(site, "robot", "base")


@pytest.mark.timeout(600)
def test_the_monitor_draws_hosts_and_shows_one_that_is_lost_until_it_is_back(site: Site, tmp_path: Path):
    site.host("robot")
    base = site.host("base")
    net = site.network(
        "Component echo : Echo { host robot; restart always; }; Component other : Echo { host base; restart always; };",
        "security open; middleware zeromq;",
    )
    run = site.run("--insecure", net)
    run.says("both components")
    monitor = site.beginning("monitor", "Lab", "--every", "0.3")
    monitor.says(r"http://\S+")
    (tmp_path / "browser").mkdir()
    rows = "[...document.querySelectorAll('#components tbody tr')].map(row => row.innerText).join('|')"
    with browsing(tmp_path / "browser", monitor.lines[0].strip()) as browser:
        titles = "[...document.querySelectorAll('#picture text')].map(each => each.textContent).join('|')"
        for name, host in site.hosts.items():
            browser(wait=f"{titles}.includes('host {name} ({host.address})')")
        browser(wait=f"(({rows}).match(/compute/g) || []).length === 2")
        base.partition()
        run.says("base.* (out of reach|lost)")
        browser(wait="document.querySelector('#troubles').innerText.includes('base')")
        assert "compute" in browser(wait=rows)
        base.heal()
        run.says("base is back")
        browser(wait="document.querySelector('#troubles').innerText === ''")
        browser(wait=f"(({rows}).match(/compute/g) || []).length === 2")
    monitor.signal(signal.SIGINT)
    run.signal(signal.SIGINT)
    gone(site, "robot", "base")


def test_an_operator_hears_all_and_calls_only_introspection_and_what_is_allowed(site: Site):
    site.host("base")
    net = site.network(
        "Component echo : Echo { }; Component second : Echo { host base; };"
        "Component asker : Asker { host base; requires Echo from echo; subscribesTo Tick from echo; };"
        "Component more : Asker { requires Echo from second; subscribesTo Tick from second; };",
        "security lan; middleware zenoh; allow second/Echo/twice;",
    )
    made = site.done("keys", net, "--operator")
    assert made.code == 0, made.text
    run = site.run(net)
    run.says("second │ .*ready")
    run.says("echo │ .*ready")
    here = ("--host", "here", "--network", net)
    assert site.rc("list", "--host", "here").code == 1
    listed = [json.loads(line) for line in site.rc("list", "--json", *here).lines]
    assert {"echo", "second"} <= {each["owner"] for each in listed}
    heard = site.rc("echo", "second/Tick", "-n", "1", *here)
    assert heard.code == 0, heard.text
    measured = [json.loads(line) for line in site.rc("top", "--once", "--json", *here).lines]
    assert {"echo", "second"} <= {each["component"] for each in measured}
    assert site.rc("call", "second/Echo/twice", "value=21", *here).text == "42"
    script = site.script(SCRIPT.replace("echo", "second"))
    assert script.lines == ["twice 42", "next 1"], script.text
    refused = site.rc("call", "echo/Echo/twice", "value=1", *here)
    assert refused.code == 1
    assert "keys of this process do not allow it" in refused.text
    assert "for a tool list the operation there as in `allow echo/Echo/twice;`" in refused.text
    unpublished = site.rc("pub", "second/Tick", "number=1", *here)
    assert unpublished.code == 1
    assert "second/Tick/tick: the keys of an operator publish nothing" in unpublished.text
    run.signal(signal.SIGINT)
    run.wait()
    gone(site, "base")


def test_nothing_is_reached_but_where_the_network_says(site: Site):
    robot = site.host("robot")
    base = site.host("base")
    instances = "Component echo : Echo { host robot; }; Component asker : Asker { host base; };"
    net = site.network(instances + "Component more : Asker { host robot; };", "security open; middleware zeromq;")
    run = site.run("--insecure", net)
    run.says("more │ .*asked and heard")
    listening = {line.split()[3] for line in robot.do("ss", "-Hltn").splitlines()}
    assert f"{robot.address}:22" in listening
    assert len(listening) > 1
    assert all(each.startswith((robot.address, "127.0.0.1")) for each in listening), listening
    assert {line.split()[3] for line in base.do("ss", "-Hltn").splitlines()} == {f"{base.address}:22"}
    run.signal(signal.SIGINT)
    assert run.code == 130, run.text


def test_nothing_is_started_when_a_host_cannot_be_reached(site: Site):
    site.host("robot")
    tower = site.host("tower", serves=False)
    net = site.network("Component echo : Echo { host robot; }; Component asker : Asker { host tower; };")
    run = site.done("--insecure", net)
    assert run.code == 3
    assert f"tower ({tower.address}) cannot be reached" in run.text
    assert "is it on" in run.text
    assert "ready" not in run.text
    gone(site, "robot")


def test_a_host_with_a_changed_key_is_refused_until_it_is_trusted(site: Site):
    robot = site.host("robot")
    net = site.network("Component echo : Echo { host robot; };")
    site.servers["robot"].change_key()
    run = site.done("--insecure", net)
    assert run.code == 3
    assert "has the key SHA256:" in run.text
    assert f"rcdeploy trust root@{robot.address}" in run.text
    shown = re.search(r"SHA256:[^\s,]+", run.text)
    assert shown
    wrong = site.done("trust", f"root@{robot.address}", "--fingerprint", "SHA256:another")
    assert (wrong.code, "was not saved" in wrong.text) == (1, True)
    right = site.done("trust", f"root@{robot.address}", "--fingerprint", shown[0])
    assert right.code == 0, right.text
    run = site.run("--insecure", net)
    run.says("the component of Lab is ready")
    run.signal(signal.SIGINT)
    assert run.code == 130, run.text


def test_a_host_that_dies_is_reported_and_the_network_still_ends(site: Site):
    robot = site.host("robot")
    site.host("base")
    net = site.network("Component echo : Echo { host robot; }; Component other : Echo { host base; };")
    run = site.run("--insecure", net)
    run.says("both components")
    robot.die()
    run.says("robot.* (out of reach|lost)")
    run.signal(signal.SIGINT)
    assert run.code in (3, 130), run.text
    gone(site, "base")


def test_after_a_cut_what_ran_there_is_stopped_and_started_again(site: Site):
    robot = site.host("robot")
    net = site.network("Component echo : Echo { host robot; restart on_failure; };")
    run = site.run("--insecure", net)
    run.says("the component of Lab is ready")
    before = site.left("robot")
    robot.partition()
    gone(site, "robot")
    run.says("robot.* (out of reach|lost)")
    robot.heal()
    run.says("robot is back")
    run.says("echo │ ready", times=2)
    assert len(site.left("robot")) == len(before)
    run.signal(signal.SIGINT)
    assert run.code == 130, run.text
    gone(site, "robot")


def test_what_a_user_stops_on_a_host_stays_so_after_a_cut_until_it_is_started(site: Site):
    robot = site.host("robot")
    net = site.network(
        "Component echo : Echo { host robot; restart always; };"
        "Component other : Echo { host robot; restart on_failure; };"
    )
    run = site.run("--insecure", net)
    run.says("both components of Lab are ready")
    stopped = site.done("stop", net, "echo")
    assert (stopped.code, "echo is stopped" in stopped.text) == (0, True), stopped.text
    assert not site.echoes("robot")
    robot.partition()
    run.says("robot.* (out of reach|lost)")
    unreachable = site.done("stop", net, "other")
    assert (unreachable.code, "out of reach" in unreachable.text) == (3, True), unreachable.text
    robot.heal()
    run.says("robot is back")
    assert "stopped by the user" in site.done("status", net).text
    started = site.done("start", net, "echo")
    assert (started.code, "echo is ready" in started.text) == (0, True), started.text
    run.signal(signal.SIGINT)
    assert run.code == 130 or "other" in run.text, run.text
    gone(site, "robot")


def test_nothing_is_left_when_rcdeploy_is_killed(site: Site):
    site.host("robot")
    net = site.network("Component echo : Echo { host robot; };")
    run = site.run("--insecure", net)
    run.says("the component of Lab is ready")
    run.signal(signal.SIGKILL)
    run.wait()
    gone(site, "robot")


def test_what_a_host_keeps_is_ended_by_down(site: Site):
    site.host("robot")
    net = site.network("Component echo : Echo { host robot; };", robot="lost keep;")
    run = site.run("--insecure", net)
    run.says("the component of Lab is ready")
    run.signal(signal.SIGKILL)
    run.wait()
    assert site.left("robot")
    down = site.done("down", net)
    assert (down.code, "ended on robot: echo" in down.text) == (0, True), down.text
    gone(site, "robot")


def test_what_a_host_keeps_is_taken_over(site: Site):
    site.host("robot")
    net = site.network("Component echo : Echo { host robot; };", robot="lost keep;")
    first = site.run("--insecure", net)
    first.says("the component of Lab is ready")
    first.signal(signal.SIGKILL)
    first.wait()
    before = site.echoes("robot")
    assert len(before) == 1
    second = site.run("--insecure", net)
    second.says("the component of Lab is ready")
    bundles = [each.name for each in (site.servers["robot"].home / ".robocomp" / "bundles").iterdir() if each.is_dir()]
    assert (site.echoes("robot"), len(bundles)) == (before, 1)
    second.signal(signal.SIGINT)
    assert second.code == 130, second.text
    gone(site, "robot")
