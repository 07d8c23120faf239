"""What all components of a domain announce, for tools."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping
from typing import Any

from ..base import TransportConfig
from ..census import Told
from .transport import DDSTransport

_QUIET = 0.1
"""Seconds without news after which discovery counts as complete."""

_LONGEST = 1.0
"""Seconds after which it counts as complete in any case."""

_LOOK = 0.01


def census(options: Mapping[str, Any]) -> list[Told]:
    """See `Deployment.census`. DDS does not report when it has found all participants."""
    with contextlib.closing(DDSTransport(TransportConfig(options, "rc"))) as transport:
        begun = changed = time.monotonic()
        known = 0
        while (now := time.monotonic()) - changed < _QUIET and now - begun < _LONGEST:
            time.sleep(_LOOK)
            found = transport.bus.endpoints.every()
            if len(found) != known or not found:
                known, changed = len(found), now
        return [
            Told(each.owner, each.pid, each.role, each.channel, each.fingerprint, each.text, each.traits)
            for each in transport.bus.endpoints.every()
            if each.role
        ]
