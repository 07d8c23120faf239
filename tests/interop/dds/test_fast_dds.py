"""A program of another vendor's DDS hears a topic of ours, and is heard; its types come from the IDL of `rcgen`."""

from __future__ import annotations

import contextlib
import json
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robocomp_py.codegen.native import native
from robocomp_py.contract.interface import Operation, Pattern
from robocomp_py.contract.qos import QoS, Reliability
from robocomp_py.runtime.calls import type_of
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Channel, TransportConfig
from robocomp_py.transports.dds.transport import DDSTransport
from tests.codegen.generated import linked
from tests.transports.dds.domains import DOMAIN

pytestmark = pytest.mark.tool

HERE = Path(__file__).parent
STATION = linked(HERE / "station.cdsl").component
READING, ANSWER = (operation for port in STATION.ports for operation in port.interface.operations)

WALL = ("wall", 1, (1.5, 2.25), [(0.5, -1.0), (0.25, 1e-9)], ["a", "", "Häuser"], 1_700_000_000_123_456_789)
NOTHING = ("", 0, (0.0, 0.0), [], [], 0)


def reading(raw: bytes) -> tuple[Any, ...]:
    counts = {"doors": 2, "windows": -1}
    return (True, 200, -3, 2**40 + 1, WALL, [WALL, NOTHING, WALL], counts, raw, [0.1, 1e100])


@pytest.fixture(scope="module")
def relay(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program, built against the types of the station."""
    folder = tmp_path_factory.mktemp("relay")
    for path, text in native(STATION, "dds", "Generated for a test.").items():
        if path.endswith(".idl"):
            (folder / Path(path).name).write_text(text, encoding="utf-8")
    run(folder, "fastddsgen", "-cs", *(path.name for path in sorted(folder.glob("*.idl"))))
    sources = [HERE / "relay.cpp", *sorted(folder.glob("*.cxx"))]
    run(folder, "g++", "-std=c++17", "-I.", "-o", "relay", *map(str, sources), "-lfastrtps", "-lfastcdr")
    return folder / "relay"


def run(folder: Path, *call: str) -> None:
    done = subprocess.run(call, cwd=folder, capture_output=True, text=True, timeout=SOON * 60)
    assert done.returncode == 0, done.stdout + done.stderr


@contextlib.contextmanager
def running(program: Path, *arguments: str) -> Iterator[list[Any]]:
    """What it prints, line by line, while it runs."""
    lines: list[Any] = []

    def read() -> None:
        for line in process.stdout or ():
            if line.endswith("\n"):  # all of it; the last one may be cut off
                lines.append(json.loads(line))

    with subprocess.Popen([program, *arguments], stdout=subprocess.PIPE, text=True) as process:
        reader = threading.Thread(target=read)
        reader.start()
        try:
            yield lines
        finally:
            process.kill()
            reader.join()


@pytest.mark.parametrize(
    ("octets", "instance"),
    [(3, "*"), (200_000, "relay")],
    ids=["in one packet, by any name", "in fragments, by its name"],
)
def test_fast_dds_hears_our_topic_and_is_heard_value_by_value(
    relay: Path, octets: int, instance: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)  # a tag that Fast DDS does not know
    sent = reading(bytes(range(256)) * (octets // 256) + bytes(octets % 256))
    answers: list[Any] = []
    with (
        contextlib.closing(DDSTransport(TransportConfig({"domain": DOMAIN}, "station"))) as transport,
        running(relay, str(DOMAIN), f"{ANSWER.fingerprint:016x}") as heard,
    ):
        encode, decode = transport.codec.encoder(READING.request), transport.codec.decoder(ANSWER.request)
        outlet = transport.outlet(topic("station/Readings/reading", READING))
        link = transport.inlet(
            topic(f"{instance}/Answers/answer", ANSWER), lambda payload: answers.append(decode(payload))
        )
        assert outlet.wait_peer(SOON)
        assert link.wait_peer(SOON)

        def answered() -> bool:
            """It may have found us later than we it."""
            outlet.send(encode((sent, 1)), SOON)
            return bool(answers)

        wait_until(answered)
        outlet.send(encode((sent, 7)), SOON)
        wait_until(lambda: answers[-1][1] == 8)
        wait_until(lambda: heard and heard[-1][0] == 7)

    _, sequence, values = heard[-1]
    assert sequence == heard[-2][1] + 1
    assert values == as_json(sent)
    assert [as_json(each) for each, _ in answers] == [as_json(sent)] * len(answers)
    assert (link.stats.malformed, link.stats.lost, link.stats.repeated) == (0, 0, 0)


def topic(name: str, operation: Operation[Any]) -> Channel:
    return Channel(name, Pattern.PUBLISH, type_of(operation, Pattern.PUBLISH), QoS(Reliability.RELIABLE, depth=10))


def as_json(values: tuple[Any, ...]) -> list[Any]:
    """A reading as the program prints it."""
    on, small, medium, big, nearest, echoes, counts, raw, weights = values
    return [
        on, small, medium, big, _echo(nearest), [_echo(each) for each in echoes],
        [[key, value] for key, value in counts.items()], np.frombuffer(raw, np.uint8).tolist(), list(weights),
    ]  # fmt: skip


def _echo(echo: tuple[Any, ...]) -> list[Any]:
    name, quality, where, trace, labels, heard = echo
    return [name, quality, list(where), [list(each) for each in trace], labels, list(divmod(heard, 10**9))]
