"""Removes what killed components left in the run-time folder: sockets, pipes, claims, shared memory.

The next process that opens the same middleware does so, too, but after the end of a network there may be none.
"""

from __future__ import annotations

import contextlib

from ...errors import RobocompError


def clear_up() -> None:
    """Blocks for a moment. Raises nothing: what remains is harmless, and the next process removes it."""
    from ... import installed  # the keeper needs this at its end only
    from ...transports.base import TransportConfig, find_transport
    from ...transports.deployment import deployment_of
    from ...transports.directory import clear, runtime_dir

    for name in installed.transports():
        with contextlib.suppress(OSError, RobocompError):
            folder = runtime_dir(name)
            if folder.is_dir() and clear(folder) and deployment_of(name).leaves_memory:
                find_transport(name)(TransportConfig(owner="rcdeploy")).close()
