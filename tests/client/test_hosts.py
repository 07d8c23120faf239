"""`connect`: components of other hosts, which only scouts see."""

from __future__ import annotations

import contextlib
import logging
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from robocomp_py import connect
from robocomp_py.client.session import NotThere
from robocomp_py.errors import DeclaredError, HostUnreachable
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.census import take_census
from robocomp_py.transports.base import find_transport

from ..runtime.running import make, running
from ..tools import elsewhere
from ..tools.talkers import Talker


@pytest.fixture(scope="module")
def base() -> Iterator[Path]:
    """The run-time folder of a host with two components."""
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as folder:
        there = Path(folder, "base")
        with elsewhere.apart(there, "tests.tools.there"):
            yield there


@pytest.fixture
def network(own_runtime_folder: Path, base: Path) -> Iterator[elsewhere.Network]:
    with elsewhere.network("base", folder=base, talker="base", listener="base") as made:
        yield made


@pytest.fixture
def net(network: elsewhere.Network) -> Iterator[Any]:
    with connect("home", middleware="shm") as made:
        yield made


def test_queries_and_commands_of_another_host_are_called(net: Any) -> None:
    assert dir(net.talker.Everything).count("divide") == 1
    assert tuple(net.talker.Everything.divide(17, divisor=5)) == (3, 2)
    echo = net.talker.Everything.echo_nested
    sent = echo.types["Nested"](points=[echo.types["Point"](1.0, 2.0)], by_name={"a": echo.types["Point"](x=3.0)})
    assert echo(sent) == sent
    with pytest.raises(DeclaredError, match="division by zero"):
        net.talker.Everything.divide(1, 0)


def test_topics_of_another_host_are_heard(net: Any) -> None:
    topic = net.talker.Everything
    first, second = (message.number for message, _ in zip(topic, range(2), strict=False))
    assert second == first + 1
    topic.poke(1_000_000)  # more than a line to a scout has
    wait_until(lambda: len(topic.latest(newer_than=0).text) == 1_000_000)
    topic.poke(1)
    wait_until(lambda: topic.latest(newer_than=0).text == "x")


def test_messages_are_published_on_another_host(net: Any) -> None:
    net["phantom/Everything/news"].publish(-1, "boo")
    wait_until(lambda: "boo" in net.talker.Everything.work("heard"))


def test_a_lost_host_is_told(net: Any, network: elsewhere.Network, caplog: pytest.LogCaptureFixture) -> None:
    topic = net.talker.Everything.news
    assert topic.latest().number > 0
    messages = topic.listen()
    scouts = dict(network.standing.scouts)
    network.cut()
    network.standing.scouts.clear()
    why = "base is out of reach: its cable was cut"
    with pytest.raises(HostUnreachable, match=why):
        list(messages)
    with pytest.raises(HostUnreachable, match=why):
        net.talker.Everything.divide(17, 5)
    with caplog.at_level(logging.WARNING), pytest.raises(NotThere, match=f"{why}, and it may be there"):
        _ = net.speaker
    assert why in caplog.text
    assert repr(net) == f"home:\n  base  {why}"
    with pytest.raises(NotThere, match=f"none of its components is ready over shm: rcdeploy status home; {why}"):
        connect("home", middleware="shm", timeout=0.1)
    network.standing.scouts |= scouts
    assert tuple(net.talker.Everything.divide(17, 5)) == (3, 2)
    assert topic.latest(newer_than=0).number > 0


def test_publishers_of_one_name_are_heard_on_all_hosts(
    network: elsewhere.Network, caplog: pytest.LogCaptureFixture
) -> None:
    why = "talker/Everything/news: base is out of reach: its cable was cut; the others are heard"
    with contextlib.ExitStack() as end:
        here = end.enter_context(running(make(Talker, find_transport, "middleware=shm", name="talker")))
        here.texts = ("here",)
        wait_until(lambda: "talker/Everything/news" in take_census(["shm"]).channels)
        topic: Any = end.enter_context(connect("home", middleware="shm"))["talker/Everything/news"]
        messages = topic.listen(timeout=SOON)
        heard = {"here", topic.latest().text}
        wait_until(lambda: heard.add(next(messages).text) or len(heard) == 2)
        scouts = dict(network.standing.scouts)
        network.standing.scouts.clear()
        network.cut()
        here.texts = ("still here",)
        with caplog.at_level(logging.WARNING):
            wait_until(lambda: next(messages).text == "still here" and why in caplog.text)
        assert topic.latest(newer_than=0).text == "still here"
        network.standing.scouts |= scouts
        wait_until(lambda: not next(messages).text.endswith("here"))
        assert caplog.text.count(why) == 1
        network.standing.scouts.clear()
        network.cut()
        with caplog.at_level(logging.WARNING):
            wait_until(lambda: bool(next(messages)) and caplog.text.count(why) == 2)


def test_a_host_that_was_out_of_reach_from_the_beginning_is_heard_once_it_is_there(network: elsewhere.Network) -> None:
    scouts = dict(network.standing.scouts)
    network.standing.scouts.clear()
    with contextlib.ExitStack() as end:
        here = end.enter_context(running(make(Talker, find_transport, "middleware=shm", name="talker")))
        here.texts = ("here",)
        wait_until(lambda: "talker/Everything/news" in take_census(["shm"]).channels)
        topic: Any = end.enter_context(connect("home", middleware="shm"))["talker/Everything/news"]
        messages = topic.listen(timeout=SOON)
        assert next(messages).text == "here"
        network.standing.scouts |= scouts
        wait_until(lambda: next(messages).text != "here")
        assert topic.latest(newer_than=0).number > 0


SCRIPT = """
from robocomp_py import connect
net = connect("home", middleware="shm")
print(net.talker.Everything.divide(17, 5).remainder, net.talker.Everything.latest().text[:1])
"""


@pytest.mark.usefixtures("network")
def test_a_script_that_does_not_close_ends_its_scouts() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=SOON * 3, cwd="/")
    assert (done.stdout[:2], done.stderr, done.returncode) == ("2 ", "", 0)


def test_a_network_that_starts_later_has_its_hosts(own_runtime_folder: Path, base: Path) -> None:
    with ThreadPoolExecutor(1) as pool:
        connecting = pool.submit(connect, "home", middleware="shm", timeout=SOON)
        with elsewhere.network("base", folder=base, talker="base"), connecting.result() as net:
            assert tuple(net["talker/Everything"].divide(17, 5)) == (3, 2)
