"""Publishes to the subscribers of a topic: on this host, and through scouts on other ones."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from ..contract.qos import Durability, QoS
from ..errors import HostUnreachable, RobocompError, Unreachable
from ..runtime.calls import Call
from ..transports.base import Outlet, wait_connected
from ..wire import json
from .access import Access
from .network import Channel, Way
from .posts import Message, Post, failure

_SPARE = 10.0
"""Seconds beyond its deadline in which a scout has told that it is done."""

_LOOK = 0.2
"""Seconds between two looks at whether it is to end."""

_NEVER = threading.Event()

Answers = queue.SimpleQueue[tuple[Post, Message | RobocompError]]


def publish(
    access: Access,
    channel: Channel,
    values: tuple[Any, ...],
    within: float,
    *,
    rate: float | None = None,
    most: int | None = 1,
    qos: QoS | None = None,
    latched: bool = False,
    keep: bool = False,
    over: threading.Event = _NEVER,
) -> None:
    """Send a message `most` times, `rate` times a second (once a second by default), or for ever if `most` is None.

    Subscribers have `within` seconds to connect. `qos` is what is offered, by default the same as the publishers of the
    topic offer. Ends early once `over` is set.

    With `keep`, links to subscribers stay open, so that the next message need not wait until they are connected.

    If it is `latched`, there need not be a subscriber: those that come later get the last message, until `over` is set.

    Raises Unreachable if there is no subscriber, HostUnreachable if one is on a host that is lost, UnsupportedQoS, and
    what sending raises.
    """
    if latched:
        qos = replace(qos or channel.qos, durability=Durability.TRANSIENT_LOCAL)
    ways = channel.ways
    pace = rate or 1.0
    last = within + _SPARE + (most or 0) / pace
    answers: Answers = queue.SimpleQueue()
    with contextlib.ExitStack() as links:
        here = (way for way in ways if way.via is None)
        outlets = [_connected(access, channel, way, within, qos, links, latched=latched, keep=keep) for way in here]
        posts = dict.fromkeys(way.via for way in ways if way.via)
        for post in posts:
            middlewares = [way.middleware for way in ways if way.via is post]
            question = _question(channel, values, within, rate, most, middlewares)
            question |= {"latched": latched, "keep": keep}
            links.enter_context(post.following("publish", partial(_put, answers, post), **question))
        left = set(posts)
        for _ in _beats(pace, most, over) if outlets else ():
            for outlet, call in outlets:
                outlet.send(call.encode(values))
            while not answers.empty():
                _note(answers.get(), left)
        end = None if latched or most is None else time.monotonic() + last
        while (left or (latched and outlets)) and not over.is_set():
            try:
                _note(answers.get(timeout=_LOOK), left)
            except queue.Empty:
                if end and time.monotonic() > end:
                    names = ", ".join(each.host for each in left)
                    raise HostUnreachable(f"{names}: no answer within {last:g} s") from None


def _connected(
    access: Access,
    channel: Channel,
    way: Way,
    within: float,
    qos: QoS | None,
    links: contextlib.ExitStack,
    *,
    latched: bool,
    keep: bool,
) -> tuple[Outlet, Call[Any]]:
    """A link to subscribers that are there, and what encodes its messages."""
    if keep:
        outlet, call = links.enter_context(access.outlet_again(channel, way, qos))
    else:
        outlet, call = access.outlet(channel, way, qos)
        links.callback(outlet.close)
    if latched and not channel.users:
        return outlet, call
    if not outlet.wait_peer(within):
        raise Unreachable(f"nothing subscribes to {channel.name}")
    if not wait_connected(outlet, within):
        raise Unreachable(f"the subscribers of {channel.name} could not be reached in {within:g} s")
    return outlet, call


def _question(
    channel: Channel,
    values: tuple[Any, ...],
    within: float,
    rate: float | None,
    most: int | None,
    middlewares: list[str],
) -> dict[str, Any]:
    return {
        "channel": channel.name,
        "middlewares": middlewares,
        "arguments": json.show_fields(channel.operation.inputs, values),
        "traits": next((each.told.traits for each in channel.providers), ""),
        "within": within,
        "rate": rate,
        "most": most,
    }


def _put(answers: Answers, post: Post, answer: Message | RobocompError) -> None:
    answers.put((post, answer))


def _note(told: tuple[Post, Message | RobocompError], left: set[Post]) -> None:
    """Raise the error that a scout tells; forget one that is done."""
    post, answer = told
    if isinstance(answer, RobocompError):
        raise answer
    if "error" in answer:
        raise failure(answer)
    if answer.get("end"):
        left.discard(post)


def _beats(rate: float, most: int | None, over: threading.Event) -> Iterator[None]:
    begun, sent = time.monotonic(), 0
    while not over.is_set():
        yield
        sent += 1
        if sent == most:
            return
        over.wait(max(0.0, begun + sent / rate - time.monotonic()))
