"""What of a recording is published again, and under which names. Pure, except for what the recording reads."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ...contract.interface import Operation, Pattern
from ...errors import ConfigurationError
from ...wire import names
from ..network import Network
from ..recording.calls import LOGS
from ..recording.reader import RecordedTopic, Recording, named


@dataclass
class Part:
    """A topic of a recording that is published again."""

    topic: RecordedTopic
    channel: str
    """Under which it is published."""
    operation: Operation[Any] = field(repr=False)
    sent: int = 0
    """Messages."""
    malformed: int = 0
    """Messages that do not fit their contract."""
    failed: int = 0
    """Messages that could not be sent over a middleware."""

    @property
    def pattern(self) -> Pattern:
        return self.topic.pattern


@dataclass(frozen=True)
class Remap:
    """A part of a name, between slashes, becomes another one."""

    old: str
    new: str

    @property
    def _old(self) -> list[str]:
        return self.old.strip("/").split("/")

    def applied(self, name: str) -> str:
        parts = name.split("/")
        for at in range(len(parts) - len(self._old) + 1):
            if parts[at : at + len(self._old)] == self._old:
                return "/".join([*parts[:at], *self.new.strip("/").split("/"), *parts[at + len(self._old) :]])
        return name


def remap(text: str) -> Remap:
    """Of `old=new`. Raises ConfigurationError."""
    old, equals, new = text.partition("=")
    if not equals or not old.strip("/") or not all(map(names.is_segment, new.strip("/").split("/"))):
        raise ConfigurationError(
            f"--remap {text}: write OLD=NEW, as in `world=ghost` or `world/LaserPub=front/LaserPub`"
        )
    return Remap(old, new)


def parts_of(recording: Recording, only: Sequence[str], remaps: Iterable[Remap]) -> tuple[list[Part], dict[str, str]]:
    """What is published again, and the reasons why other topics are not. Commands are published only if `only` names
    them.

    Raises RecordingError if the recording does not have what is named, and ConfigurationError.
    """
    wanted = {topic for name in only for topic in named(recording, name)}
    remaps = list(remaps)
    for each in remaps:
        named(recording, each.old)
    parts, left_out = [], {}
    for name, topic in recording.topics.items():
        if only and name not in wanted:
            continue
        if topic.operation is None:
            left_out[name] = topic.problem
        elif topic.called is not None:
            left_out[name] = "calls are not made again; --answer serves queries"
        elif name == LOGS:
            left_out[name] = "log records are not sent again"
        elif topic.pattern is Pattern.QUERY:
            left_out[name] = "queries are not replayed"
        elif topic.pattern is Pattern.COMMAND and not only:
            left_out[name] = f"commands may move a robot; replay them with `--only {name}`"
        elif _lacks_parts(name):
            left_out[name] = "its name is none of a channel: it lacks an instance, an interface or an operation"
        else:
            channel = name
            for each in remaps:
                channel = each.applied(channel)
            if _lacks_parts(channel):
                raise ConfigurationError(
                    f"--remap makes `{channel}` of {name}; a channel is instance/Interface/operation"
                )
            parts.append(Part(topic, channel, under_its_name(topic.operation, channel)))
    return parts, left_out


def under_its_name(operation: Operation[Any], channel: str) -> Operation[Any]:
    """The operation as the channel calls it: its contract has its name, which may have changed since the recording."""
    name = names.operation(channel)
    return operation if operation.name == name else replace(operation, name=name)


def _lacks_parts(name: str) -> bool:
    parts = name.split("/")
    return len(parts) < 3 or not all(map(names.is_segment, parts))


def clashes(parts: Iterable[Part], network: Network) -> list[str]:
    """What publishes topics of a replay now, for people."""
    found = []
    for channel in dict.fromkeys(each.channel for each in parts if each.pattern is Pattern.PUBLISH):
        there = network.channels.get(channel)
        publishers = {(each.told.owner, each.told.pid): None for each in there.providers} if there else {}
        found += [f"{channel} is published by {owner or 'a program'} (process {pid}) now" for owner, pid in publishers]
    return found
