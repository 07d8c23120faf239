"""What an agent may do with a running network: read it, and call what it allows, within bounds, all of it logged."""

from __future__ import annotations

import asyncio
import io
import json
import os
import re
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from mcp import Client, StdioServerParameters
from mcp.client.stdio import stdio_client

from robocomp_py.cli import rc
from robocomp_py.deploy.place import Place
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools import asking
from robocomp_py.tools.access import Access
from robocomp_py.tools.census import take_census
from robocomp_py.tools.mcp.bounds import Bounds, Rate, Refused, fitted
from robocomp_py.tools.mcp.permissions import permissions_of
from robocomp_py.tools.mcp.requests import Requests
from robocomp_py.tools.mcp.server import make_server
from robocomp_py.transports.base import find_transport

from ..runtime.components import Calculator, Tuned
from ..runtime.test_middlewares import Station
from ..runtime.test_run import make, running

LONG = 6 * SOON
"""Seconds for a client and its server, which may be a process that has to start."""

SET = ("middleware=shm", "namespace=robot1")
PLAN = {
    "name": "tamed",
    "processes": [{"instances": ["station"]}, {"instances": ["tuned"]}],
    "ours": {"station": {"channels": "robot1/station"}, "tuned": {"channels": "robot1/tuned"}},
    "allow": [
        {"instance": "station", "named": "", "interface": "Everything", "operation": each}
        for each in ("divide", "work", "poke")
    ],
}


class Talker(Station):
    """Publishes all the time."""

    component = Station.component
    number = 0

    def compute(self) -> None:
        self.number += 1
        self.everything_proxy.news(self.number, "hello")

    def Everything_poke(self, number: int) -> None:
        self.entries.append(f"poked {number}")


@pytest.fixture(scope="module")
def network() -> Iterator[dict[str, Any]]:
    """The workers of three components, one of which does not belong to the network of the agent."""
    with (
        running(make(Talker, find_transport, *SET)) as station,
        running(make(Tuned, find_transport, *SET, "params.device=here")) as tuned,
        running(make(Calculator, find_transport, *SET)) as stranger,
    ):
        wait_until(lambda: len(asking.components(take_census(["shm"]))) >= 3, LONG)
        yield {"station": station, "tuned": tuned, "calculator": stranger}


class Agent:
    """An agent with its server, over the library's own client. `log` has what the server has written down."""

    def __init__(self, access: Access, bounds: Bounds) -> None:
        self.log: list[str] = []
        self.requests = Requests(
            access,
            partial(take_census, ["shm"]),
            permissions_of(PLAN),
            lambda level, text: self.log.append(f"{level}: {text}"),
            bounds,
        )

    def ask(self, tool: str, mode: str = "auto", **arguments: Any) -> Any:
        """The answer as JSON. Raises Refused with the text of an error."""

        async def ask() -> Any:
            async with Client(make_server(self.requests, "tamed"), mode=mode) as client:
                return await client.call_tool(tool, arguments)

        found = asyncio.run(asyncio.wait_for(ask(), LONG))
        [content] = found.content
        if found.is_error:
            raise Refused(content.text)
        return json.loads(content.text)


@pytest.fixture
def agent(network: dict[str, Any]) -> Iterator[Agent]:
    with Access() as access:
        yield Agent(access, Bounds())


def test_an_agent_sees_its_network_and_nothing_else(agent: Agent) -> None:
    seen = agent.ask("list_components")
    assert {each["component"].rpartition("/")[2] for each in seen["components"]} == {"station", "tuned"}
    assert seen["may_be_called"] == [f"robot1/station/Everything/{name}" for name in ("divide", "work", "poke")]
    channels = agent.ask("list_channels", mode="legacy")
    assert {each["channel"].split("/")[1] for each in channels} == {"station"}
    [poke] = agent.ask("list_channels", kind="command")
    assert (poke["channel"], poke["kind"], poke["may_be_called"]) == ("robot1/station/Everything/poke", "command", True)
    assert [each["kind"] for each in agent.ask("list_channels", contains="news")] == ["topic"]


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
    with Access() as access:
        agent = Agent(access, Bounds(calls_a_minute=2))
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


def test_a_network_that_allows_nothing_has_no_calls() -> None:
    assert permissions_of({**PLAN, "allow": []}).calls == ()
    assert permissions_of({**PLAN, "allow": [PLAN["allow"][0] | {"named": "front"}]}).calls == (  # type: ignore[index]
        "robot1/front/Everything/divide",
    )


def test_a_client_starts_rc_mcp_for_a_network_that_runs(network: dict[str, Any]) -> None:
    place = Place("tamed")
    place.take("a test")
    try:
        place.leave_plan(json.dumps(PLAN))

        async def ask() -> tuple[list[str], Any]:
            command = StdioServerParameters(
                command=sys.executable,
                args=["-m", "robocomp_py.cli.rc", "mcp", "tamed", "--middleware", "shm"],
                env=dict(os.environ),
            )
            async with Client(stdio_client(command)) as client:
                tools = (await client.list_tools()).tools
                called = await client.call_tool("call", {"operation": "work", "arguments": {"task": "stdio"}})
                return [each.name for each in tools], called.content[0]

        tools, content = asyncio.run(asyncio.wait_for(ask(), LONG))
        assert tools[-1] == "call"
        assert json.loads(content.text) == {"result": "stdio"}
        assert "work stdio" in network["station"].entries
        log = (place.logs / "rc-mcp.log").read_text()
        assert 'call robot1/station/Everything/work {"task": "stdio"}' in log
        wait_until(lambda: "INFO: ends" in (place.logs / "rc-mcp.log").read_text(), LONG)
    finally:
        place.release()


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["nothing"], "network `nothing` does not run here; start it: rcdeploy up FILE.ddsl"),
        (["missing.ddsl"], "missing.ddsl cannot be read"),
    ],
)
def test_a_network_that_does_not_run_is_told(
    arguments: list[str], why: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert rc.main(["mcp", *arguments]) == 1
    assert why in capsys.readouterr().err


def test_a_missing_library_names_its_extra(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mcp", None)
    assert rc.main(["mcp", "tamed"]) == 2
    assert "pip install 'robocomp-py[mcp]'" in capsys.readouterr().err


def test_the_guide_lists_every_tool() -> None:
    guide = (Path(__file__).parents[2] / "docs" / "guides" / "mcp.md").read_text(encoding="utf-8")
    with Access() as access:
        agent = Agent(access, Bounds())

        async def ask() -> list[str]:
            async with Client(make_server(agent.requests, "tamed")) as client:
                return [each.name for each in (await client.list_tools()).tools]

        tools = asyncio.run(asyncio.wait_for(ask(), LONG))
    assert re.findall(r"^\| `(\w+)` \|", guide, re.M) == tools
