"""Removes leftovers of killed components from the run-time folder: sockets, pipes, claims, shared memory.

The next process that opens the same middleware does this, too, but a network that ends may be the last one.
"""

from __future__ import annotations

import contextlib

from ...errors import RobocompError


def clear_up() -> None:
    """Blocks for a moment. Raises nothing: leftovers are harmless, and the next process removes them."""
    from ... import installed  # needed only at the end
    from ...transports.base import TransportConfig, find_transport
    from ...transports.deployment import deployment_of
    from ...transports.directory import clear
    from ...transports.runtime_folder import runtime_dir

    for name in installed.transports():
        with contextlib.suppress(OSError, RobocompError):
            folder = runtime_dir(name)
            if folder.is_dir() and clear(folder) and deployment_of(name).leaves_memory:
                find_transport(name)(TransportConfig(owner="rcdeploy")).close()
