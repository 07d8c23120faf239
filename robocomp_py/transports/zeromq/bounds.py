"""Bounds for the memory and descriptors of connections from other hosts. Pure.

ZeroMQ bounds a frame (`MAXMSGSIZE`) and a handshake (`HANDSHAKE_IVL`). It bounds neither the frames of a message, which
it holds until the last one is there, nor the subscriptions of a connection, nor the number of connections. So this
package counts what each connection has sent and how much of it was delivered, and closes those that exceed a bound.

    message        octets sent but not delivered yet, of one connection and of all together
    subscription   octets from a subscriber, which ZeroMQ stores at twenty to fifty times the size
    connections    of one address, and of all; the process keeps some descriptors for itself
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum, auto

from ...wire.codec import MAX_BYTES

UNFINISHED = MAX_BYTES + 16 * 1024 * 1024
"""Octets of unfinished messages, with room for the heads of their frames: of a connection, and of all together."""

SUBSCRIBED, SUBSCRIBED_IN_ALL = 16 * 1024, 1024 * 1024
"""Octets that a connection may send to a publisher, and all connections together."""

HEARTBEATS = 256
"""Octets per second that are not counted, for heartbeats of other programs, which are never delivered."""

HEAD = 64
"""Maximum octets that a frame has in addition to its content; CURVE adds the most."""

STILL = 2
"""Looks in a row without a delivery after which a connection over its bound is closed."""

PROBATION, ON_PROBATION = 10.0, 1024 * 1024
"""After a connection was closed for its size: seconds for which others of its address have a lower bound, and
that bound in octets."""

_GREETING, _SMALL = 64, 64 * 1024
_LEAST_RESERVE, _MOST_OF_ADDRESS, _MOST_SILENT = 64, 1000, 128


class Kind(Enum):
    MESSAGES = auto()
    """A socket that receives requests, replies or publications."""
    SUBSCRIPTIONS = auto()
    """A publisher's socket."""


@dataclass(slots=True)
class Connection:
    """What is known of one TCP connection."""

    kind: Kind
    address: str
    port: int
    since: float
    accepted: bool = True
    """Whether the other side has connected, not this one."""
    received: int = 0
    """Octets that have arrived, as the kernel counts them."""
    delivered: int = 0
    """Octets of whole messages taken from the socket. Only the receiving thread writes it."""
    queued: int = 0
    """Octets of whole messages that may wait in the socket."""
    uncounted: int = 0
    """Octets outside of messages."""
    still: int = 0
    """Looks in a row without a delivery since the look before."""
    looked_at: tuple[float, int] = field(default=(0.0, -1))
    """The time of the last look, and the octets delivered by then."""

    @property
    def unfinished(self) -> int:
        return max(0, self.received - self.uncounted - self.delivered - self.queued)

    @property
    def silent(self) -> bool:
        """Whether it has not even begun the handshake."""
        return self.received <= _GREETING

    @property
    def urgent(self) -> bool:
        """Whether it needs another look soon, even if nothing more arrives."""
        return self.still < STILL and self.unfinished > _SMALL

    def look(self, received: int, now: float) -> None:
        """Note the octets that have arrived by now."""
        when, before = self.looked_at
        delivered = self.delivered
        self.received = received
        self.still = self.still + 1 if delivered == before else 0
        self.uncounted += int(HEARTBEATS * (now - (when or self.since)))
        # Never more than has arrived: a generous credit must not count for later octets.
        self.uncounted = min(self.uncounted, received - delivered)
        self.looked_at = now, delivered


@dataclass(frozen=True, slots=True)
class Descriptors:
    """The limits on descriptors, and so on connections."""

    limit: int

    @property
    def reserve(self) -> int:
        """Descriptors that connections from other hosts must leave free."""
        return max(_LEAST_RESERVE, self.limit // 8)

    @property
    def of_address(self) -> int:
        """Maximum number of connections of one address."""
        return min(_MOST_OF_ADDRESS, self.limit // 4)

    @property
    def silent(self) -> int:
        """Maximum number of silent connections of one address."""
        return min(_MOST_SILENT, self.of_address // 2)

    @property
    def for_others(self) -> int:
        """Maximum number of connections of all addresses."""
        return self.limit // 2


def too_large(connections: Iterable[Connection], on_probation: frozenset[str]) -> list[tuple[Connection, str]]:
    """The connections to close because of what they have sent, and why."""
    found: list[tuple[Connection, str]] = []
    kept: list[Connection] = []
    subscribed = 0
    for each in connections:
        if each.kind is Kind.SUBSCRIPTIONS:
            if each.unfinished > SUBSCRIBED:
                found.append((each, f"it subscribed with more than {SUBSCRIBED // 1024} KiB"))
            else:
                subscribed += each.unfinished
                kept.append(each)
        elif each.still >= STILL and each.unfinished > (ON_PROBATION if each.address in on_probation else UNFINISHED):
            found.append((each, f"it sent a message of more than {MAX_BYTES // 1024**2} MiB"))
        else:
            kept.append(each)
    kept.sort(key=lambda each: each.unfinished)
    messages = [each for each in kept if each.kind is Kind.MESSAGES]
    unfinished = sum(each.unfinished for each in messages)
    while unfinished > UNFINISHED and messages:
        largest = messages.pop()
        if largest.still >= STILL:
            unfinished -= largest.unfinished
            found.append((largest, f"unfinished messages together took more than {MAX_BYTES // 1024**2} MiB"))
    subscribers = [each for each in kept if each.kind is Kind.SUBSCRIPTIONS]
    while subscribed > SUBSCRIBED_IN_ALL:
        largest = subscribers.pop()
        subscribed -= largest.unfinished
        found.append((largest, f"subscriptions together took more than {SUBSCRIBED_IN_ALL // 1024**2} MiB"))
    return found


def too_many(connections: Iterable[Connection], descriptors: Descriptors, highest: int) -> list[tuple[Connection, str]]:
    """The connections to close because there are too many, and why. `highest` is the highest descriptor in use.

    Silent connections go first, the oldest before the others, since it will hardly speak. Of the others the newest
    goes first, so that established ones go on.
    """
    accepted = [each for each in connections if each.accepted]
    accepted.sort(key=lambda each: (not each.silent, each.since if each.silent else -each.since))
    silent = Counter(each.address for each in accepted if each.silent)
    of_address = Counter(each.address for each in accepted)
    surplus = max(len(accepted) - descriptors.for_others, highest + 1 - (descriptors.limit - descriptors.reserve))
    found: list[tuple[Connection, str]] = []
    for each in accepted:
        if each.silent and silent[each.address] > descriptors.silent:
            why = f"it had more than {descriptors.silent} silent connections"
        elif of_address[each.address] > descriptors.of_address:
            why = f"it had more than {descriptors.of_address} connections"
        elif surplus > 0:
            why = f"nearly all of the {descriptors.limit} descriptors of this process were taken"
        else:
            continue
        silent[each.address] -= each.silent
        of_address[each.address] -= 1
        surplus -= 1
        found.append((each, why))
    return found
