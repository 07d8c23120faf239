"""Removes what killed components left in the run-time folder: sockets, pipes, claims, shared memory.

Whoever opens the same middleware next does so, too. But behind a network that has ended, nobody may come.
"""

from __future__ import annotations

import contextlib

from ...errors import RobocompError


def clear_up() -> None:
    """Blocks for a moment. Nothing is raised: what stays is harmless, and removed by the next one who comes."""
    from ... import installed  # the keeper needs this at its end only
    from ...transports.base import TransportConfig, find_transport
    from ...transports.deployment import deployment_of
    from ...transports.directory import clear, runtime_dir

    for name in installed.transports():
        with contextlib.suppress(OSError, RobocompError):
            folder = runtime_dir(name)
            if folder.is_dir() and clear(folder) and deployment_of(name).leaves_memory:
                find_transport(name)(TransportConfig(owner="rcdeploy")).close()
