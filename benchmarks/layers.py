"""Divides the time of a query among the bare library, our codec, our calls, ports and monitor, and our transport.

Codecs are measured alone. The time of calls, ports and monitor is that of a query through a transport that is only
a function call, without the codec. The rest of the round trip is the transport's adapter: headers, deadlines,
discovery, threads.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from robocomp_py.runtime import ports
from robocomp_py.runtime.monitor import Monitor
from robocomp_py.transports.base import Capability, Channel, Reply, Service, Statistics
from robocomp_py.wire.cdr import TAIL, Cdr
from robocomp_py.wire.codec import Codec
from robocomp_py.wire.messagepack import MessagePack

from . import compared, query
from .ours import IMPLEMENTS, REQUIRES, Handlers, echo, route
from .parties import Array, Party
from .query import Tell, some
from .rounds import Effort, by_turns, how_many, seconds_of, times
from .tables import Table, octets, us

SIZES = (64, 1_000_000)


@dataclass(frozen=True)
class Row:
    """In µs."""

    middleware: str
    size: int
    raw: float
    codec: float
    """What ours takes more than the bare one's."""
    runtime: float
    transport: float


class _Shortcut:
    """A transport that calls the service itself."""

    capabilities = Capability.RELIABLE

    def __init__(self, codec: Codec) -> None:
        self.codec = codec
        self.stats = Statistics()
        self._service: Service | None = None

    def server(self, channel: Channel, service: Service) -> _Shortcut:
        self._service = service
        return self

    def caller(self, channel: Channel) -> _Shortcut:
        return self

    def ask(self, payload: Any, deadline: float) -> Reply:
        assert self._service
        reply = self._service(as_received(self.codec, payload), time.monotonic() + deadline)
        assert isinstance(reply, Reply)
        return Reply(reply.status, as_received(self.codec, reply.payload))


def as_received(codec: Codec, payload: Any) -> Any:
    """A payload as it is received: without the tail for a header, and in one piece if the transport joins pieces."""
    if type(payload) is bytearray:
        return memoryview(payload)[: -len(TAIL)]
    return b"".join(payload) if isinstance(codec, Cdr) and isinstance(payload, list) else payload


def run(middlewares: Iterable[str], effort: Effort, tell: Tell) -> list[Row]:
    chosen = [each for each in middlewares if compared.raw(each)]
    rows = []
    for whole in query.run(chosen, SIZES, effort, lambda text: tell(f"layers · {text}")):
        if not (whole.ours and whole.raw):
            raise RuntimeError(f"{whole.middleware}: {whole.failure}")
        bare = compared.raw(whole.middleware)
        assert bare
        data, codec = some(whole.size), codec_of(whole.middleware)
        with _shortcut(codec, data) as all_but_transport:
            calls = (_our_coding(codec, data), _raw_coding(bare, data), all_but_transport)
            ours, its, shortcut = _medians(calls, effort)
        coding, runtime = ours - its, shortcut - ours
        rest = whole.ours.p50 - whole.raw.p50 - coding - runtime
        rows.append(Row(whole.middleware, whole.size, whole.raw.p50, coding, runtime, rest))
    return rows


def codec_of(middleware: str) -> Codec:
    """The codec of a transport, without opening the transport."""
    if middleware == "zeromq":
        return MessagePack()
    if middleware == "zenoh":
        return Cdr()
    if middleware == "shm":
        from robocomp_py.transports.shm.codec import ApartCdr

        return ApartCdr()
    from robocomp_py.transports.dds.types import CODEC

    return CODEC


def _our_coding(codec: Codec, data: Array) -> Callable[[], object]:
    """All encoding and decoding of a query."""
    ask, asked = codec.encoder(echo.request, snapshot=False), codec.decoder(echo.request)
    answer, answered = codec.encoder(echo.response), codec.decoder(echo.response)
    return lambda: answered(as_received(codec, answer(asked(as_received(codec, ask((data,)))))))


def _raw_coding(party: Party, data: Array) -> Callable[[], object]:
    encode, decode = party.encode, party.decode
    assert encode
    assert decode
    return lambda: decode(encode(decode(encode(data))))


@contextlib.contextmanager
def _shortcut(codec: Codec, data: Array) -> Iterator[Callable[[], object]]:
    """A query through the shortcut, from inside a worker."""
    transport: Any = _Shortcut(codec)
    asking, serving = Monitor(), Monitor()
    router = route(transport, 10)
    ports.bind_handlers(IMPLEMENTS, Handlers(lambda _: None), router, serving)
    proxy, _ = ports.bind_proxy(REQUIRES, router, asking)
    asking.open()
    serving.open()
    try:
        with asking.held():
            yield partial(proxy._ask, echo, (data,), None)
    finally:
        asking.close()
        serving.close()


def _medians(calls: Sequence[Callable[[], object]], effort: Effort) -> list[float]:
    """The median of each in µs, measured in turn."""
    measures = [partial(seconds_of, call, how_many(call, effort.seconds)) for call in calls]
    return [times(rounds).p50 for rounds in by_turns(measures, effort.rounds)]


def table(rows: list[Row]) -> Table:
    head = ("", "array", "bare library", "+ codec", "+ calls, ports, monitor", "+ transport")
    cells = [
        (row.middleware, octets(row.size), us(row.raw), _more(row.codec), _more(row.runtime), _more(row.transport))
        for row in rows
    ]
    return Table("layers", "where the time of a query goes", head, cells)


def _more(microseconds: float) -> str:
    return f"{microseconds:+.1f} µs"


def package_codec(effort: Effort) -> Table:
    """The codec of Cyclone DDS's Python package for one array, which `raw` avoids."""
    from .raw_dds import Octets, encode

    rows = []
    for size in (64, 1024, 65536, 1_000_000):
        data = some(size)
        sample, wire = Octets(data.tobytes()), encode(data)  # bytes are its fastest type
        coding = (sample.serialize, partial(Octets.deserialize, wire))
        rows.append((octets(size), *map(us, _medians(coding, effort))))
    title = "the codec of the cyclonedds package, which `raw` does without"
    return Table("package_codec", title, ("array", "encode", "decode"), rows, labels=1)
