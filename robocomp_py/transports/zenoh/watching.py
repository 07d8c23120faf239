"""Discovery: a transport watches only the tokens of interfaces for which it has links of its own.

If every transport watched all tokens, the router's work would grow with the cube of their number: each token is
reported to each transport, and for each report the router searches all of them. A hundred components did not start.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import zenoh

from ...wire.names import ANY
from .messages import direct

PROVIDING = ("serves", "receives", "publishes")
"""The roles whose links peers find by name."""

INQUIRY = 2.0
"""Time limit of an inquiry, in seconds."""


class Watching:
    """Watches tokens; each key stays watched until the session is closed. Safe to use from any thread."""

    def __init__(self, session: zenoh.Session, domain: int, on_token: Callable[[zenoh.Sample], object]) -> None:
        """`on_token` gets, on a Zenoh thread, each token that comes or goes, some of them more than once."""
        self._session, self._domain, self._on_token = session, domain, on_token
        self._lock = threading.Lock()
        self._watched: dict[str, threading.Event] = {}
        """By key: set when all tokens that existed at the start were reported."""

    def watch(self, role: str, channel: str) -> None:
        """Watch the possible peers of a link in this role; returns when all present ones were reported.

        Raises ZError.
        """
        keys = self._keys(role, channel)
        with self._lock:
            known = [self._watched[key] for key in keys if key in self._watched]
            new = {key: threading.Event() for key in keys if key not in self._watched}
            self._watched |= new
        try:
            self._begin(list(new))
        except BaseException:  # no other thread may rely on these
            with self._lock:
                for key in new:
                    del self._watched[key]
            raise
        finally:
            for reported in new.values():
                reported.set()
        for reported in known:
            reported.wait(INQUIRY)

    def wait_for_earlier(self, role: str, channel: str) -> None:
        """Return when all possible peers that were announced before the link have been reported.

        So of two links that are announced at the same time, at least one knows the other.
        Raises ZError.
        """
        self._wait_for(self._keys(role, channel))

    def _keys(self, role: str, channel: str) -> list[str]:
        return [f"rc_lv/{self._domain}/*/*/*/*/*/{each}/*" for each in peer_prefixes(role, channel)]

    def _begin(self, keys: list[str]) -> None:
        liveliness, on_token = self._session.liveliness(), direct(self._on_token)
        for key in keys:
            liveliness.declare_subscriber(key, on_token, history=True)
        self._wait_for(keys)

    def _wait_for(self, keys: list[str]) -> None:
        """Query the present tokens. Zenoh reports them to our subscribers before it answers the queries."""
        liveliness = self._session.liveliness()
        for replies in [liveliness.get(key, timeout=INQUIRY) for key in keys]:
            for _ in replies:
                pass


def peer_prefixes(role: str, channel: str) -> list[str]:
    """The beginnings of the channels, in tokens, of a link's possible peers.

    A link that provides something also matches users without an instance name, whose tokens have a dot instead.
    """
    *before, instance, interface, _ = channel.split("/")
    instances = [instance] if instance == ANY or role not in PROVIDING else [instance, "."]
    return ["/".join((*before, each, interface)) for each in instances]
