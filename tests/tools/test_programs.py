"""Programs that announce nothing are found by what a running network describes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli import rc
from robocomp_py.testing import everything as e
from robocomp_py.tools.programs import described

from ..freeports import free_port
from . import elsewhere

OPERATION = next(each for each in e.EVERYTHING.operations if each.name == "divide")
NEWS = next(each for each in e.EVERYTHING.operations if each.name == "news")


@pytest.fixture
def network(own_runtime_folder: Path) -> Iterator[elsewhere.Network]:
    """With a program on this host, and one on the host `base`."""
    base = own_runtime_folder / "base"
    base.mkdir(mode=0o700)
    with elsewhere.network("base", folder=base, mill="", saw="base") as network:
        describe(network, [served("mill"), served("saw")])
        yield network


def served(instance: str) -> dict[str, Any]:
    return {
        "instance": instance,
        "owner": instance,
        "channel": f"{instance}/Everything/divide",
        "pattern": "query",
        "fingerprint": OPERATION.fingerprint,
        "text": OPERATION.text,
        "supplement": {"idempotent": False, "confirm": False, "bases": {}},
    }


def published(instance: str) -> dict[str, Any]:
    told = {"channel": f"{instance}/Everything/news", "pattern": "publish"}
    return served(instance) | told | {"fingerprint": NEWS.fingerprint, "text": NEWS.text}


def describe(network: elsewhere.Network, serve: object, middleware: str = "zeromq", **options: str) -> None:
    place = network.running.place
    plan = json.loads(place.plan.read_text())
    programs = [{"middleware": middleware, "options": options, "serve": serve}]
    place.leave_plan(json.dumps(plan | {"programs": programs}))


def listed(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, str]:
    """The components that are listed, with their hosts."""
    capsys.readouterr()
    rc.main(["list", "--json", *words, "--middleware", "zeromq"])
    found = map(json.loads, capsys.readouterr().out.splitlines())
    return {each["owner"]: each["host"] for each in found}


@pytest.mark.usefixtures("network")
def test_a_program_is_listed_on_its_host(capsys: pytest.CaptureFixture[str]) -> None:
    assert listed(capsys) == {"mill": "", "saw": "base"}
    assert listed(capsys, "--host", "here") == {"mill": ""}
    assert listed(capsys, "--host", "base") == {"saw": "base"}


def test_a_topic_is_listed_if_its_broker_has_it(network: elsewhere.Network) -> None:
    describe(network, [served("mill"), published("mill")])
    assert [each.told.role for each in described()] == ["serves", "publishes"]
    storm = f"IceStorm/TopicManager:tcp -h 127.0.0.1 -p {free_port()}"  # where none is
    describe(network, [served("mill"), published("mill")], "ice", storm=storm)
    assert [each.told.role for each in described()] == ["serves"]
    assert [each.told.role for each in described(running=False)] == ["serves", "publishes"]


@pytest.mark.parametrize("serve", [None, [{}], [served("mill") | {"supplement": 7}], [served("nowhere")]])
def test_what_is_not_understood_in_a_plan_is_left_out(network: elsewhere.Network, serve: object) -> None:
    describe(network, serve)
    assert described() == []


def test_a_network_that_has_ended_describes_nothing(network: elsewhere.Network) -> None:
    assert described(running=False)
    plan = network.running.place.plan
    text = plan.read_text()
    network.close()
    plan.parent.mkdir(parents=True, exist_ok=True)
    plan.write_text(text)  # as a killed rcdeploy leaves it
    assert described() == described(running=False) == []
