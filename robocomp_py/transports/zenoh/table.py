"""Which links there are, as their liveliness tokens tell every Zenoh transport. Knows nothing of Zenoh itself."""

from __future__ import annotations

import logging
import re
import threading
from typing import NamedTuple

from ...wire import names

log = logging.getLogger("robocomp.transport.zenoh")

MOST, MOST_OF_OPERATION = 50_000, 4_000
"""Links that a table knows: of all operations, and in one role of one operation. A hostile program may announce any
number of them."""

_AHEAD = re.compile(r"w([0-9]{1,9})")


class Token(NamedTuple):
    """One link, as all can see it: `rc_lv/<domain>/<role>/<traits>/<fingerprint>/<pid>/<link>/<channel>`.

    Traits: those of its QoS (`contract.qos`), `-` if it has none; of a reliable publisher also `w` and
    how many messages it may be ahead of its readers. A `*` in the channel is written as a dot. Not
    told, but noted here: `since`, the version of the table in which it came, and whether what is sent to
    it is known to get there (`reached`, see `reaching`).
    """

    role: str
    traits: str
    fingerprint: int
    pid: int
    link: int
    channel: str
    since: int = 0
    reached: bool = False

    @property
    def ahead(self) -> int:
        """After so many messages it waits for a word from its readers."""
        found = _AHEAD.search(self.traits)
        return int(found[1]) if found else 1

    @property
    def key(self) -> int:
        return self.link

    @property
    def text(self) -> str:
        """A token does not say what its contract is."""
        return ""

    def key_expr(self) -> str:
        channel = self.channel.replace(names.ANY, ".")
        return f"{self.role}/{self.traits}/{self.fingerprint:016x}/{self.pid}/{self.link:016x}/{channel}"

    @classmethod
    def parse(cls, key: str) -> Token:
        """Raises ValueError if that is none."""
        _, _, role, traits, fingerprint, pid, link, channel = key.split("/", 7)
        return cls(role, traits, int(fingerprint, 16), int(pid), int(link, 16), channel.replace(".", names.ANY))


class Table:
    """The tokens of all links of this domain. Safe to use from any thread."""

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.version = self._count = 0
        self._index: dict[tuple[str, str], dict[int, Token]] = {}
        self._full = False
        """Whether it was told that there are too many."""

    def hear(self, key: str, there: bool) -> bool:
        """Note that a token came or went; whether that is news."""
        try:
            token = Token.parse(key)
        except ValueError:
            return False
        with self.changed:
            place = token.role, _tail(token.channel)
            known = self._index.get(place, {})
            noted = known.get(token.link)
            if noted if there else noted is None or noted._replace(since=0, reached=False) != token:
                return False  # an end of another token, though it is said to be of the same link, ends nothing
            if there and (self._count >= MOST or len(known) >= MOST_OF_OPERATION):
                if not self._full:
                    self._full = True
                    log.warning("more ends of %s are announced than are taken note of", token.channel)
                return False
            self._index[place] = known
            self.version += 1
            if there:
                known[token.link] = token._replace(since=self.version)
                self._count += 1
            else:
                del known[token.link]
                self._count -= 1
                if not known:
                    del self._index[place]
            self.changed.notify_all()
        return True

    def reach(self, token: Token) -> None:
        """Note that a token's link can be reached, if it is still there."""
        with self.changed:
            if self.holds(token):
                self._index[token.role, _tail(token.channel)][token.link] = token._replace(reached=True)
                self.version += 1
                self.changed.notify_all()

    def holds(self, token: Token) -> bool:
        """Whether it is there, and has been since."""
        with self.changed:
            known = self._index.get((token.role, _tail(token.channel)), {}).get(token.link)
            return known is not None and known.since == token.since

    def find(self, role: str, channel: str) -> list[Token]:
        """Links in that role whose channel matches, either of which may have `*` for its instance."""
        with self.changed:
            candidates = list(self._index.get((role, _tail(channel)), {}).values())
        return [t for t in candidates if names.matches(channel, t.channel) or names.matches(t.channel, channel)]


def _tail(channel: str) -> str:
    """Interface and operation: what a channel has in common with all that it may match."""
    return "/".join(channel.split("/")[-2:])
