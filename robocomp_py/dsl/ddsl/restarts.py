"""What happens to processes that end: `restart on_failure( … )`, `escalation`, `grace`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from ...contract.component import MAX_SECONDS
from ..cdsl.model import Amount, Setting
from ..diagnostics import Report, did_you_mean
from . import model as m
from .scope import restart_of

_MOST = 1_000_000


@dataclass(frozen=True)
class _Kind:
    """A setting: its allowed values, and their description."""

    fits: Callable[[float], bool]
    said: str
    timed: bool = True


_KNOWN: Mapping[str, _Kind] = {
    "intensity": _Kind(lambda x: 1 <= x <= _MOST and x % 1 == 0, f"how many restarts, 1 to {_MOST}", timed=False),
    "period": _Kind(lambda x: 0 < x <= MAX_SECONDS, f"seconds, more than 0 and at most {MAX_SECONDS:.0f}"),
    "delay": _Kind(lambda x: 0 <= x <= MAX_SECONDS, f"seconds, 0 to {MAX_SECONDS:.0f}"),
    "max_delay": _Kind(lambda x: 0 <= x <= MAX_SECONDS, f"seconds, 0 to {MAX_SECONDS:.0f}"),
}


def check_restarts(model: m.Deployment, report: Report) -> None:
    said = (*(each.restart for each in model.systems), *(each.restart for each in model.instances))
    for each in (model.restart, *said):
        if each:
            read_restart(each, report)
    scopes: list[m.Deployment | m.System] = [model, *model.systems]
    for scope in scopes:
        prefix = f"{scope.name}/" if isinstance(scope, m.System) else ""
        within = [each for each in model.instances if each.name.text.startswith(prefix)]
        policies = [restart_of(model, each) for each in within]
        restarted = any(each and each.policy.text != "never" for each in policies)
        escalation = scope.escalation
        if escalation and escalation.text != "one_for_one" and not restarted and "restart" not in model.skipped:
            message = f"`{escalation}` has no effect: nothing is restarted here"
            report.warning("ineffective-escalation", message, escalation.span, "add, for example: restart on_failure;")
    for instance in model.instances:
        if (grace := instance.grace) and not (0 <= _seconds(grace, -1) <= MAX_SECONDS):
            message = f"`grace` is a time, 0 to {MAX_SECONDS:.0f} s"
            report.error("bad-restart", message, grace.span, "as in: grace 10;")


def _seconds(amount: Amount, otherwise: float) -> float:
    """Without a unit they are seconds."""
    seconds = amount.seconds if amount.unit else amount.number
    return otherwise if seconds is None else seconds


def read_restart(restart: m.Restart, report: Report) -> dict[str, float]:
    """The values that the clause sets, by name; errors go into the report."""
    given: dict[str, Setting] = {}
    found: dict[str, float] = {}
    if restart.settings and restart.policy.text == "never":
        message = "`never` takes no settings"
        report.error("bad-restart", message, restart.settings[0].span, "remove them, or write on_failure")
        return found
    for each in restart.settings:
        name = each.name.text
        kind = _KNOWN.get(name)
        if kind is None:
            hint = did_you_mean(name, _KNOWN) or f"there are {', '.join(_KNOWN)}"
            report.error("bad-restart", f"`{name}` is not a setting of `restart`", each.name.span, hint)
            continue
        if (first := given.setdefault(name, each)) is not each:
            report.error("bad-restart", f"`{name}` is given twice", each.span, "", ("first here", first.span))
            continue
        number = value_of(each, timed=kind.timed)
        if number is None or not kind.fits(number):
            message = f"`{name}` is {kind.said}"
            report.error("bad-restart", message, each.span, f"as in: {name} {_EXAMPLES[name]}")
            continue
        found[name] = number
    least, most = found.get("delay", DEFAULTS["delay"]), found.get("max_delay", DEFAULTS["max_delay"])
    if least > most:
        at = given.get("max_delay") or given["delay"]
        message = f"the first delay, {least:g} s, is longer than the longest, {most:g} s"
        report.error("bad-restart", message, at.span, "delays grow from `delay` to `max_delay`")
    return found


_EXAMPLES = {"intensity": "5", "period": "60", "delay": "0.2", "max_delay": "30"}
DEFAULTS: Mapping[str, float] = {name: float(text) for name, text in _EXAMPLES.items()}
"""The defaults."""

RESTART_SETTINGS: Mapping[str, str] = {
    "intensity": f"how many restarts within a `period` are too many, {DEFAULTS['intensity']:g} by default",
    "period": f"the seconds within which restarts are counted, {DEFAULTS['period']:g} by default",
    "delay": f"the seconds before the first restart, {DEFAULTS['delay']:g} by default; doubled before each further one",
    "max_delay": f"the most seconds before a restart, {DEFAULTS['max_delay']:g} by default",
}
"""The settings, with their meanings."""


def same_restart(model: m.Deployment, instance: m.Instance) -> object:
    """What the instances of a process must have in common."""
    restart = restart_of(model, instance)
    return (restart.policy.text, read_restart(restart, Report())) if restart else ("never", {})


def restart_values(model: m.Deployment, together: Sequence[m.Instance]) -> dict[str, str | float]:
    """Whether and how often a process is started again; all its instances say the same."""
    said = restart_of(model, together[-1])
    if said is None:
        return {}
    given = {**DEFAULTS, **read_restart(said, Report())}
    return {**given, "intensity": int(given["intensity"]), "when": said.policy.text}


def grace_of(model: m.Deployment, together: Sequence[m.Instance]) -> float | None:
    """Seconds that a process has to end: the longest grace of an instance, times their number; None if none has one."""
    said = [each.grace.seconds if each.grace.unit else each.grace.number for each in together if each.grace]
    known = [seconds for seconds in said if seconds is not None]
    return max(known) * len(together) if known else None


def value_of(setting: Setting, *, timed: bool) -> float | None:
    """A number, or the seconds of a time; None if it is neither."""
    amount = setting.amount
    if amount is None or (amount.unit and not timed):
        return None
    return amount.seconds if amount.unit else amount.number
