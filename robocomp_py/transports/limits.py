"""The bounds of all transports: memory, queues and threads are limited everywhere, and by the same numbers."""

from __future__ import annotations

COMMANDS_WAITING = 1000
"""Maximum number of commands that wait at one server; further ones are dropped."""

QUERIES_WAITING = 1000
"""Maximum number of requests that wait at one server, or are being served; further ones are answered with BUSY."""

STRANGERS = 1000
"""Maximum number of peers with another contract that a link reports; further ones are ignored."""

BATCH = 32
"""Messages taken from one publisher before the others have their turn. Servers take fewer of each client."""

BYTES_AHEAD = 2 * 1024 * 1024
"""Bytes on their way to a reader beyond which nothing more is sent; the last message may have any size.

The queues of the sender and of a router hold as much.
"""

MOST_AHEAD = 1000
"""Maximum number of messages that a sender is ahead of a reader, whatever its depth."""

PARTS = 4
"""A reader reports what it took this many times within the number of messages that its sender may be ahead."""

BYTES_WAITING = 64 * 1024 * 1024
"""Maximum number of waiting bytes, beyond the depth, from senders that do not wait for their readers."""

ROLL_CALL = 1.0
"""Seconds between two checks whether known peers still live, since a killed one cannot tell."""

IDLE_TICK = 1.0
"""Seconds between two checks of an idle transport."""
