"""The table of visible links, which a transport builds from liveliness tokens. Does not depend on Zenoh itself."""

from __future__ import annotations

import logging
import re
import threading
from typing import NamedTuple

from ...wire import names

log = logging.getLogger("robocomp.transport.zenoh")

MOST, MOST_OF_OPERATION = 50_000, 4_000
"""Maximum number of links in a table: in all, and in one role of one operation. A hostile program may announce any
number of links."""

USING = ("calls", "commands")
"""The roles whose tokens have the instance of their transport."""

_OWNED = "n"


def owned(instance: str) -> str:
    """The traits of a client."""
    return _OWNED + instance if names.is_segment(instance) else "-"


def same_transport(link: int, other: int) -> bool:
    """Whether two ids are of links of one transport."""
    return link >> LINK_BITS == other >> LINK_BITS


LINK_BITS = 24
"""The lowest bits of the id of a link, which number the links of its transport."""

_AHEAD = re.compile(r"w([0-9]{1,9})")


class Token(NamedTuple):
    """Announces one link: `rc_lv/<domain>/<role>/<traits>/<fingerprint>/<pid>/<link>/<channel>`.

    Traits: those of its QoS (`contract.qos`), or `-`; of a client, `n` and its instance. A reliable publisher adds
    `w` and the maximum number of its unacknowledged messages. A `*` in the channel is written as a dot. Two fields are
    not part of the key: `since`, the version of the table when the token came, and `reached`, whether
    messages are known to get there (see `reachability`).
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
        """Maximum number of unacknowledged messages of a reliable publisher."""
        found = _AHEAD.search(self.traits)
        return int(found[1]) if found else 1

    @property
    def owner(self) -> str:
        """The instance whose client it announces; "" if it does not say so."""
        return self.traits.removeprefix(_OWNED) if self.role in USING and self.traits.startswith(_OWNED) else ""

    @property
    def key(self) -> int:
        return self.link

    @property
    def transport(self) -> int:
        """The number of the transport that the link belongs to."""
        return self.link >> LINK_BITS

    @property
    def text(self) -> str:
        """Empty: a token does not contain the contract."""
        return ""

    def key_expr(self) -> str:
        channel = self.channel.replace(names.ANY, ".")
        return f"{self.role}/{self.traits}/{self.fingerprint:016x}/{self.pid}/{self.link:016x}/{channel}"

    @classmethod
    def parse(cls, key: str) -> Token:
        """Raises ValueError if the key is not that of a token."""
        _, _, role, traits, fingerprint, pid, link, channel = key.split("/", 7)
        return cls(role, traits, int(fingerprint, 16), int(pid), int(link, 16), channel.replace(".", names.ANY))


class Table:
    """The tokens of all links of this domain. Safe to use from any thread."""

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.version = self._count = 0
        self._index: dict[tuple[str, str], dict[int, Token]] = {}
        self._full_logged = False
        """Whether the limit was logged."""

    def update(self, key: str, there: bool) -> bool:
        """Note that a token came or went; returns whether the table changed."""
        try:
            token = Token.parse(key)
        except ValueError:
            return False
        with self.changed:
            place = token.role, names.tail(token.channel)
            known = self._index.get(place, {})
            noted = known.get(token.link)
            if noted if there else noted is None or noted._replace(since=0, reached=False) != token:
                return False  # ignore the end of a different token for the same link
            if there and (self._count >= MOST or len(known) >= MOST_OF_OPERATION):
                if not self._full_logged:
                    self._full_logged = True
                    log.warning("%s: too many links are announced; further ones are ignored", token.channel)
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
        """Note that the link of a token can be reached, if the token still exists."""
        with self.changed:
            if self.holds(token):
                self._index[token.role, names.tail(token.channel)][token.link] = token._replace(reached=True)
                self.version += 1
                self.changed.notify_all()

    def holds(self, token: Token) -> bool:
        """Whether the table has this token, without interruption since it came."""
        with self.changed:
            known = self._index.get((token.role, names.tail(token.channel)), {}).get(token.link)
            return known is not None and known.since == token.since

    def find(self, role: str, channel: str) -> list[Token]:
        """Links in that role whose channel matches; either channel may have `*` for its instance."""
        with self.changed:
            candidates = list(self._index.get((role, names.tail(channel)), {}).values())
        return [t for t in candidates if names.matches(channel, t.channel) or names.matches(t.channel, channel)]
