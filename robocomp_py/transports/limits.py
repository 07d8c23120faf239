"""The bounds of all transports: memory, queues and threads are limited everywhere, and by the same numbers."""

from __future__ import annotations

COMMANDS_WAITING = 1000
"""Maximum number of commands that wait at one server; further ones are dropped."""

QUERIES_WAITING = 1000
"""Maximum number of requests that wait at one server, or are being served; further ones are answered with BUSY."""

STRANGERS = 1000
"""Maximum number of peers with another contract that a link reports; further ones are ignored."""

BATCH = 32
"""Messages taken from one source before the others have their turn."""

BYTES_AHEAD = 2 * 1024 * 1024
"""While so many bytes are on their way to a reader, nothing more is sent; the last message may be of any size.

That is what the queues on the way hold: those of the sender, and of a router.
"""

MOST_AHEAD = 1000
"""Maximum number of messages that a sender is ahead of a reader, whatever its depth."""

PARTS = 4
"""A reader tells its sender what it took after such a part of what the sender may be ahead."""

BYTES_WAITING = 64 * 1024 * 1024
"""Maximum number of bytes, beyond the depth, that wait of senders that do not wait for their readers."""

ROLL_CALL = 1.0
"""Seconds between two looks whether known peers still live; a killed one does not take its leave."""

IDLE_TICK = 1.0
"""Seconds between two looks of an idle transport whether all is as it was."""
