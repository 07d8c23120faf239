"""A program that announces only the fingerprints of its contracts, as a native program may."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from robocomp_py.contract.interface import Operation, Pattern
from robocomp_py.runtime.calls import type_of
from robocomp_py.testing import everything
from robocomp_py.testing.patience import SOON
from robocomp_py.transports.base import (
    Channel,
    Reply,
    Status,
    Transport,
    TransportConfig,
    find_transport,
    wait_connected,
)

INTERFACE = """\
module Conformance
{
    exception Failed { string what; int code; };
    interface Everything
    {
        [query] long divide(long dividend, long divisor, out long remainder) throws Failed;
        [publish] void news(int number, string text);
    };
};
"""
"""The file of its contracts."""


@contextmanager
def terse() -> Iterator[Callable[[int, str], None]]:
    """It serves `terse/Everything/divide`; what is returned publishes `terse/Everything/news` to a subscriber."""
    transport = find_transport("shm")(TransportConfig(owner="terse"))
    try:
        serve(transport, everything.divide, lambda dividend, divisor: divmod(dividend, divisor))
        outlet = transport.outlet(_channel(everything.news, Pattern.PUBLISH))
        encode = transport.codec.encoder(everything.news.request)

        def publish(number: int, text: str) -> None:
            assert outlet.wait_peer(SOON)
            assert wait_connected(outlet, SOON)
            outlet.send(encode((number, text)))

        yield publish
    finally:
        transport.close()


def serve(transport: Transport, operation: Operation[Any], answer: Callable[..., tuple[Any, ...]]) -> None:
    """Serve a query, and announce only its fingerprint."""
    decode, encode = (
        transport.codec.decoder(operation.request),
        transport.codec.encoder(operation.response),
    )
    channel = _channel(operation, Pattern.QUERY)
    transport.server(channel, lambda payload, _: Reply(Status.OK, encode(answer(*decode(payload)))))


def _channel(operation: Operation[Any], pattern: Pattern) -> Channel:
    name = f"terse/{operation.interface.rpartition('::')[2]}/{operation.name}"
    return Channel(name, pattern, replace(type_of(operation, pattern), text=""))
