"""Checks, after each change of its connections, that the other routers still answer this router.

When two routers connect again, one of two errors of Zenoh 1.10 may occur:

- The new connection may be removed together with the old one, as for clients: see `hearing`.
- A router tells a new neighbour what its clients have declared when it has computed its routes. If it computes them
  only when the old connection was lost and the new one is there already, some milliseconds later, it takes the
  neighbour for an old one and tells nothing.

Both routers then count as connected, but components of one host, or both, hear nothing of the other one. So each router
answers a question on a key of its own, and asks its neighbours. If one no longer answers, the connection is shut down,
and Zenoh connects again.
"""

from __future__ import annotations

import logging
import re
import threading
from collections import Counter

import zenoh

from ...closing import Closing
from ...errors import TransportError
from ...threads import NO_THREAD, start_thread
from ..leader_followers import STUCK
from .hearing import ANSWER
from .messages import direct
from .unsafe import shut_down_connections

log = logging.getLogger("robocomp.transport.zenoh")

PAUSE = 0.5
"""Seconds between two questions to the same router: while it does not answer, components may miss messages. Zenoh needs
a fraction of this for its routes, so a router that answers is not taken for a silent one."""

_EARLY = 0.2
"""Seconds from a change to a first question to routers that have not answered yet.

Only routers that have answered are connected again, so the first answer must come before a connection is reset. Zenoh
needs up to 0.1 s for its routes.
"""

TRIES, LOOKS = 3, 12
"""Questions in a row without an answer after which the connection is shut down, and questions after each change."""

QUESTION = "rc_router"
"""The beginning of the keys; the number of a router follows."""


class Neighbours(Closing):
    """Watches the connections of a router to other routers, with a thread of its own."""

    def __init__(self, session: zenoh.Session, pause: float = PAUSE, looks: int = LOOKS) -> None:
        """Raises ZError and TransportError."""
        self._session, self._pause, self._looks = session, pause, looks
        self._changed, self._stopped = threading.Event(), threading.Event()
        self._changed.set()  # some may be connected already
        self.answered: set[str] = set()
        """Routers that have answered at least once. Others may never answer, such as `zenohd`."""
        session.declare_queryable(_key(str(session.info.zid())), direct(_answer), complete=True)
        self._listener = session.info.declare_transport_events_listener(direct(self._on_event))
        self._thread = threading.Thread(target=self._watch, name="zenoh neighbours", daemon=False)
        if not start_thread(self._thread):
            raise TransportError(f"zenoh: {NO_THREAD}")

    def close(self) -> None:
        """Stop, and wait for a question that has been asked."""
        self._stopped.set()
        self._changed.set()
        self._thread.join(STUCK)
        if self._thread.is_alive():
            log.warning("a question to another Zenoh router has not ended after %g s; not waiting any longer", STUCK)

    def _on_event(self, event: zenoh.TransportEvent) -> None:
        if event.transport.whatami == zenoh.WhatAmI.ROUTER:
            self._changed.set()

    def _watch(self) -> None:
        while self._changed.wait() and not self._stopped.is_set():
            self._changed.clear()
            try:
                self._ask_all()
            except zenoh.ZError:
                log.debug("routers are no longer asked", exc_info=True)  # the session is closed
                return
            except Exception:  # the router must go on; the next change of its connections asks again
                log.exception("other routers could not be asked")

    def _ask_all(self) -> None:
        """Ask each neighbour for a while, until a connection changes."""
        if self._stopped.wait(_EARLY) or self._changed.is_set():
            return
        for router in self._routers():
            if self._stopped.is_set():
                return
            if router not in self.answered:
                self._answers(router)
        silent: Counter[str] = Counter()
        for _ in range(self._looks):
            if self._stopped.wait(self._pause) or self._changed.is_set():
                return
            for router in self._routers():
                if self._stopped.is_set():
                    return
                if self._answers(router):
                    del silent[router]
                    continue
                silent[router] += 1
                if silent[router] == TRIES and router in self.answered:
                    self._connect_again(router)

    def _routers(self) -> list[str]:
        return [str(each) for each in self._session.info.routers_zid()]

    def _answers(self, router: str) -> bool:
        priority = zenoh.Priority.INTERACTIVE_HIGH
        replies = list(self._session.get(_key(router), timeout=ANSWER, priority=priority))
        if found := any(reply.ok for reply in replies):
            self.answered.add(router)
        return found

    def _connect_again(self, router: str) -> None:
        links = [link for link in self._session.info.links() if str(link.zid) == router]
        log.warning("the Zenoh router at %s does not answer; connecting again", ", ".join(link.dst for link in links))
        shut_down_connections({(_port(link.src), _port(link.dst)) for link in links})


def _key(router: str) -> str:
    return f"{QUESTION}/{router}"


def _answer(query: zenoh.Query) -> None:
    with query:
        query.reply(query.key_expr, b"")


def _port(locator: str) -> int:
    """The port of an address in Zenoh's form; 0 if it has none."""
    found = re.fullmatch(r"\w+/[^?#]*:(\d+)(?:[?#].*)?", locator)
    return int(found[1]) if found else 0
