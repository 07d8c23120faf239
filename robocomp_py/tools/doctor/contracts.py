"""Both sides of a channel that disagree on its contract."""

from __future__ import annotations

from collections.abc import Iterator

from ...contract.interface import differences
from .facts import Facts, Finding, Weight

NAME = "contracts"
HELP = "clients and servers, publishers and subscribers that were generated from different IDSL files"

_MOST = 3
"""Differences that are told."""


def find(facts: Facts) -> Iterator[Finding]:
    for channel in facts.network.channels.values():
        for server in channel.providers[:1]:
            for user in {each.told.owner: each for each in channel.users}.values():
                if user.told.fingerprint != server.told.fingerprint:
                    what = _differences(user.told.text, server.told.text)
                    text = f"{user.told.owner or '?'} and {server.told.owner or '?'} disagree on {channel.name}: {what}"
                    yield Finding(Weight.ERROR, text, "generate both from the same IDSL file, and start both again")


def _differences(ours: str, theirs: str) -> str:
    if not ours or not theirs:
        return "their contracts differ"
    found = differences(ours, theirs)
    more = f"; and {len(found) - _MOST} more" if len(found) > _MOST else ""
    return "; ".join(found[:_MOST]) + more
