"""What Foxglove's panels draw of a recording, as further topics of a new one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ...errors import DecodeError
from ..recording.bag import Foreign
from ..recording.reader import Recorded, RecordedTopic
from .convert import Converter, converters, frame_of


class Drawn:
    """Converts messages; the topics of what it makes are `…/LaserScan` and the like, as in `rc foxglove`."""

    def __init__(self) -> None:
        self._topics: dict[str, tuple[Any, list[tuple[int, Converter]]]] = {}
        self._made: dict[tuple[str, type], Foreign] = {}

    def __call__(self, message: Recorded) -> Iterator[tuple[Foreign, bytes]]:
        """The further topics of a message, with its data there; none if it cannot be decoded or drawn."""
        topic = message.topic
        if topic.operation is None or topic.problem:
            return
        if topic.name not in self._topics:
            self._topics[topic.name] = topic.decoder(), list(converters(topic.operation))
        decode, found = self._topics[topic.name]
        if not found:
            return
        try:
            values = decode(message.data)
        except DecodeError:
            return
        for number, each in found:
            drawn = each.convert(values[number], message.publish_time, frame_of(topic.name))
            if drawn is not None:
                yield self._topic(topic, type(drawn)), drawn.encode()

    def _topic(self, topic: RecordedTopic, kind: Any) -> Foreign:
        if (topic.name, kind) not in self._made:
            schema = kind.get_schema()
            name = f"{topic.in_file}/{kind.__name__}"
            self._made[topic.name, kind] = Foreign(name, schema.name, "protobuf", schema.encoding, schema.data, {})
        return self._made[topic.name, kind]
