"""Topics shared with programs that know Ice and IceStorm only, as the components that RoboComp generates do."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robocomp_py.contract.interface import Operation, Pattern
from robocomp_py.contract.qos import QoS, Reliability
from robocomp_py.runtime.calls import type_of
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Channel, Transport
from tests.codegen.generated import linked
from tests.transports.ice.icestorm import icestorm, open_ice, process_of

pytestmark = pytest.mark.tool

HERE = Path(__file__).parent
READING, SILENCE = (
    operation for port in linked(HERE / "station.cdsl").component.ports for operation in port.interface.operations
)
SENT = ("Mauer", 1, [(1.5, -2.25), (0.0, 1e-9)], b"\0\xff", {"doors": 2}, 2**40 + 1)
AS_JSON = ["Mauer", "good", [[1.5, -2.25], [0.0, 1e-9]], [0, 255], {"doors": 2}, 2**40 + 1]


@pytest.fixture
def storm() -> Iterator[str]:
    with icestorm() as proxy:
        yield proxy


@pytest.fixture
def transport(storm: str) -> Iterator[Transport]:
    with contextlib.closing(open_ice()) as opened:
        yield opened


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what slice2py makes of the interface."""
    folder = tmp_path_factory.mktemp("slice")
    subprocess.run(["slice2py", str(HERE / "Readings.ice")], cwd=folder, check=True, timeout=SOON * 10)
    return folder


@contextlib.contextmanager
def rehearsing(folder: Path, act: str, storm: str, topic: str) -> Iterator[list[Any]]:
    """What the program prints, line by line, while it runs."""
    lines: list[Any] = []

    def read() -> None:
        for line in process.stdout or ():
            if line.endswith("\n"):  # all of it; the last one may be cut off
                lines.append(json.loads(line) if act == "subscribe" else line.strip())

    command = [sys.executable, "-P", str(HERE / "rehearse.py"), act, storm, topic]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as process:
        reader = threading.Thread(target=read)
        reader.start()
        try:
            yield lines
        finally:
            process.kill()
            reader.join()


def channel(name: str, operation: Operation[Any], qos: QoS = QoS()) -> Channel:  # noqa: B008 - frozen
    return Channel(
        f"{name}/{operation.name}", Pattern.PUBLISH, type_of(operation, Pattern.PUBLISH), qos, operation.idempotent
    )


def heard_by(
    transport: Transport,
    name: str,
    operation: Operation[Any] = READING,
    qos: QoS = QoS(),  # noqa: B008 - frozen
) -> tuple[Any, list[Any]]:
    """A subscription, and what came by it."""
    decode, heard = transport.codec.decoder(operation.request), list[Any]()
    return transport.inlet(channel(name, operation, qos), lambda payload: heard.append(decode(payload))), heard


def as_sent(reading: Any) -> tuple[Any, ...]:
    name, quality, trace, raw, counts, heard = reading
    return name, quality, [tuple(each) for each in trace], np.asarray(raw, np.uint8).tobytes(), dict(counts), heard


@pytest.mark.parametrize("reliability", list(Reliability))
def test_what_their_publisher_sends_arrives_value_by_value_and_in_order(
    transport: Transport, storm: str, compiled: Path, reliability: Reliability
) -> None:
    link, heard = heard_by(transport, "*/Readings", qos=QoS(reliability, depth=100))
    _, silences = heard_by(transport, "*/Readings", SILENCE)
    with rehearsing(compiled, "publish", storm, "Readings"):
        assert link.wait_peer(SOON)
        wait_until(lambda: len(heard) >= 5 and silences)
    assert as_sent(heard[0][0]) == SENT
    numbers = [number for _, number in heard]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert (link.stats.malformed, link.stats.lost, link.stats.repeated, link.stats.mismatched) == (0, 0, 0, 0)


def test_a_subscriber_of_one_instance_receives_from_a_robocomp_publisher_too(
    transport: Transport, storm: str, compiled: Path
) -> None:
    _, heard = heard_by(transport, "zed/Readings")
    with rehearsing(compiled, "publish", storm, "Readings"):
        wait_until(lambda: heard)


