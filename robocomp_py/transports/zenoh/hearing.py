"""Checks, after each reconnection, that the router still answers this process.

Zenoh 1.10 may remove a new connection together with the old one: closing a connection to a process that hangs takes
several steps, the last of which removes whatever connection that process has then. Afterwards the router receives
from the process, but sends nothing to it any more, and neither side notices. So a client asks its router a question
after each reconnection. If no answer comes, it shuts the socket down, and Zenoh connects again.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

import zenoh

from .messages import direct
from .unsafe import shut_down

log = logging.getLogger("robocomp.transport.zenoh")

ANSWER = 2.0
"""Seconds that a router has for its answer."""

_QUESTION = "rc_hearing"
"""No token has this key, so a router needs no other process for its answer."""


class Hearing:
    """Watches the connections of a client's session. `tick` has to be called regularly."""

    def __init__(self, session: zenoh.Session, endpoint: str, do: Callable[[Callable[[], object]], object]) -> None:
        """`do` runs a function on a thread that may wait."""
        self._session, self._endpoint, self._do = session, endpoint, do
        self._reconnected = False
        self._listener = session.info.declare_transport_events_listener(direct(self._on_event))

    def tick(self) -> None:
        if self._reconnected:
            self._reconnected = False
            self._do(self._check)

    def _on_event(self, event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT:
            self._reconnected = True

    def _check(self) -> None:
        try:
            answers = list(self._session.liveliness().get(_QUESTION, timeout=ANSWER))
            there = [link.dst for link in self._session.info.links()]
        except zenoh.ZError:  # the session is closed
            return
        if all(answer.ok for answer in answers) or self._reconnected:
            return
        if shut_down({self._endpoint, *there}):
            log.warning("the Zenoh router at %s does not answer; connecting again", self._endpoint)
        else:
            log.error("the Zenoh router at %s does not answer; restart this component", self._endpoint)
