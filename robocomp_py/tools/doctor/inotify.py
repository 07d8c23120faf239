"""The limits of inotify, by which processes learn that others come and go."""

from __future__ import annotations

from collections.abc import Iterator

from .facts import Facts, Finding, Used, Weight

NAME = "inotify"
HELP = "the limits of inotify, without which components notice others late"

_MUCH = 0.9


def find(facts: Facts) -> Iterator[Finding]:
    yield from _near(facts.machine.inotify_instances, "instances")
    yield from _near(facts.machine.inotify_watches, "watches")


def _near(limit: Used, what: str) -> Iterator[Finding]:
    if limit.most and limit.used >= _MUCH * limit.most:
        weight = Weight.ERROR if limit.used >= limit.most else Weight.WARN
        text = (
            f"your processes use {limit.used} of {limit.most} inotify {what}; beyond that, components find others late"
        )
        yield Finding(weight, text, f"sudo sysctl fs.inotify.max_user_{what}={4 * limit.most}")
