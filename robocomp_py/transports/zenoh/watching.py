"""Of whom a transport hears: of those that have links of an interface that it has links of, and of nobody else.

If each heard of everybody, their number would count three times: as many tokens, told to as many transports, and for
each of these the router looks for it among all that are to be told. A hundred components did not become ready so.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import zenoh

from ...wire.names import ANY
from .messages import direct

PROVIDING = ("serves", "receives", "publishes")
"""The roles of those who have a name that others know."""

INQUIRY = 2.0
"""Seconds for which others are asked who they are, or what they know."""


class Watching:
    """Safe to use from any thread. What was watched once is watched until the session is closed."""

    def __init__(self, session: zenoh.Session, domain: int, hear: Callable[[zenoh.Sample], object]) -> None:
        """`hear` is told, on a thread of Zenoh, of each token that comes or goes; of some more than once."""
        self._session, self._domain, self._hear = session, domain, hear
        self._lock = threading.Lock()
        self._watched: dict[str, threading.Event] = {}
        """By key: set once all that was there when it began has been told."""

    def watch(self, role: str, channel: str) -> None:
        """Have those told that a link in this role may face; returns when that is done of all who are there now.

        Raises ZError.
        """
        keys = self._keys(role, channel)
        with self._lock:
            known = [self._watched[key] for key in keys if key in self._watched]
            new = {key: threading.Event() for key in keys if key not in self._watched}
            self._watched |= new
        try:
            self._begin(list(new))
        except BaseException:  # whatever it was, nobody is to rely on these
            with self._lock:
                for key in new:
                    del self._watched[key]
            raise
        finally:
            for told in new.values():
                told.set()
        for told in known:
            told.wait(INQUIRY)

    def meet_earlier(self, role: str, channel: str) -> None:
        """Return once those that a link may face, and that were announced before it was, have been told.

        So of two links that were announced at the same time, one at least knows the other.
        Raises ZError.
        """
        self._wait_for(self._keys(role, channel))

    def _keys(self, role: str, channel: str) -> list[str]:
        return [f"rc_lv/{self._domain}/*/*/*/*/*/{each}/*" for each in neighbourhoods(role, channel)]

    def _begin(self, keys: list[str]) -> None:
        liveliness, hear = self._session.liveliness(), direct(self._hear)
        for key in keys:
            liveliness.declare_subscriber(key, hear, history=True)
        self._wait_for(keys)

    def _wait_for(self, keys: list[str]) -> None:
        """What is told to the subscribers comes first: once these questions are answered, we know who is there."""
        liveliness = self._session.liveliness()
        for replies in [liveliness.get(key, timeout=INQUIRY) for key in keys]:
            for _ in replies:
                pass


def neighbourhoods(role: str, channel: str) -> list[str]:
    """What the channels of those begin with, in their tokens, whom a link may face.

    Who provides something is also meant by those who name nobody, and write a dot.
    """
    *before, instance, interface, _ = channel.split("/")
    meant = [instance] if instance == ANY or role not in PROVIDING else [instance, "."]
    return ["/".join((*before, each, interface)) for each in meant]