def test_what_ours_publishes_their_subscriber_hears_value_by_value(
    transport: Transport, storm: str, compiled: Path
) -> None:
    encode = transport.codec.encoder(READING.request)
    with rehearsing(compiled, "subscribe", storm, "Readings") as heard:
        outlet, silence = (transport.outlet(channel("zed/Readings", each)) for each in (READING, SILENCE))
        assert outlet.wait_peer(SOON)
        outlet.send(encode((SENT, 7)))
        silence.send(transport.codec.encoder(SILENCE.request)(()))
        wait_until(lambda: len(heard) == 2)
    assert heard == [[*AS_JSON, 7], "silence"]


def test_a_reliable_publisher_is_as_good_for_them(transport: Transport, storm: str, compiled: Path) -> None:
    outlet = transport.outlet(channel("zed/Readings", READING, QoS(Reliability.RELIABLE, depth=2)))
    encode = transport.codec.encoder(READING.request)
    with rehearsing(compiled, "subscribe", storm, "Readings") as heard:
        assert outlet.wait_peer(SOON)
        for number in range(100):
            outlet.send(encode((SENT, number)))
        wait_until(lambda: len(heard) == 100)
    assert [line[-1] for line in heard] == list(range(100))


def test_topics_have_the_prefixes_that_robocomp_gives_them(storm: str, compiled: Path) -> None:
    with (
        contextlib.closing(open_ice(topics={"zed": "left/Readings", "Readings": "left/Readings"})) as named,
        contextlib.closing(open_ice()) as ours,
        rehearsing(compiled, "subscribe", storm, "left/Readings") as their_left,
        rehearsing(compiled, "subscribe", storm, "robot1/Readings") as their_robot,
    ):
        left, robot = (
            named.outlet(channel("zed/Readings", READING)),
            ours.outlet(channel("robot1/zed/Readings", READING)),
        )
        link, heard = heard_by(named, "*/Readings")
        assert left.wait_peer(SOON)
        assert robot.wait_peer(SOON)
        left.send(named.codec.encoder(READING.request)((SENT, 1)))
        robot.send(ours.codec.encoder(READING.request)((SENT, 2)))
        wait_until(lambda: their_left and their_robot)
        assert ([line[-1] for line in their_left], [line[-1] for line in their_robot]) == ([1], [2])
        with rehearsing(compiled, "publish", storm, "left/Readings"):
            wait_until(lambda: heard)
        assert link.stats.lost == 0


def test_their_publisher_goes_on_after_icestorm_was_started_again_as_we_make_its_topic(
    transport: Transport, storm: str, compiled: Path
) -> None:
    _, heard = heard_by(transport, "*/Readings")
    with rehearsing(compiled, "publish", storm, "Readings"):
        wait_until(lambda: heard)
        os.kill(process_of(storm), signal.SIGKILL)
        before = heard[-1][1]
        wait_until(lambda: heard[-1][1] > before + 5, SOON * 6)


def test_messages_with_unusable_header_keys_are_received_as_foreign(transport: Transport, storm: str) -> None:
    import Ice
    import IceStorm

    link, heard = heard_by(transport, "*/Readings")
    payload = transport.codec.encoder(READING.request)((SENT, 3))
    with Ice.initialize() as communicator:
        manager = IceStorm.TopicManagerPrx.uncheckedCast(communicator.stringToProxy(storm))
        publisher = manager.retrieve("Readings").getPublisher()
        for context in ({"rc": "mine"}, {"rc-channel": "here"}, {"user": "me"}):
            publisher.ice_invoke("reading", Ice.OperationMode.Normal, payload, context)
        publisher.ice_invoke("reading", Ice.OperationMode.Normal, payload, {"rc": "00ff", "rc-channel": "a/b/c"})
        publisher.ice_invoke("other", Ice.OperationMode.Normal, payload)
        wait_until(lambda: len(heard) == 3 and link.stats.malformed == 1)
