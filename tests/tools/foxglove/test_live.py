"""`rc foxglove` serves what runs, and recordings, to a client that speaks Foxglove's protocol."""

from __future__ import annotations

import json
import re
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from foxglove import messages as fox
from mcap.reader import make_reader
from websockets.sync.client import ClientConnection, connect

from robocomp_py.cli import rc
from robocomp_py.contract.interface import Operation
from robocomp_py.contract.types import FLOAT32, Field, Sequence, Struct
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.census import take_census
from robocomp_py.tools.recording.bag import BagWriter, Options
from robocomp_py.tools.recording.layout import Topic
from robocomp_py.transports.base import find_transport
from robocomp_py.wire.cdr import Cdr

from ...leftovers import killed_on_failure
from ...runtime.running import make, running
from ..talkers import Talker
from ..terse import INTERFACE, terse

SCAN = Operation[Any](
    "RoboCompLaserPub::LaserPub",
    "pushLaserData",
    (Field("laserData", Sequence(Struct("RoboCompLaser::TData", (Field("angle", FLOAT32), Field("dist", FLOAT32))))),),
)


@contextmanager
def served(*arguments: str) -> Iterator[str]:
    """The address at which a command serves."""
    command = [sys.executable, "-m", "robocomp_py.cli.rc", "foxglove", "--port", "0", *arguments]
    with killed_on_failure(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            found = re.search(r"ws://127\.0\.0\.1:\d+", process.stdout.readline())
            assert found
            yield found[0]
        finally:
            process.terminate()
            process.communicate(timeout=SOON * 3)
    assert process.returncode == 143


class Client:
    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        self.channels: dict[str, dict[str, Any]] = {}
        self.heard: list[tuple[int, int, bytes]] = []

    def take(self) -> None:
        """Take the next message."""
        received = self._connection.recv(timeout=SOON)
        if isinstance(received, bytes):
            operation, subscription, stamp = struct.unpack_from("<BIQ", received)
            if operation == 1:
                self.heard.append((subscription, stamp, received[13:]))
            return
        for channel in json.loads(received).get("channels", ()):
            self.channels[channel["topic"]] = channel

    def hear(self, topic: str) -> tuple[int, bytes]:
        """The time and the data of the next message of a topic."""
        while topic not in self.channels:
            self.take()
        number = self.channels[topic]["id"]
        wanted = {"op": "subscribe", "subscriptions": [{"id": number, "channelId": number}]}
        self._connection.send(json.dumps(wanted))
        while True:
            for subscription, stamp, data in self.heard:
                if subscription == number:
                    return stamp, data
            self.take()


@contextmanager
def connected(address: str) -> Iterator[Client]:
    with connect(address, subprotocols=["foxglove.sdk.v1"]) as connection:  # type: ignore[list-item]  # a NewType
        yield Client(connection)


def test_topics_that_run_are_shown(own_runtime_folder: Path) -> None:
    with running(make(Talker, find_transport, "middleware=shm", name="talker")):
        wait_until(lambda: "talker/Everything/news" in take_census(["shm"]).channels)
        with served() as address, connected(address) as client:
            stamp, data = client.hear("/talker/Everything/news")
            channel = client.channels["/talker/Everything/news"]
    assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
    assert channel["schemaName"] == "conformance/msg/EverythingNews"
    assert "int32 number\nstring text" in channel["schema"]
    operation = next(each for each in e.EVERYTHING.operations if each.name == "news")
    number, text = Cdr().decoder(operation.request)(data)
    assert number > 0
    assert text == "hello"
    assert stamp > 1_600_000_000_000_000_000


def test_a_topic_whose_contract_is_in_an_idsl_file_is_shown(own_runtime_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "Everything.idsl").write_text(INTERFACE)
    with terse(), served("-I", str(tmp_path), "--middleware", "shm") as address, connected(address) as client:
        while "/terse/Everything/news" not in client.channels:
            client.take()
        assert "int32 number\nstring text" in client.channels["/terse/Everything/news"]["schema"]


def recorded(folder: Path, count: int, name: str = "world/LaserPub/pushLaserData") -> Path:
    """A recording of scans, ten a second; the number of each, in mm, is in its left distance."""
    writer = BagWriter(folder, Options())
    number = writer.add(Topic(name, SCAN, "world"))
    encode = Cdr().encoder(SCAN.request)
    for at in range(count):
        writer.write(number, bytes(encode(([(-0.5, 1000.0 + at), (0.5, 2000.0)],))), at * 10**8, at * 10**8 + 1, at)
    writer.close()
    return folder


def drawn(stamp: int) -> bytes:
    """One of these scans as Foxglove gets it."""
    here = fox.Pose(position=fox.Vector3(x=0.0, y=0.0, z=0.0), orientation=fox.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0))
    return fox.LaserScan(
        timestamp=fox.Timestamp(stamp // 10**9, stamp % 10**9),
        frame_id="world",
        pose=here,
        start_angle=-0.5,
        end_angle=0.5,
        ranges=[2.0, (1000 + stamp // 10**8) * 0.001],
        intensities=[],
    ).encode()


def test_a_recording_is_converted(tmp_path: Path) -> None:
    run = recorded(tmp_path / "run", 5)
    assert rc.main(["bag", "convert", str(run), "--to", "foxglove", "-o", str(tmp_path / "drawn")]) == 0
    with open(tmp_path / "drawn" / "drawn_0.mcap", "rb") as file:
        found = list(make_reader(file).iter_messages())
    shown = [(channel, schema, message) for schema, channel, message in found if channel.topic.endswith("/LaserScan")]
    assert len(found) == 10
    assert [message.data for _, _, message in shown] == [drawn(at * 10**8 + 1) for at in range(5)]
    channel, schema, _ = shown[0]
    assert (channel.topic, channel.message_encoding) == ("/world/LaserPub/pushLaserData/LaserScan", "protobuf")
    assert (schema.name, schema.encoding) == ("foxglove.LaserScan", "protobuf")


def test_a_recording_is_shown_with_its_times(tmp_path: Path) -> None:
    run = recorded(tmp_path / "run", 300)
    with served(str(run), "LaserPub") as address, connected(address) as client:
        stamp, data = client.hear("/world/LaserPub/pushLaserData/LaserScan")
        channel = client.channels["/world/LaserPub/pushLaserData/LaserScan"]
        _, plain = client.hear("/world/LaserPub/pushLaserData")
    assert (channel["schemaName"], channel["encoding"]) == ("foxglove.LaserScan", "protobuf")
    assert stamp % 10**8 == 1
    assert data == drawn(stamp)
    ((first, _),) = Cdr().decoder(SCAN.request)(plain)
    assert first[0] == -0.5


def test_topics_of_a_recording_may_have_other_names_than_those_of_components(tmp_path: Path) -> None:
    """As log records have, and topics that other programs have recorded."""
    run = recorded(tmp_path / "run", 300, "world")
    assert rc.main(["bag", "convert", str(run), "--to", "foxglove", "-o", str(tmp_path / "drawn")]) == 0
    with served(str(run)) as address, connected(address) as client:
        stamp, data = client.hear("/world/LaserScan")
    assert data == drawn(stamp)


@pytest.mark.parametrize(
    ("arguments", "code", "why"),
    [
        (("--recording", "nowhere.mcap"), 1, "nowhere.mcap: no such file or folder"),
        (("nowhere.mcap",), 1, "nowhere.mcap: no such file or folder"),
        (("a.mcap", "b.mcap"), 2, "one recording at a time is shown"),
        (("a.mcap", "--network", "rescue"), 2, "--network is for what runs, and a recording does not"),
        (("--network", "nowhere"), 1, "network `nowhere` is not running on this machine"),
        (("--port", "70000"), 2, "`70000` is not a port; write a number from 0 to 65535"),
    ],
)
def test_what_is_wrong_is_told(
    arguments: tuple[str, ...], code: int, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        ended = rc.main(["foxglove", *(() if "--port" in arguments else ("--port", "0")), *arguments])
    except SystemExit as exc:
        ended = int(str(exc.code))
    assert ended == code
    assert why in capsys.readouterr().err


def test_a_port_that_is_taken_is_told(own_runtime_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with served() as address:
        port = address.rpartition(":")[2]
        assert rc.main(["foxglove", "--port", port, "--for", "1"]) == 1
        assert f"port {port} of 127.0.0.1 cannot be served" in capsys.readouterr().err
