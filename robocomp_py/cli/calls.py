"""The part of `rc echo` that shows queries and commands."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from datetime import datetime
from functools import partial
from typing import TYPE_CHECKING, Any

from ..tools.shortening import shortened
from .common import UNREACHABLE, raise_if_unread
from .hosts import code_of
from .live import Absent, Wrong, awaited, nothing_heard, say, spelled, tell_host

if TYPE_CHECKING:
    from ..tools.calls import Seen
    from ..tools.hosts import Hosts
    from ..tools.network import Channel, Network

_LOOK = 0.1
"""Seconds between two looks at the clock and at signals."""


def echo_calls(options: argparse.Namespace, hosts: Hosts) -> int:
    """Print the calls of the operations that the arguments name. Raises Absent and RobocompError."""
    from ..errors import ConfigurationError
    from ..tools import leases
    from ..tools.access import Access
    from ..tools.calls import seen
    from ..tools.tap import Span, tap

    given = {"--field": options.field, "--where": options.where, "--every": options.every > 1}
    given |= {"--csv": options.csv, "--stamps": options.stamps}
    if unfit := [name for name, value in given.items() if value]:
        raise ConfigurationError(f"{', '.join(unfit)}: for topics only; --calls prints whole calls")
    channels, components = awaited(options, partial(_chosen, options.topics, served=options.served), hosts)
    printed, ended = 0, code_of(hosts)
    census = partial(hosts.census, options.middleware, own=True)
    with ExitStack() as stack:
        access = stack.enter_context(Access())
        told = stack.enter_context(leases.told(access, census, components, "called", options.timeout))
        refused = [f"{name} does not tell its calls: {why}" for name, why in told.silent.items()]
        if not told.topics:
            raise Absent("; ".join(refused))
        for each in refused:
            say("rc echo", each)
        span, opened = Span(options.timeout, options.seconds), stack.enter_context(tap(told.topics))
        while span.goes_on():
            raise_if_unread()
            heard = opened.take(_LOOK)
            while opened.lost:
                ended = UNREACHABLE
                tell_host(options, opened.lost.pop(0))
            if heard is None:
                continue
            call, dropped = seen(channels, heard.message, served=options.served)
            if heard.dropped + dropped:
                number = heard.dropped + dropped
                print(f"rc echo: {number} calls were dropped: they come faster than they are printed", file=sys.stderr)
            if call is None:
                continue
            span.heard = True
            _show(call, options)
            printed += 1
            if printed == options.most:
                break
    if not printed:
        raise nothing_heard(options)
    return ended


def _chosen(names: Sequence[str], network: Network, *, served: bool) -> tuple[list[Channel], list[str]]:
    """The operations that these names mean, and the components that can tell of their calls. Raises ValueError."""
    from ..contract.interface import Pattern
    from ..tools.calls import tellers

    found: dict[str, Channel] = {}
    for name in names:
        channels = [each for each in network.named(name) if each.pattern is not Pattern.PUBLISH]
        if not channels:
            raise Wrong(f"`{name}` is a topic; without --calls, `rc echo {name}` prints what is published")
        found |= {each.name: each for each in channels}
    chosen = list(found.values())
    components = tellers(network, chosen, served=served)
    if not components:
        what = ", ".join(found)
        if served:
            raise ValueError(f"no component that can tell of its calls serves {what}")
        raise ValueError(
            f"no component that can tell of its calls uses {what}; --served also hears `rc call` and scripts"
        )
    return chosen, components


def _show(call: Seen, options: argparse.Namespace) -> None:
    if options.json:
        print(json.dumps(call.told), flush=True)
        return
    at = datetime.fromtimestamp(call.time).strftime("%H:%M:%S.%f")[:-3]
    whose = f"{call.caller} → {call.channel}" if call.caller else call.channel
    ended = "" if call.status == "ok" else f" {call.error}"
    answer = "" if call.response is None else f" → {_text(call.response, options)}"
    ms = f"{call.took * 1e3:.3g} ms"
    print(
        f"{at} {whose} {call.status} {ms} {_text(call.request, options)}{answer}{ended}".replace("\n", " "), flush=True
    )


def _text(value: Any, options: argparse.Namespace) -> str:
    return spelled(value if options.full else shortened(value))
