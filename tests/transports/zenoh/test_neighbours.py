"""Routers that no longer answer each other, although they are connected, connect again."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import pytest
import zenoh

from robocomp_py.testing.patience import wait_until
from robocomp_py.transports.zenoh.neighbours import QUESTION, TRIES, Neighbours
from robocomp_py.transports.zenoh.session import open_router

from ...freeports import free_ports

_SOON = 0.05
"""Seconds between two questions."""

_ON_AND_ON = 10**6
"""Questions: routes may take longer than a few."""


class Other:
    """Another router, which connects to the first one."""

    def __init__(self, endpoint: str, everything: contextlib.ExitStack) -> None:
        self.session = open_router(endpoints(1)[0], {"connect/endpoints": [endpoint]})
        everything.callback(self.session.close)
        self.lost = 0
        """Connections that have ended."""
        self.asked = 0
        """Questions that it was asked, since `answer` or `listen`."""
        self._listener = self.session.info.declare_transport_events_listener(self._on_event)

    @property
    def is_connected(self) -> bool:
        return bool(self.session.info.routers_zid())

    def answer(self) -> zenoh.Queryable[None]:
        """Answer until it is undeclared."""
        return self._hear(lambda query: query.reply(query.key_expr, b""))

    def listen(self) -> None:
        """Answer nothing."""
        self._hear(lambda query: None)

    def _hear(self, react: Callable[[zenoh.Query], None]) -> zenoh.Queryable[None]:
        def take(query: zenoh.Query) -> None:
            self.asked += 1
            react(query)

        return self.session.declare_queryable(f"{QUESTION}/{self.session.info.zid()}", take)

    def _on_event(self, event: zenoh.TransportEvent) -> None:
        self.lost += event.kind == zenoh.SampleKind.DELETE


def endpoints(count: int) -> list[str]:
    """So many different ones at which nothing listens."""
    return [f"tcp/127.0.0.1:{port}" for port in free_ports(count)]


@pytest.fixture
def everything() -> Iterator[contextlib.ExitStack]:
    with contextlib.ExitStack() as stack:
        yield stack


@pytest.fixture
def endpoint() -> str:
    return endpoints(1)[0]


@pytest.fixture
def neighbours(endpoint: str, everything: contextlib.ExitStack) -> Neighbours:
    """Those of a first router, which listens at the endpoint."""
    session = open_router(endpoint)
    everything.callback(session.close)
    return everything.enter_context(Neighbours(session, _SOON, _ON_AND_ON))


def test_a_router_that_answers_no_longer_is_connected_again(
    neighbours: Neighbours, endpoint: str, everything: contextlib.ExitStack, caplog: pytest.LogCaptureFixture
) -> None:
    other = Other(endpoint, everything)
    answering = other.answer()
    wait_until(lambda: len(neighbours.answered) == 1)
    answering.undeclare()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it
    wait_until(lambda: other.lost >= 1 and other.is_connected)
    assert "does not answer; connecting again" in caplog.text


def test_a_router_that_answers_stays_connected(
    neighbours: Neighbours, endpoint: str, everything: contextlib.ExitStack
) -> None:
    other = Other(endpoint, everything)
    other.answer()
    wait_until(lambda: len(neighbours.answered) == 1)
    wait_until(lambda: other.asked > 2 * TRIES)
    assert other.lost == 0


def test_a_router_that_has_never_answered_stays_connected(
    neighbours: Neighbours, endpoint: str, everything: contextlib.ExitStack
) -> None:
    other = Other(endpoint, everything)
    other.listen()
    wait_until(lambda: other.asked > 2 * TRIES)
    assert other.lost == 0
    assert not neighbours.answered


def test_a_router_is_known_to_answer_soon_after_it_connects(endpoint: str, everything: contextlib.ExitStack) -> None:
    session = open_router(endpoint)
    everything.callback(session.close)
    neighbours = everything.enter_context(Neighbours(session, pause=1e6))
    Other(endpoint, everything).answer()
    wait_until(lambda: len(neighbours.answered) == 1)


def test_routers_of_two_hosts_answer_each_other(everything: contextlib.ExitStack) -> None:
    first, second = endpoints(2)
    sessions = [open_router(first), open_router(second, {"connect/endpoints": [first]})]
    for session in sessions:
        everything.callback(session.close)
    both = [everything.enter_context(Neighbours(session, _SOON, _ON_AND_ON)) for session in sessions]
    wait_until(lambda: all(len(each.answered) == 1 for each in both))
