"""Tests that every transport must pass. A transport uses them with three lines:

    class TestMyTransport(TransportConformance):
        def open_transport(self) -> Transport:
            return MyTransport(TransportConfig({...}))

Two transports that it opens one after the other must reach each other, and no others. Requirements:

    topics      every subscriber gets every message, in order, whichever side opened first · messages published after
                both sides are connected arrive, including the first one and an immediate answer to it, also if both
                sides opened at once · channels are separate · 0 B to 64 MB · nothing after close · a sink that raises
                or is slow does not affect others · a sink may publish · latched messages are kept or refused · a slow
                sink gets the newest `depth` messages · reliable topics lose nothing, and every sender gives up at its
                own deadline · losses are counted, and a flood is bounded · `*` receives from all other instances ·
                a headed sink gets source, sequence number and time of each message
    commands    in order, once, from many senders; no receiver: Unreachable
    qos         missed deadlines, lost publishers and expired messages are reported and counted: see `qos.py`
    queries     replies find their callers, 64 out of order · clients get equal shares, and none waits for another's
                flood · every status arrives · no server: Unreachable · calls end at their deadlines, and a late reply
                reaches no other call · cancelled calls leave nothing behind · a service may call others, and be called
                back · the callback of a call may take long, and call again · at most one server
    contract    both sides report a different contract under the same name, and no message passes
    lifetime    close ends waits, openings and sending with Closed; it is final, and leaves no thread ·
                peers restart, move, or are killed
    typed       every IDSL type in both directions · every outcome of a call · several clients · serial workers

Time limits are generous and scaled by $ROBOCOMP_PATIENCE; no test judges speed.
"""

from __future__ import annotations

from ..parts import A_MOMENT, Inbox, answering, blob, command, drain, greet, query, subscribe, topic, unblob
from .commands import CommandsConformance
from .contracts import ContractsConformance
from .lifetime import LifetimeConformance
from .qos import QoSConformance
from .queries import QueriesConformance
from .queues import QueuesConformance
from .sources import SourcesConformance
from .topics import TopicsConformance
from .typed import TypedConformance
from .values import assert_same, everything_odd

__all__ = [
    "A_MOMENT",
    "Inbox",
    "TransportConformance",
    "answering",
    "assert_same",
    "blob",
    "command",
    "drain",
    "everything_odd",
    "greet",
    "query",
    "subscribe",
    "topic",
    "unblob",
]


class TransportConformance(
    TypedConformance,
    LifetimeConformance,
    ContractsConformance,
    QueriesConformance,
    CommandsConformance,
    QoSConformance,
    SourcesConformance,
    QueuesConformance,
    TopicsConformance,
):
    """Implement `open_transport`; the rest is the contract. The tests of the last base run first."""
