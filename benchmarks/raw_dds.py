"""Bare Cyclone DDS, through its Python package: our domain settings and QoS, a type with its own codec.

The package's codec takes milliseconds for a large array (see `layers`), so the type here turns its
array into bytes, and back, by itself. A thread of its own waits for each reader, as the package proposes.
"""

import threading  # no postponed annotations here: the package evaluates those of its types
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from cyclonedds.core import InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import sequence, uint8
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from robocomp_py.transports.dds.domain import compose, settings

from .parties import PATIENCE, Array, Hear, Place

_SLICE = duration(milliseconds=200)
"""The far end looks this often whether it is to stop."""

if TYPE_CHECKING:
    Data = Any
else:
    Data = sequence[uint8]  # the package's annotations are no types

_ENCAPSULATION = b"\0\1\0\0"
_ANY = SampleState.Any | ViewState.Any | InstanceState.Any
_QOS = Qos(
    Policy.Reliability.Reliable(duration(seconds=PATIENCE)),
    Policy.History.KeepAll,
    Policy.DestinationOrder.ByReceptionTimestamp,
    Policy.DataRepresentation(use_cdrv0_representation=True),
)


def encode(data: Array) -> bytes:
    return b"".join((_ENCAPSULATION, data.size.to_bytes(4, "little"), data.data))


def decode(sample: bytes) -> Array:
    return np.frombuffer(sample, np.uint8, int.from_bytes(sample[4:8], "little"), 8)


@dataclass
class Octets(IdlStruct, typename="benchmarks::Octets"):
    """As a user of the package would write it."""

    data: Data


@dataclass
class Sample(IdlStruct, typename="benchmarks::Octets"):
    """The same, coded by hand; `data` is an array."""

    data: Data

    def serialize(self, buffer: Any = None, endianness: Any = None, use_version_2: Any = None) -> bytes:
        return encode(self.data)

    @classmethod
    def deserialize(cls, data: bytes, has_header: bool = True, use_version_2: Any = None) -> "Sample":
        return cls(decode(data))


class _Bus:
    """A domain of this process, and what is in it."""

    def __init__(self, place: Place) -> None:
        domain = place.domain + 1
        self._domain = Domain(domain, compose(settings("lo"), "", domain))
        self.participant = DomainParticipant(domain)

    def writer(self, name: str) -> DataWriter[Sample]:
        return DataWriter(self.participant, Topic(self.participant, name, Sample), _QOS)

    def reader(self, name: str) -> tuple[DataReader[Sample], WaitSet]:
        reader = DataReader(self.participant, Topic(self.participant, name, Sample), _QOS)
        waiting = WaitSet(self.participant)
        waiting.attach(ReadCondition(reader, _ANY))
        return reader, waiting

    def close(self) -> None:
        self.participant.__del__()  # the package has no other way to delete something now
        self._domain.__del__()


class Far:
    def __init__(self, place: Place, hear: Hear) -> None:
        self._hear = hear
        self._stopped = threading.Event()
        self._bus = _Bus(place)
        self._replies = self._bus.writer("Reply")
        self._threads = [
            threading.Thread(target=self._repeat, args=(*self._bus.reader(name), take), name=name)
            for name, take in (("Request", self._answer), ("Topic", self._heard))
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        self._stopped.set()
        for thread in self._threads:
            thread.join()
        self._bus.close()

    def _repeat(self, reader: DataReader[Sample], waiting: WaitSet, take: Callable[[Sample], object]) -> None:
        while not self._stopped.is_set():
            if waiting.wait(_SLICE):
                for sample in reader.take(32):
                    if isinstance(sample, Sample):  # else it says that a writer has gone
                        take(sample)

    def _answer(self, sample: Sample) -> None:
        self._replies.write(Sample(sample.data))

    def _heard(self, sample: Sample) -> None:
        self._hear(sample.data)


class Near:
    def __init__(self, place: Place) -> None:
        self._bus = _Bus(place)
        self._replies, self._waiting = self._bus.reader("Reply")
        self._requests, self._topic = self._bus.writer("Request"), self._bus.writer("Topic")
        end = time.monotonic() + PATIENCE
        while not (
            self._requests.get_matched_subscriptions()
            and self._topic.get_matched_subscriptions()
            and self._replies.get_matched_publications()
        ):
            if time.monotonic() > end:
                raise TimeoutError(f"dds: the two ends did not find each other within {PATIENCE:g} s")
            time.sleep(0.01)
        time.sleep(0.5)  # until the far end knows our reader as well, which only it can tell

    def ask(self, data: Array) -> Array:
        self._requests.write(Sample(data))
        while True:
            if not self._waiting.wait(duration(seconds=PATIENCE)):
                raise TimeoutError("dds: no answer")
            for sample in self._replies.take(1):
                answer: Array = sample.data
                return answer

    def publish(self, data: Array) -> None:
        self._topic.write(Sample(data))

    def close(self) -> None:
        self._bus.close()
