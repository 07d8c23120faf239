"""What all links of a domain announce, for tools."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping
from typing import Any

from ...wire import names
from ..base import TransportConfig
from ..census import Told
from .table import Token
from .transport import ZenohTransport


def census(options: Mapping[str, Any]) -> list[Told]:
    """See `Deployment.census`."""
    with contextlib.closing(ZenohTransport(TransportConfig(options, "rc"))) as transport:
        tokens = transport.every_token()
        owners = _owners(tokens) | transport.owners()
        texts: dict[int, str] = {}
        for token in tokens:
            if not texts.get(token.fingerprint):  # a link may leave before it answers, so the next one is asked
                texts[token.fingerprint] = transport.contract(token.link)
    return [
        Told(
            owners.get(token.transport, ""),
            token.pid,
            token.role,
            token.channel,
            token.fingerprint,
            texts[token.fingerprint],
            token.traits,
        )
        for token in tokens
    ]


def _owners(tokens: Iterable[Token]) -> dict[int, str]:
    """The instance that each transport seems to belong to, of programs that do not tell it (see `telling`).

    That is the one whose CommonBehavior it serves, else any that it serves. A token does not contain it.
    """
    found: dict[int, str] = {}
    for token in tokens:
        if token.role in ("serves", "receives", "publishes") and not token.channel.startswith(names.ANY):
            instance = token.channel.rsplit("/", 2)[0]
            if names.segment(token.channel) == "CommonBehavior":
                found[token.transport] = instance
            else:
                found.setdefault(token.transport, instance)
    return found
