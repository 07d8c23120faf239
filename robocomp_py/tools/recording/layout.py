"""What is written into a recording. Pure.

A folder holds `NAME_0.mcap`, `NAME_1.mcap` … and `metadata.yaml`, by which it is a ROS 2 bag. Each topic is a channel
of MCAP, called `/world/LaserPub/pushLaserData`. Its messages are CDR, its schema is one of `wire.schema`. Its metadata:

    fingerprint            of the contract, 16 hexadecimal digits
    definition             the contract, as processes announce it: enough to decode and to publish again
    publisher              the components that publish it, separated by commas
    middleware             over which it was heard
    pattern                `publish`; `command` in a recording of commands
    host                   of its publisher, if that is another one than the host that records
    offered_qos_profiles   QoS of the publisher, in the words of rosbag2
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from ...contract.interface import Operation, Pattern
from ...contract.qos import DEFAULT_QOS, Durability, History, Liveliness, QoS, Reliability
from ...wire.schema import ENCODINGS, Schema

PROFILE = "ros2"
"""What readers may expect of a file: topics, types and metadata as rosbag2 writes them."""

ENCODING = "cdr"


@dataclass(frozen=True)
class Topic:
    """A topic that is recorded."""

    name: str
    """As channels are called: `world/LaserPub/pushLaserData`."""
    operation: Operation[Any]
    publisher: str = ""
    middleware: str = ""
    qos: QoS = DEFAULT_QOS
    pattern: Pattern = Pattern.PUBLISH
    host: str = ""
    """Of its publisher, by its name in the network; "" for the host that records."""

    @property
    def in_file(self) -> str:
        return f"/{self.name}"

    def schema(self, encoding: str) -> Schema:
        return ENCODINGS[encoding](self.operation)

    @property
    def metadata(self) -> dict[str, str]:
        return {
            "fingerprint": f"{self.operation.fingerprint:016x}",
            "definition": self.operation.text,
            "publisher": self.publisher,
            "middleware": self.middleware,
            "pattern": str(self.pattern),
            "offered_qos_profiles": json.dumps([qos_profile(self.qos)]),
        } | ({"host": self.host} if self.host else {})


_FOREVER = {"sec": 9223372036, "nsec": 854775807}


def qos_profile(qos: QoS) -> dict[str, Any]:
    """In the numbers of rosbag2."""
    return {
        "history": 2 if qos.history is History.KEEP_ALL else 1,
        "depth": qos.depth,
        "reliability": 1 if qos.reliable else 2,
        "durability": 1 if qos.latched else 2,
        "deadline": _duration(qos.deadline),
        "lifespan": _duration(qos.lifespan),
        "liveliness": 3 if qos.liveliness is Liveliness.MANUAL_BY_TOPIC else 1,
        "liveliness_lease_duration": _duration(qos.lease),
        "avoid_ros_namespace_conventions": False,
    }


def qos_of(metadata: Mapping[str, str]) -> QoS:
    """The QoS of a channel of a recording; the default if it has none that is understood."""
    try:
        (found, *_) = json.loads(metadata["offered_qos_profiles"])
        return QoS(
            Reliability.RELIABLE if found["reliability"] == 1 else Reliability.BEST_EFFORT,
            Durability.TRANSIENT_LOCAL if found["durability"] == 1 else Durability.VOLATILE,
            History.KEEP_ALL if found["history"] == 2 else History.KEEP_LAST,
            max(1, int(found["depth"])),
            _seconds(found["deadline"]),
            _seconds(found["lifespan"]),
            Liveliness.MANUAL_BY_TOPIC if found["liveliness"] == 3 else Liveliness.AUTOMATIC,
            _seconds(found["liveliness_lease_duration"]),
        )
    except (KeyError, ValueError, TypeError, RecursionError):
        return DEFAULT_QOS


def _duration(seconds: float | None) -> dict[str, int]:
    if seconds is None:
        return _FOREVER
    whole, rest = divmod(round(seconds * 1e9), 10**9)
    return {"sec": whole, "nsec": rest}


def _seconds(duration: Mapping[str, int]) -> float | None:
    found = duration["sec"] + duration["nsec"] / 1e9
    return found if found < _FOREVER["sec"] else None


class Span(NamedTuple):
    """What a file holds: times in nanoseconds since 1970, both 0 if it is empty."""

    file: str
    start: int
    end: int
    counts: Mapping[str, int]
    """Messages by topic, as called in the file."""

    @property
    def messages(self) -> int:
        return sum(self.counts.values())


class Described(NamedTuple):
    """A channel in a file."""

    name: str
    type: str
    qos_profiles: str


def bag_metadata(files: Iterable[Span], topics: Iterable[Described]) -> str:
    """The text of `metadata.yaml`. It is JSON, which YAML includes."""
    spans = list(files)
    filled = [each for each in spans if each.messages]
    start, end = min((each.start for each in filled), default=0), max((each.end for each in filled), default=0)
    information = {
        "version": 5,
        "storage_identifier": "mcap",
        "relative_file_paths": [each.file for each in spans],
        "starting_time": {"nanoseconds_since_epoch": start},
        "duration": {"nanoseconds": end - start},
        "message_count": sum(each.messages for each in spans),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": each.name,
                    "type": each.type,
                    "serialization_format": ENCODING,
                    "offered_qos_profiles": each.qos_profiles,
                },
                "message_count": sum(span.counts.get(each.name, 0) for span in spans),
            }
            for each in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "files": [
            {
                "path": each.file,
                "starting_time": {"nanoseconds_since_epoch": each.start},
                "duration": {"nanoseconds": each.end - each.start},
                "message_count": each.messages,
            }
            for each in spans
        ],
    }
    return json.dumps({"rosbag2_bagfile_information": information}, indent=2) + "\n"
