"""What all components of a domain announce, for tools."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Set
from typing import Any

from ..base import TransportConfig
from ..census import Told
from .core import DDSCore

_QUIET = 0.1
"""Seconds without news after which discovery counts as complete."""

_LONGEST = 1.0
"""Seconds after which it counts as complete in any case."""

_LOOK = 0.01


@contextlib.contextmanager
def asking(options: Mapping[str, Any]) -> Iterator[Callable[[], list[Told]]]:
    """See `Deployment.asking`. DDS does not report when it has found all participants."""
    with contextlib.closing(DDSCore(TransportConfig(options, "rc"))) as transport:
        endpoints = transport.bus.endpoints
        begun = news = time.monotonic()

        def note(channels: Set[str]) -> None:
            nonlocal news
            news = time.monotonic()

        def heard() -> list[Told]:
            while not (endpoints.every() and time.monotonic() - news > _QUIET) and time.monotonic() - begun < _LONGEST:
                time.sleep(_LOOK)
            return [
                Told(each.owner, each.pid, each.role, each.channel, each.fingerprint, each.text, each.traits)
                for each in endpoints.every()
                if each.role
            ]

        endpoints.on_change = note
        yield heard
