"""Makes recordings of recordings: merged, cut, with other schemas; and tables of text."""

from __future__ import annotations

import contextlib
import csv
import heapq
import itertools
import json
from collections import Counter, OrderedDict
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any

from ...contract.types import Field, Struct
from ...errors import ConfigurationError, DecodeError
from ...wire import json as values
from ...wire.codec import Decoder
from .bag import BagWriter, Foreign, Options, RecordingError
from .layout import Topic
from .reader import Recorded, RecordedTopic, Recording

_REMEMBERED = 100_000
"""Maximum number of messages with which a later one is compared."""


class Once:
    """Tells messages apart that several recordings have, for example because two hosts recorded the same topic.

    It compares each message with the last hundred thousand, so the log times of both may differ by some minutes.
    """

    def __init__(self) -> None:
        self._seen: OrderedDict[tuple[str, int, int, int], int] = OrderedDict()
        """The number of the recording by topic, time of sending, number and hash of the data."""
        self.repeated = 0
        """Messages that were not new."""

    def is_new(self, message: Recorded, recording: int) -> bool:
        """Whether no recording of another number had this message before."""
        key = message.topic.name, message.publish_time, message.sequence, hash(message.data)
        if self._seen.setdefault(key, recording) != recording:
            self.repeated += 1
            return False
        if len(self._seen) > _REMEMBERED:
            self._seen.popitem(last=False)
        return True


def copy(
    recordings: Sequence[Recording],
    folder: Path,
    options: Options,
    *,
    names: Collection[str] | None = None,
    start: int | None = None,
    end: int | None = None,
    schema: str | None = None,
    once: Once | None = None,
    also: Callable[[Recorded], Iterable[tuple[Foreign, bytes]]] = lambda _: (),
) -> int:
    """Write these messages, in the order of their log times, into a new recording; returns their number. Attachments
    and notes are copied, too.

    Topics keep what describes them, unless `schema` asks for others: then so it is for all whose contract is known.
    With `once`, a message that several recordings have is written once. `also` makes further messages of each; it
    returns the same object for the same topic.
    Raises RecordingError and ConfigurationError.
    """
    several = [
        zip(each.messages(names, start, end), itertools.repeat(number), strict=False)
        for number, each in enumerate(recordings)
    ]
    writer = BagWriter(folder, options)
    known: dict[int, int] = {}
    count = 0
    try:
        for extra in (each for recording in recordings for each in recording.extras()):
            writer.add_extra(extra)
        for message, number in heapq.merge(*several, key=lambda each: each[0].log_time):
            if once and not once.is_new(message, number):
                continue
            topic = message.topic
            if id(topic) not in known:  # a recording has each of them once, and lives longer than this function
                known[id(topic)] = writer.add(_ours(topic) if schema and topic.operation else _as_it_is(topic))
            writer.write(known[id(topic)], message.data, *message[:3])
            count += 1
            for further, data in also(message):
                if id(further) not in known:
                    known[id(further)] = writer.add(further)
                writer.write(known[id(further)], data, *message[:3])
        writer.close()
    finally:
        writer.abandon()
    return count


def _as_it_is(topic: RecordedTopic) -> Foreign:
    return Foreign(topic.in_file, topic.type, topic.encoding, topic.schema_encoding, topic.schema, dict(topic.metadata))


def _ours(topic: RecordedTopic) -> Topic:
    assert topic.operation
    return Topic(topic.name, topic.operation, topic.publisher, topic.middleware, topic.qos)


def write_csv(
    recording: Recording, folder: Path, names: Collection[str] | None
) -> tuple[dict[Path, int], dict[str, int]]:
    """A table for each topic, with a row for each message. Messages that cannot be decoded are left out.

    Returns the number of rows of each table, and for each topic the number of messages that were left out.

    Members of structs have columns of their own; sequences and dictionaries are JSON. Raises RecordingError and
    ConfigurationError.
    """
    tables = _Tables(folder)
    try:
        with contextlib.closing(tables):  # which writes what is left
            for message in recording.messages(names):
                tables.add(message)
    except OSError as exc:
        raise RecordingError(f"{folder}: {exc.strerror or exc}") from exc
    return tables.rows, tables.left_out


class _Tables:
    def __init__(self, folder: Path) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise ConfigurationError(f"{folder} is there already; choose another folder with -o")
        except OSError as exc:
            raise RecordingError(f"{folder}: {exc.strerror}") from exc
        self._folder = folder
        self._open: dict[str, tuple[IO[str], Any, Decoder]] = {}
        self.rows: dict[Path, int] = {}
        self.left_out: Counter[str] = Counter()

    def add(self, message: Recorded) -> None:
        topic = message.topic
        if topic.operation is None:
            self.left_out[topic.name] += 1
            return
        if topic.name not in self._open:
            path = self._folder / f"{topic.name.replace('/', '.')}.csv"
            file: IO[str] = open(path, "x", newline="", encoding="utf-8")  # noqa: SIM115 - until `close`
            writer = csv.writer(file)
            writer.writerow(["log_time", "publish_time", "sequence", *_columns(topic.operation.inputs)])
            self._open[topic.name] = file, writer, topic.decoder()
            self.rows[path] = 0
        to, table, decode = self._open[topic.name]
        try:
            shown = values.show_fields(topic.operation.inputs, decode(message.data))
        except DecodeError:
            self.left_out[topic.name] += 1
            return
        table.writerow([*message[:3], *_cells(topic.operation.inputs, shown)])
        self.rows[Path(to.name)] += 1

    def close(self) -> None:
        with contextlib.ExitStack() as end:
            for file, _, _ in self._open.values():
                end.callback(file.close)


def _columns(fields: Sequence[Field], before: str = "") -> Iterator[str]:
    for each in fields:
        if isinstance(each.type, Struct):
            yield from _columns(each.type.fields, f"{before}{each.name}.")
        else:
            yield f"{before}{each.name}"


def _cells(fields: Sequence[Field], shown: Any) -> Iterator[Any]:
    for each in fields:
        value = shown[each.name]
        if isinstance(each.type, Struct):
            yield from _cells(each.type.fields, value)
        else:
            yield json.dumps(value, ensure_ascii=False) if isinstance(value, list | dict | bool) else value
