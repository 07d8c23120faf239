"""Facts of other hosts, as their scouts tell them. They come from outside, and are checked."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import Field, fields
from typing import Any, TypeVar

from ...errors import RobocompError
from ..census import Seen
from ..posts import Post, ask_all
from .facts import Left, Machine, Place, Process, Space, Used

_TIMEOUT = 10.0
"""Seconds for an answer."""

_TIMES = 3
"""How often a host is asked for its time: the quickest answer counts."""

T = TypeVar("T")

_PLAIN = {"int": int, "str": str}
"""By the annotations of fields."""


def left_there(posts: Sequence[Post], middlewares: Sequence[str]) -> dict[Post, Any]:
    """What killed processes have left on the hosts that answer, as they tell it; for `places`."""
    answers, _ = ask_all(posts, "leftovers", _TIMEOUT, middlewares=list(middlewares))
    return {post: [each["leftovers"] for each in found if "leftovers" in each] for post, found in answers.items()}


def places(left: Mapping[Post, Any], middlewares: Sequence[str], seen: Seen) -> tuple[list[Place], list[str]]:
    """The facts of these hosts; why a host has none."""
    found, troubles = [], []
    for post, leftovers in left.items():
        pids = sorted({each.told.pid for each in seen.ends if each.host == post.host})
        try:
            answers = post.ask("machine", _TIMEOUT, middlewares=list(middlewares), processes=pids)
            offset, inaccuracy = min((_clock(post) for _ in range(_TIMES)), key=lambda each: each[1])
            listed = tuple(_made(Left, each) for each in leftovers[0])
            found.append(Place(post.host, _machine(answers[0]["machine"]), listed, offset, inaccuracy))
        except RobocompError as exc:
            troubles.append(str(exc))
        except (TypeError, ValueError, LookupError):
            troubles.append(f"{post.host}: the answer of its scout is not understood")
    return found, troubles


def _clock(post: Post) -> tuple[float, float]:
    """Seconds by which its clock is ahead of ours, and by which that may be wrong."""
    at, begun = time.time(), time.monotonic()
    answers = post.ask("clock", _TIMEOUT)
    took = time.monotonic() - begun
    return float(answers[0]["clock"]) - (at + took / 2), took / 2


def _machine(told: Any) -> Machine:
    return Machine(
        tuple(_made(Process, each) for each in told["processes"]),
        _made(Used, told["inotify_instances"]),
        _made(Used, told["inotify_watches"]),
        _made(Space, told["memory"]) if told["memory"] else None,
        str(told["missing_memory"]),
        tuple(_made(Space, each) for each in told["disks"]),
    )


def _made(kind: type[T], told: Any) -> T:
    """An object of numbers and texts. Raises TypeError and KeyError."""
    known: tuple[Field[Any], ...] = fields(kind)  # type: ignore[arg-type]  # all are dataclasses
    for each in known:
        if type(told[each.name]) is not _PLAIN[str(each.type)]:
            raise TypeError(f"{each.name} is {told[each.name]!r}")
    return kind(**{each.name: told[each.name] for each in known})
