"""Other readers of recordings decode each message as it was sent."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from robocomp_py.contract.types import Struct
from robocomp_py.tools.recording.bag import Options
from robocomp_py.tools.recording.reader import Recording, values_by_topic
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.ice import Ice
from robocomp_py.wire.messagepack import MessagePack
from tests.wire.messages import messages, patiently
from tests.wire.schemas import expected, listed

from .recorded import ROOMY, recorded

Read = tuple[str, int, int, str]
"""Topic, log time, publish time or 0, and values as text, in which NaN equals NaN."""


def by_rosbags(folder: Path) -> list[Read]:
    found = []
    with AnyReader([folder], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        for connection, time, raw in reader.messages():
            value = reader.deserialize(raw, connection.msgtype)
            found.append((connection.topic, time, 0, repr(listed(value))))
    return found


def by_mcap(folder: Path) -> list[Read]:
    found = []
    for path in sorted(folder.glob("*.mcap")):
        with open(path, "rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            for _, channel, message, value in reader.iter_decoded_messages():
                found.append((channel.topic, message.log_time, message.publish_time, repr(listed(value))))
    return found


CODECS = [Cdr(), ROOMY, Cdr(columns=True), MessagePack(), Ice()]


@given(messages(), st.sampled_from(["none", "lz4", "zstd"]), st.sampled_from(CODECS), st.booleans())
@settings(patiently, max_examples=50)
def test_any_recorded_message_is_read(
    sent: tuple[Struct, tuple[Any, ...]], compress: str, codec: Any, is_split: bool
) -> None:
    message, values = sent
    text = repr(expected(message.fields, values))
    wanted = [("/any/Source/told", n * 10**9, n * 10**9 - 10, text) for n in (1, 2)]
    with TemporaryDirectory() as folder:
        options = Options(compress, split_octets=1 if is_split else None)
        run = recorded(Path(folder) / "run", message, [values, values], options, codec)
        assert len(list(run.glob("*.mcap"))) == (2 if is_split else 1)
        assert by_mcap(run) == wanted
        assert by_rosbags(run) == [(topic, time, 0, values) for topic, time, _, values in wanted]
        with Recording(run) as recording:
            decoded = [values_by_topic()(each) for each in recording.messages()]
    assert [repr(expected(message.fields, each)) for each in decoded] == [text, text]
