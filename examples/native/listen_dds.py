"""Hears and asks a sonar over DDS."""

import json
import secrets
import struct
from dataclasses import dataclass
from pathlib import Path

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float32, int32, int64, sequence, uint8, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="robocomp::Time"):
    sec: int32
    nanosec: uint32


@dataclass
class Echo(IdlStruct, typename="RoboCompSonar::Echo"):
    distance: float32
    quality: int32
    heard: Time


@dataclass
class PublicationHeader(IdlStruct, typename="robocomp::PublicationHeader"):
    version: uint8
    fingerprint: uint64
    source: uint64
    sequence: uint64
    stamp: int64


@dataclass
class RequestHeader(IdlStruct, typename="robocomp::RequestHeader"):
    version: uint8
    flags: uint8
    remaining_ms: uint32
    fingerprint: uint64
    client: uint64
    sequence: uint64
    stamp: int64


@dataclass
class ReplyHeader(IdlStruct, typename="robocomp::ReplyHeader"):
    version: uint8
    status: uint8
    client: uint64
    sequence: uint64
    server: uint64
    stamp: int64


@dataclass
class Nearest(IdlStruct, typename="RoboCompSonar::SonarPubNearestPublication"):
    header: PublicationHeader
    echo: Echo


@dataclass
class ScanRequest(IdlStruct, typename="RoboCompSonar::SonarScanRequest"):
    header: RequestHeader
    angles: sequence[float32]


@dataclass
class ScanResponse(IdlStruct, typename="RoboCompSonar::SonarScanResponse"):
    header: ReplyHeader
    ret: sequence[Echo]
    error: sequence[uint8]


LIST = json.loads(Path("sonar/generic/dds/channels.json").read_text())
FINGERPRINTS = {each["channel"]: int(each["fingerprint"], 16) for each in LIST["channels"]}
CLIENT = secrets.randbits(64)
QOS = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.History.KeepAll,
    Policy.DataRepresentation(use_cdrv0_representation=True),
)
participant = DomainParticipant(0)


def topic(name, kind):
    return Topic(participant, name, kind)


requests = DataWriter(participant, topic("rc/sonar/Sonar/scanRequest", ScanRequest), QOS)
replies = DataReader(participant, topic("rc/sonar/Sonar/scanReply", ScanResponse), QOS)
number = 0


def ask(angles):
    global number
    for _ in range(10):
        number += 1
        header = RequestHeader(1, 0, 5000, FINGERPRINTS["sonar/Sonar/scan"], CLIENT, number, 0)
        requests.write(ScanRequest(header, angles))
        for reply in replies.take_iter(timeout=duration(seconds=1)):
            if (reply.header.client, reply.header.sequence) == (CLIENT, number):
                return reply
    raise SystemExit("no server answers")


news = DataReader(participant, topic("rc/sonar/SonarPub/nearest", Nearest), QOS)
nearest = next(news.take_iter(timeout=duration(seconds=10)))
print(f"heard {nearest.echo.distance:.1f} m, quality {nearest.echo.quality}")

print(f"scanned {[round(echo.distance, 2) for echo in ask([0.0, 0.5]).ret]}")

refused = ask([2.0])
error = bytes(refused.error)
(length,) = struct.unpack_from("<I", error)
(limit,) = struct.unpack_from("<f", error, 4 + length + -length % 4)
print(f"status {refused.header.status}: {error[4 : 4 + length - 1].decode()}, {limit}")
