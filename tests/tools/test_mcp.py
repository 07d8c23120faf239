"""What an agent may do with a running network: read it, and call what it allows, within bounds, all of it logged."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import pytest

from robocomp_py.cli import rc
from robocomp_py.client.goals import Action
from robocomp_py.client.session import Session
from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.deploy.place import Place
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools import asking
from robocomp_py.tools.access import Access
from robocomp_py.tools.census import take_census
from robocomp_py.tools.mcp.bounds import Bounds, Rate, Refused, fitted
from robocomp_py.tools.mcp.permissions import permissions_of
from robocomp_py.tools.mcp.requests import Requests
from robocomp_py.tools.network import End, Network
from robocomp_py.tools.posts import Post
from robocomp_py.transports.base import find_transport

from ..client.pilot import flying
from ..runtime.components import Calculator, Diary, Tuned
from ..runtime.running import make, running
from .talkers import Talker
from .terse import INTERFACE, terse
from .test_scout import Direct

LONG = 6 * SOON
"""Seconds for a client and its server, which may be a process that has to start."""

SET = ("middleware=shm", "namespace=robot1")
PREFIXES = {
    "station": "robot1/station",
    "tuned": "robot1/tuned",
    "ear": "robot1/ear",
    "lonely": "robot2/ear",
    "pilot": "pilot",
}


# `mcp` takes a second to import: only workers that run tests of it do.


def client_of(requests: Requests, mode: str = "auto") -> Any:
    from mcp import Client

    from robocomp_py.tools.mcp.server import make_server

    return Client(make_server(requests, "tamed"), mode=mode)


def client_of_rc_mcp(*arguments: str) -> Any:
    from mcp import Client, StdioServerParameters
    from mcp.client.stdio import stdio_client

    rc_mcp = ["-m", "robocomp_py.cli.rc", "mcp", *arguments]
    return Client(stdio_client(StdioServerParameters(command=sys.executable, args=rc_mcp, env=dict(os.environ))))


def permission(instance: str, interface: str, operation: str, kind: str) -> dict[str, str]:
    return {"instance": instance, "named": "", "interface": interface, "operation": operation, "kind": kind}


ALLOW = [
    *(permission("station", "Everything", each, "call") for each in ("divide", "work", "poke")),
    permission("pilot", "Pilot", "fly", "goal"),
    permission("ear", "Everything", "news", "publication"),
    permission("lonely", "Everything", "news", "publication"),
]
PLAN = {
    "name": "tamed",
    "processes": [{"instances": [each]} for each in PREFIXES],
    "ours": {name: {"channels": prefix} for name, prefix in PREFIXES.items()},
    "allow": ALLOW,
}


class Ear(Diary):
    """Hears any publisher of its namespace."""

    component = Component("ear", (Port(Verb.SUBSCRIBES, e.EVERYTHING),), period=0.05)

    def Everything_news(self, number: int, text: str) -> None:
        if text != "hello":
            self.entries.append(f"{number} {text}")


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """The workers of components, one of which does not belong to the network of the agent."""
    with (
        flying(tmp_path_factory.mktemp("mcp")),
        running(make(Talker, find_transport, *SET)) as station,
        running(make(Tuned, find_transport, *SET, "params.device=here")) as tuned,
        running(make(Calculator, find_transport, *SET)) as stranger,
        running(make(Ear, find_transport, *SET)) as ear,
        running(make(Ear, find_transport, "middleware=shm", "namespace=robot2")) as lonely,
    ):
        wait_until(lambda: len(asking.components(take_census(["shm"]))) >= 6, LONG)
        yield {"station": station, "tuned": tuned, "calculator": stranger, "ear": ear, "lonely": lonely}


class Agent:
    """An agent with its server, over the library's own client. `log` has what the server has written down."""

    def __init__(self, access: Access, bounds: Bounds, also: Callable[[], Iterable[End]] = tuple) -> None:
        """`also` tells what runs on other hosts."""
        self.log: list[str] = []
        self.session = Session("", ["shm"], SOON)
        self.requests = Requests(
            access,
            lambda: Network([*take_census(["shm"], own=True).ends, *also()]),
            permissions_of(PLAN),
            lambda level, text: self.log.append(f"{level}: {text}"),
            lambda offered, values: Action(self.session, offered)(*values),
            bounds,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.requests.close()
        self.session.close()

    def ask(self, tool: str, mode: str = "auto", **arguments: Any) -> Any:
        """The answer as JSON. Raises Refused with the text of an error."""

        async def ask() -> Any:
            async with client_of(self.requests, mode) as client:
                return await client.call_tool(tool, arguments)

        found = asyncio.run(asyncio.wait_for(ask(), LONG))
        [content] = found.content
        if found.is_error:
            raise Refused(content.text)
        return json.loads(content.text)


@pytest.fixture
def agent(network: dict[str, Any]) -> Iterator[Agent]:
    with Access() as access, Agent(access, Bounds()) as made:
        yield made


def test_an_agent_sees_its_network_and_nothing_else(agent: Agent) -> None:
    seen = agent.ask("list_components")
    assert {each["component"].strip("/") for each in seen["components"]} == set(PREFIXES.values())
    assert seen["may_be_called"] == [f"robot1/station/Everything/{name}" for name in ("divide", "work", "poke")]
    assert (seen["goals_may_be_begun"], seen["may_be_published"]) == (
        ["pilot/Pilot/fly"],
        ["robot1/ear/Everything/news", "robot2/ear/Everything/news"],
    )
    channels = agent.ask("list_channels", mode="legacy")
    assert {each["channel"].rpartition("/")[0] for each in channels} == {"robot1/station/Everything", "pilot/Pilot"}
    [poke] = agent.ask("list_channels", kind="command")
    assert (poke["channel"], poke["kind"], poke["may_be_called"]) == ("robot1/station/Everything/poke", "command", True)
    [news] = agent.ask("list_channels", contains="news")
    assert (news["kind"], news["may_be_published"]) == ("topic", True)
    [fly] = agent.ask("list_channels", kind="action")
    assert (fly["channel"], fly["goals_may_be_begun"]) == ("pilot/Pilot/fly", True)


def test_an_agent_reads_a_topic_of_all_hosts(network: dict[str, Any]) -> None:
    with contextlib.closing(Post("base", Direct)) as post, Access() as access:

        def there() -> list[End]:
            return [replace(each, host="base", via=post) for each in take_census(["shm"], own=True).ends]

        messages: list[Any] = []

        def heard() -> set[str]:
            messages.extend(agent.ask("read_topic", topic="station/Everything", count=20)["messages"])
            return {each["host"] for each in messages}

        with Agent(access, Bounds(), there) as agent:
            wait_until(lambda: heard() == {"", "base"})
    assert {each["message"]["text"] for each in messages} == {"hello"}


def test_an_agent_reads_topics_contracts_parameters_and_measures(agent: Agent) -> None:
    messages = agent.ask("read_topic", topic="station/Everything", count=3)["messages"]
    numbers = [each["number"] for each in messages]
    assert numbers == sorted(numbers)
    assert {each["text"] for each in messages} == {"hello"}
    divide = agent.ask("describe", name="divide")
    assert divide["arguments"] == {"dividend": 0, "divisor": 0}
    assert "divide(int64 dividend, int64 divisor" in divide["contract"][0]
    settings = {each["name"]: each for each in agent.ask("read_parameters", component="tuned")["parameters"]}
    assert (settings["max_speed"]["allowed"], settings["max_speed"]["dynamic"]) == ("float, 0.0 to 2.0", True)
    assert agent.ask("read_measures", component="station")["measures"]["computes"] > 0


def test_an_agent_calls_what_the_network_allows(agent: Agent, network: dict[str, Any]) -> None:
    divided = agent.ask("call", operation="station/Everything/divide", arguments={"dividend": 7, "divisor": 2})
    assert divided == {"result": {"ret": 3, "remainder": 1}}
    failed = agent.ask("call", operation="divide", arguments={"dividend": 1, "divisor": 0})
    assert failed["exception"] == "Failed"
    assert agent.ask("call", operation="work", arguments={"task": "dig"}) == {"result": "dig"}
    assert agent.ask("call", operation="poke", arguments={"number": 5}) == {"sent": "robot1/station/Everything/poke"}
    wait_until(lambda: "poked 5" in network["station"].entries)


FLIGHT = {"target": {"x": 1, "y": 2}, "steps": 3}


def test_an_agent_begins_reads_and_cancels_goals_that_the_network_allows(agent: Agent) -> None:
    fly = agent.ask("describe", name="Pilot/fly")
    assert fly["contract"][0].startswith("[action] int32 fly(Place target, int32 steps)")
    assert (fly["kind"], fly["arguments"]["steps"], fly["goals_may_be_begun"]) == ("action", 0, True)
    begun = agent.ask("begin_goal", action="fly", arguments=FLIGHT)
    ended = agent.ask("read_goal", goal=begun["goal"], timeout=30)
    assert ended == {"goal": begun["goal"], "action": "pilot/Pilot/fly", "status": "SUCCEEDED", "result": 3}
    blocked = agent.ask("begin_goal", action="fly", arguments=FLIGHT | {"target": {"x": -1, "y": 0}})
    ended = agent.ask("read_goal", goal=blocked["goal"], timeout=30)
    assert (ended["exception"], ended["fields"]) == ("RoboCompPilot.Blocked", {"by": "a bird"})
    far = agent.ask("begin_goal", action="fly", arguments=FLIGHT | {"steps": 100_000})["goal"]
    wait_until(lambda: (agent.ask("read_goal", goal=far, timeout=0.05)["feedback"] or {}).get("left"))
    agent.ask("cancel_goal", goal=far)
    assert agent.ask("read_goal", goal=far, timeout=30)["status"] == "CANCELED"
    wait_until(lambda: f"INFO: goal {far} of pilot/Pilot/fly: CANCELED" in agent.log)
    begun_at = [each for each in agent.log if each.startswith("INFO: begin goal of pilot/Pilot/fly ")]
    assert len(begun_at) == 3


def test_a_goal_whose_time_is_over_is_cancelled(agent: Agent) -> None:
    far = agent.ask("begin_goal", action="fly", arguments=FLIGHT | {"steps": 100_000}, limit=0.2)["goal"]
    assert agent.ask("read_goal", goal=far, timeout=30)["status"] == "CANCELED"
    assert f"WARNING: goal {far} of pilot/Pilot/fly: not over in 0.2 s; it is cancelled" in agent.log


def test_goals_end_with_the_server_and_are_few(network: dict[str, Any]) -> None:
    with Access() as access, Agent(access, Bounds(goals=1)) as agent:
        far = agent.ask("begin_goal", action="fly", arguments=FLIGHT | {"steps": 100_000})["goal"]
        with pytest.raises(Refused, match=f"at most 1 goals at a time; these are not over: {far}"):
            agent.ask("begin_goal", action="fly", arguments=FLIGHT)
    with Access() as access, Agent(access, Bounds()) as other:
        wait_until(lambda: _begins(other), LONG)


def _begins(agent: Agent) -> bool:
    """Whether the pilot, which refuses a second goal, has a goal no more."""
    try:
        agent.ask("begin_goal", action="fly", arguments=FLIGHT)
    except Refused:
        return False
    return True


def test_an_agent_publishes_what_the_network_allows(agent: Agent, network: dict[str, Any]) -> None:
    message = {"number": 7, "text": "from an agent"}
    assert agent.ask("describe", name="robot2/ear/Everything/news")["may_be_published"]
    for topic, channel, ear in (
        ("robot1/ear/Everything/news", "robot1/station/Everything/news", network["ear"]),
        ("robot2/ear/Everything/news", "robot2/rc-mcp/Everything/news", network["lonely"]),
    ):
        assert agent.ask("publish", topic=topic, arguments=message) == {"published": channel}
        wait_until(lambda: "7 from an agent" in ear.entries, LONG)  # noqa: B023 - it ends within the loop
        assert f"INFO: publish {channel} {json.dumps(message)}" in agent.log


@pytest.mark.parametrize(
    ("tool", "arguments", "why"),
    [
        ("call", {"operation": "echo_nested"}, "does not allow robot1/station/Everything/echo_nested; it allows"),
        ("call", {"operation": "calculator/Everything/work", "arguments": {"task": "x"}}, "unknown channel"),
        ("call", {"operation": "station/CommonBehavior/killYourSelf"}, "unknown channel"),
        ("call", {"operation": "news"}, "is a topic; read_topic reads it"),
        ("call", {"operation": "work", "arguments": {"tsak": "x"}}, "did you mean `task`"),
        ("call", {"operation": "work", "arguments": {"task": "x" * 70_000}}, "longer than 65536 characters"),
        ("call", {"operation": "work", "arguments": {"task": "x"}, "timeout": 1e9}, "above 0, up to 30"),
        ("call", {}, "`operation` is missing"),
        ("call", {"operation": "fly"}, "is an action; begin_goal begins a goal"),
        ("begin_goal", {"action": "Pilot/flyy"}, "did you mean `Pilot/fly`"),
        ("begin_goal", {"action": "fly", "arguments": {"steps": 3}}, "lacks `target`"),
        ("begin_goal", {"action": "fly", "arguments": FLIGHT, "limit": 1e6}, "limit=1000000.0 is not a number"),
        ("read_goal", {"goal": "12345678"}, "unknown goal `12345678`; known: none"),
        ("cancel_goal", {}, "`goal` is missing: a name, as begin_goal returns it"),
        ("publish", {"topic": "news", "arguments": {"number": 1, "text": "x"}}, "may be"),
        ("publish", {"topic": "robot1/ear/Everything/news", "arguments": {"number": 1}}, "lacks `text`"),
        ("publish", {"topic": "work", "arguments": {"task": "x"}}, "unknown topic"),
        ("describe", {"name": "devide"}, "did you mean"),
        ("read_topic", {"topic": "work"}, "unknown topic"),
        ("read_topic", {"topic": "news", "count": 1000}, "a whole number from 1 to 20"),
        ("read_parameters", {"component": "calculator"}, "unknown component `calculator`"),
        ("list_channels", {"kind": "topics"}, "did you mean `topic`"),
        ("list_channels", {"kind": ["topic"]}, "unknown kind"),
        ("call", {"operation": "work", "arguments": ["x"]}, "it takes"),
        ("shell", {"command": "ls"}, "unknown tool `shell`"),
    ],
)
def test_what_an_agent_may_not_have_is_refused_and_logged(
    agent: Agent, network: dict[str, Any], tool: str, arguments: dict[str, Any], why: str
) -> None:
    before = list(network["station"].entries), list(network["calculator"].entries)
    with pytest.raises(Refused, match=r".") as caught:
        agent.ask(tool, **arguments)
    assert why in str(caught.value)
    [line] = agent.log
    assert line.startswith(f"WARNING: {tool} ")
    assert [each for each in network["station"].entries if each not in before[0]] in ([], ["compute"])
    assert "work x" not in network["calculator"].entries


def test_everything_that_an_agent_does_is_logged_before_it_is_done(agent: Agent) -> None:
    agent.ask("call", operation="work", arguments={"task": "dig\x1b[2J"})
    begun, done = agent.log
    assert begun == 'INFO: call robot1/station/Everything/work {"task": "dig\\u001b[2J"}'
    assert done.startswith('INFO: call {"operation": "work", "arguments": {"task": "dig\\u001b[2J"}}: answered (')


def test_calls_are_limited_and_reads_go_on(network: dict[str, Any]) -> None:
    with Access() as access, Agent(access, Bounds(calls_a_minute=2)) as agent:
        for _ in range(2):
            agent.ask("call", operation="work", arguments={"task": "dig"})
        with pytest.raises(Refused, match=r"at most 2 calls a minute; the next one in \d+ s"):
            agent.ask("call", operation="work", arguments={"task": "dig"})
        assert agent.ask("list_channels", kind="command")


def test_a_rate_forgets_what_was_a_minute_ago() -> None:
    now = [0.0]
    rate = Rate(2, "calls", lambda: now[0])
    rate.take()
    now[0] = 30.0
    rate.take()
    now[0] = 45.0
    with pytest.raises(Refused, match="in 15 s"):
        rate.take()
    now[0] = 60.0
    rate.take()


def test_an_answer_is_cut_to_its_bound() -> None:
    scan = {"scan": [{"angle": index / 7, "text": "x" * 3000} for index in range(5000)]}
    text, is_cut = fitted(scan, 20_000)
    assert is_cut
    assert len(text) <= 20_000
    assert json.loads(text)["scan"][-1].endswith(" more")
    assert fitted({"a": [1, 2]}, 100) == ('{"a": [1, 2]}', False)


@pytest.mark.parametrize(
    ("tool", "arguments"),
    [
        ("begin_goal", {"action": "fly", "arguments": FLIGHT}),
        ("publish", {"topic": "robot1/station/Everything/news", "arguments": {"number": 1, "text": "x"}}),
    ],
)
def test_goals_and_publications_that_the_network_does_not_allow_are_refused(
    tool: str, arguments: dict[str, Any], agent: Agent, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(agent.requests, "_permissions", permissions_of({**PLAN, "allow": []}))
    with pytest.raises(Refused, match=r"network `tamed` does not allow .*; it allows no (goal|publication)"):
        agent.ask(tool, **arguments)


def test_a_network_that_allows_nothing_has_no_calls() -> None:
    assert permissions_of({**PLAN, "allow": []}).all == ()
    assert permissions_of({**PLAN, "allow": [ALLOW[0] | {"named": "front"}]}).calls == (
        "robot1/front/Everything/divide",
    )


def test_a_client_starts_rc_mcp_for_a_network_that_runs(network: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "Everything.idsl").write_text(INTERFACE)
    place = Place("tamed")
    place.take("a test")
    try:
        place.leave_plan(json.dumps(PLAN | {"processes": [*PLAN["processes"], {"instances": ["terse"]}]}))

        async def ask() -> tuple[list[str], Any, Any]:
            async with client_of_rc_mcp("tamed", "--middleware", "shm", "-I", str(tmp_path)) as client:
                tools = (await client.list_tools()).tools
                called = await client.call_tool("call", {"operation": "work", "arguments": {"task": "stdio"}})
                described = await client.call_tool("describe", {"name": "terse/Everything/divide"})
                return [each.name for each in tools], called.content[0], described.content[0]

        with terse():
            tools, content, described = asyncio.run(asyncio.wait_for(ask(), LONG))
        assert tools[-1] == "publish"
        assert json.loads(content.text) == {"result": "stdio"}
        assert json.loads(described.text)["arguments"] == {"dividend": 0, "divisor": 0}
        assert "work stdio" in network["station"].entries
        log = (place.logs / "rc-mcp.log").read_text()
        assert 'call robot1/station/Everything/work {"task": "stdio"}' in log
        wait_until(lambda: "INFO: ends" in (place.logs / "rc-mcp.log").read_text(), LONG)
    finally:
        place.release()


@pytest.mark.parametrize(
    ("arguments", "code", "why"),
    [
        (["nothing"], 1, "network `nothing` is not running on this machine; start it: rcdeploy up FILE.ddsl"),
        (["missing.ddsl"], 1, "missing.ddsl cannot be read"),
        (["nothing", "--middleware", "smoke"], 2, "unknown middleware `smoke`"),
    ],
)
def test_what_cannot_be_served_is_told(
    arguments: list[str], code: int, why: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert rc.main(["mcp", *arguments]) == code
    assert why in capsys.readouterr().err


def test_a_missing_library_names_its_extra(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mcp", None)
    assert rc.main(["mcp", "tamed"]) == 2
    assert "pip install 'robocomp-py[mcp]'" in capsys.readouterr().err


def test_the_guide_lists_every_tool() -> None:
    guide = (Path(__file__).parents[2] / "docs" / "guides" / "mcp.md").read_text(encoding="utf-8")
    with Access() as access, Agent(access, Bounds()) as agent:

        async def ask() -> list[str]:
            async with client_of(agent.requests) as client:
                return [each.name for each in (await client.list_tools()).tools]

        tools = asyncio.run(asyncio.wait_for(ask(), LONG))
    assert re.findall(r"^\| `(\w+)` \|", guide, re.M) == tools
