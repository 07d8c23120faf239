"""`clock world(speed 10, lost stop);`: the clock that all instances of a network follow."""

from __future__ import annotations

from collections.abc import Container, Mapping

from ...contract.component import MAX_SECONDS
from ..cdsl.model import Setting
from ..diagnostics import Report, did_you_mean
from . import model as m
from .restarts import value_of
from .scope import HERE, host_of

CLOCK_SETTINGS: Mapping[str, str] = {
    "speed": "the clock's seconds in a second: a number above 0, or `max` for as fast as possible",
    "mode": "`lockstep`: it waits for all instances; or `free`: it passes by itself",
    "lost": "what happens when a follower is gone: `keep` on, or `stop`",
}
"""The settings, with their meanings."""

AS_FAST_AS_POSSIBLE = "max"
"""The word for a speed without limit."""

CLOCK_WORDS: Mapping[str, Mapping[str, str]] = {
    "speed": {AS_FAST_AS_POSSIBLE: "as fast as possible; only in lock-step"},
    "mode": {"lockstep": "the clock waits for all instances", "free": "the clock passes by itself"},
    "lost": {
        "keep": "the clock goes on without a follower that is gone",
        "stop": "the instance that leads the clock fails if a follower is gone; only in lock-step",
    },
}
"""The words that a setting may have as its value, with their meanings."""


def check_clock(model: m.Deployment, report: Report) -> None:
    clock = model.clock
    if clock is None:
        return
    known = {instance.name.text: instance for instance in model.instances}
    leader = known.get(clock.leader.text)
    if leader is None and not model.skipped.intersection(clock.leader.text.split("/")):
        hint = did_you_mean(clock.leader.text, known)
        report.error("unknown-instance", f"unknown instance `{clock.leader}`", clock.leader.span, hint)
    elif leader and leader.program:
        message = f"`{clock.leader}` is a program of your own, which has no clock that others could follow"
        place = ("it is this one", leader.program.span)
        report.error("bad-clock", message, clock.leader.span, "name a generated component", place)
    for instance in model.instances:
        where = host_of(model, instance)
        if where and where.text not in HERE:
            message = f"`{instance.name}` runs on another host, and one clock is followed on one host only"
            report.error("bad-clock", message, clock.span, "remove this, or the host", ("here", where.span))
            break
    read_clock(clock, report)


def leader_of(model: m.Deployment) -> str:
    """The instance whose clock all others follow; "" without one."""
    return model.clock.leader.text if model.clock else ""


def read_clock(clock: m.Clock, report: Report) -> dict[str, float | str]:
    """The settings of the clock, by name: `speed`, where 0 means as fast as possible, `mode`, and `lost`."""
    read: dict[str, float | str] = {}
    for each in clock.settings:
        name = each.name.text
        value = _speed(each) if name == "speed" else _one_of(each, CLOCK_WORDS.get(name, ()))
        if name not in CLOCK_SETTINGS:
            hint = did_you_mean(name, CLOCK_SETTINGS) or f"there are {' and '.join(CLOCK_SETTINGS)}"
            report.error("bad-clock", f"`{name}` is not a setting of `clock`", each.name.span, hint)
        elif name in read:
            report.error("bad-clock", f"`{name}` is given twice", each.span, "remove one of them")
        elif value is None:
            report.error(
                "bad-clock", f"`{name}` is {CLOCK_SETTINGS[name]}", each.span, f"as in: {name} {_EXAMPLES[name]}"
            )
        else:
            read[name] = value
    if read.get("mode") == "free":
        spans = {each.name.text: each.span for each in clock.settings}
        if read.get("speed") == 0:
            del read["speed"]  # so that it is told once
            hint = "give a number, or remove `mode free`"
            report.error("bad-clock", "a clock is as fast as possible only in lock-step", spans["speed"], hint)
        if read.get("lost") == "stop":
            message = "a clock that passes by itself waits for no instance, and does not stop when one is gone"
            report.error("bad-clock", message, spans["lost"], "remove it, or `mode free`")
    return read


def _speed(setting: Setting) -> float | None:
    if setting.word:
        return 0.0 if setting.word.text == AS_FAST_AS_POSSIBLE else None
    number = value_of(setting, timed=False)
    return number if number is not None and 0 < number <= MAX_SECONDS else None


def _one_of(setting: Setting, words: Container[str]) -> str | None:
    return setting.word.text if setting.word and setting.word.text in words else None


_EXAMPLES = {"speed": "10", "mode": "free", "lost": "stop"}
