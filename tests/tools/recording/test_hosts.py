"""Topics of other hosts, which only scouts see, are recorded and shown."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from robocomp_py import connect
from robocomp_py.cli import rc
from robocomp_py.cli.common import FINE, UNREACHABLE
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.recording.reader import Recording, values_by_topic
from robocomp_py.transports.base import find_transport
from robocomp_py.wire.cdr import Cdr

from ...runtime.running import make, running
from .. import elsewhere
from ..foxglove.test_live import connected, served
from ..talkers import Talker

CHANNEL = "talker/Everything/news"


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


@contextmanager
def recorder(folder: Path, *arguments: str) -> Iterator[tuple[Callable[[], str], dict[str, Any]]]:
    """`rc record`, which ends with the block: the next line that it says, and in the end what it tells."""
    command = [
        sys.executable,
        "-m",
        "robocomp_py.cli.rc",
        "record",
        "-o",
        str(folder),
        "--json",
        "--middleware",
        "shm",
        "--timeout",
        "60",
        *arguments,
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    told: dict[str, Any] = {}
    try:
        assert process.stderr
        yield process.stderr.readline, told
    finally:
        process.terminate()
        out, _ = process.communicate(timeout=3 * SOON)
    told |= json.loads(out)


def read(folder: Path) -> dict[str, list[tuple[int, int, int, tuple[Any, ...]]]]:
    """By topic: when each message came, when it was sent, its number and its values."""
    found: dict[str, list[tuple[int, int, int, tuple[Any, ...]]]] = {}
    with Recording(folder) as recording:
        values = values_by_topic()
        for each in recording.messages():
            told = each.log_time, each.publish_time, each.sequence, values(each)
            found.setdefault(each.topic.name, []).append(told)
    return found


@pytest.mark.usefixtures("network")
def test_topics_of_two_hosts_are_in_one_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with running(make(Talker, find_transport, "middleware=shm", name="here")):
        for number, seconds in enumerate(("1", "4", "16")):  # on a busy machine, nothing may come in a short time
            run = tmp_path / f"run{number}"
            words = ["record", "news", "--for", seconds, "--middleware", "shm", "--timeout", "60", "-o", str(run)]
            assert rc.main([*words, "--json"]) == FINE
            said = capsys.readouterr()
            told = json.loads(said.out)
            if all(each["messages"] for each in told["topics"]):
                break
    assert f"{CHANNEL} over shm of base" in said.err
    assert {(each["channel"], each["host"]) for each in told["topics"]} == {
        ("here/Everything/news", ""),
        (CHANNEL, "base"),
    }
    (host,) = told["hosts"]
    messages = read(run)
    numbers = [number for _, _, number, _ in messages[CHANNEL]]
    missing = numbers[-1] + 1 - numbers[0] - len(numbers)  # none, unless the machine is very busy
    assert host.pop("lost") + host.pop("dropped") >= missing
    assert host == {"host": "base", "messages": len(numbers), "unreachable": ""}
    assert messages["here/Everything/news"]
    for came, sent, number, (counted, text) in messages[CHANNEL]:
        assert 0 <= came - sent < 60e9
        first = messages[CHANNEL][0]
        assert (number - first[2], text[:1]) == (counted - first[3][0], "h")
    with Recording(run) as recording:
        assert recording.topics[CHANNEL].publisher == "talker"


@pytest.mark.usefixtures("network")
def test_publishers_of_one_name_on_two_hosts_are_recorded(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with recorder(folder, "news") as (says, told):
        wait_until(lambda: f"{CHANNEL} over shm of base" in says())
        with running(make(Talker, find_transport, "middleware=shm", name="talker")) as here:
            here.texts = ("here",)
            wait_until(lambda: says().endswith(f"{CHANNEL} over shm\n"))
            wait_until(lambda: b"here" in (folder / "run_0.mcap").read_bytes())
    assert {(each["channel"], each["host"]) for each in told["topics"]} == {(CHANNEL, ""), (CHANNEL, "base")}
    assert all(each["messages"] for each in told["topics"])
    messages = read(folder)[CHANNEL]
    assert len(messages) == sum(each["messages"] for each in told["topics"])
    assert {text[:1] for *_, (_, text) in messages} == {"h"}
    assert "here" in {text for *_, (_, text) in messages}


def test_a_host_that_was_lost_is_recorded_again(network: elsewhere.Network, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with recorder(folder, "news") as (says, told):
        file = folder / "run_0.mcap"
        wait_until(lambda: file.exists() and file.stat().st_size > 1500)
        scouts = dict(network.standing.scouts)
        network.standing.scouts.clear()
        network.cut()
        wait_until(lambda: "warning: base is out of reach: its cable was cut" in says())
        network.standing.scouts |= scouts
        size = file.stat().st_size
        wait_until(lambda: file.stat().st_size > size + 1500)
    (host,) = told["hosts"]
    assert host["unreachable"] == "base is out of reach: its cable was cut"
    numbers = [number for _, _, number, _ in read(folder)[CHANNEL]]
    assert host["lost"] == numbers[-1] - numbers[0] + 1 - len(numbers) > 0


@pytest.mark.usefixtures("network")
def test_calls_of_another_host_are_recorded(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with recorder(folder, "divide", "--calls", "--served") as (says, told), connect("home", middleware="shm") as net:
        wait_until(lambda: "calls of talker over shm of base" in says())
        size = (folder / "run_0.mcap").stat().st_size
        divide: Any = net["talker/Everything/divide"]
        wait_until(lambda: divide(17, 5).ret == 3 and (folder / "run_0.mcap").stat().st_size > size + 1000)
    (teller,) = told["tellers"]
    assert (teller["component"], teller["host"]) == ("talker", "base")
    assert read(folder)["talker/Everything/divide/calls"]


@pytest.mark.usefixtures("network")
def test_calls_of_one_name_on_two_hosts_are_recorded(tmp_path: Path) -> None:
    folder = tmp_path / "run"

    def call(host: str) -> None:
        """Returns once the recording has it."""
        file = folder / "run_0.mcap"
        size = file.stat().st_size
        words = ["call", "talker/Everything/divide", "dividend=9", "divisor=4", "--middleware", "shm", "--host", host]
        assert rc.main(words) == FINE
        wait_until(lambda: file.stat().st_size > size + 50)

    with (
        running(make(Talker, find_transport, "middleware=shm", name="talker")),
        recorder(folder, "divide", "--calls", "--served") as (says, told),
    ):
        waited = {"rc record: calls of talker over shm\n", "rc record: calls of talker over shm of base\n"}
        wait_until(lambda: waited.discard(says()) or not waited)
        call("base")
        call("here")
    assert {(each["component"], each["host"], each["told"]) for each in told["tellers"]} == {
        ("talker", "", 1),
        ("talker", "base", 1),
    }


def test_a_topic_that_may_be_on_a_lost_host_is_told_so(
    network: elsewhere.Network, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    network.standing.scouts.clear()
    assert (
        rc.main(["record", "news", "--middleware", "shm", "--timeout", "0.1", "-o", str(tmp_path / "run")])
        == UNREACHABLE
    )
    assert "it may be on base" in capsys.readouterr().err


@pytest.mark.usefixtures("network")
def test_publishers_of_one_name_on_two_hosts_are_one_topic_of_foxglove() -> None:
    def texts() -> set[str]:
        client.take()
        return {Cdr().decoder(e.news.request)(data)[1] for _, _, data in client.heard}

    with running(make(Talker, find_transport, "middleware=shm", name="talker")) as here:
        here.texts = ("here",)
        with served("--network", "home", "--middleware", "shm") as address, connected(address) as client:
            client.hear(f"/{CHANNEL}")
            wait_until(lambda: texts() >= {"here", "hello"})
