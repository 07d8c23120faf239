"""The words between the parentheses of `qos( … )`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from ...contract.component import MAX_SECONDS
from ...contract.qos import DEPTHS, PRESETS, TIMES, WORDS, History, Liveliness, QoS
from ..diagnostics import Report, did_you_mean
from . import model as m

_FLAGS: dict[str, tuple[str, Any]] = {
    str(value): (key, value) for key, values in WORDS.items() if values is not Liveliness for value in values
}
KNOWN = (*PRESETS, *_FLAGS, "depth", *TIMES, "liveliness")
"""The words that begin a setting."""


class _Wrong(ValueError):
    """An error in a setting, with a proposal."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


def read_qos(settings: Sequence[m.Setting], report: Report) -> QoS:
    """The QoS that settings ask for; errors go into the report."""
    qos = PRESETS["default"]
    given: dict[str, m.Setting] = {}
    for setting in settings:
        name = setting.name.text.lower()
        if name not in KNOWN:
            hint = did_you_mean(name, KNOWN) or f"there are {', '.join(KNOWN)}"
            report.error("bad-qos", f"`{setting.name}` is not a QoS setting", setting.name.span, hint)
            continue
        try:
            values = _values(name, setting)
        except _Wrong as wrong:
            report.error("bad-qos", str(wrong), setting.span, wrong.hint)
            continue
        if name in PRESETS and given:
            message = f"the preset `{setting.name}` overrides the settings before it"
            report.error("bad-qos", message, setting.span, "write it first")
        for key in values if name not in PRESETS else ():
            first = given.setdefault(key, setting)
            if first is not setting:
                message = f"`{setting.name}` contradicts or repeats `{first.name}`"
                report.error("bad-qos", message, setting.span, "", ("first here", first.span))
        qos = PRESETS[name] if name in PRESETS else replace(qos, **values)
    if "depth" in given and qos.history is History.KEEP_ALL:
        message = f"`{given['depth'].name}` has no effect beside `keep_all`"
        related = [("keep_all is here", given["history"].span)] if "history" in given else []
        report.error("bad-qos", message, given["depth"].span, "remove one of them", *related)
    _check_liveliness(qos, given, report)
    return qos


def _check_liveliness(qos: QoS, given: Mapping[str, m.Setting], report: Report) -> None:
    if qos.liveliness is not Liveliness.MANUAL_BY_TOPIC:
        return
    if qos.lease is None:
        message = "`manual_by_topic` has no effect without a `lease`"
        report.warning("ineffective-qos", message, given["liveliness"].span, "add the time after which: lease 1 s")
    elif qos.deadline is not None and qos.lease < qos.deadline:
        message = "a publisher that keeps this deadline counts as lost, since its lease is shorter"
        report.error("bad-qos", message, given["deadline"].span, "", ("the lease is here", given["lease"].span))


def _values(name: str, setting: m.Setting) -> dict[str, Any]:
    """The values that a setting sets, by the names of the QoS's fields."""
    if name == "depth" or (name == "keep_last" and setting.amount):
        keeps = {"history": History.KEEP_LAST} if name == "keep_last" else {}
        return {**keeps, "depth": _depth(setting)}
    if name in TIMES:
        seconds = setting.amount.seconds if setting.amount else None
        if seconds is None or not 0 < seconds <= MAX_SECONDS:
            raise _Wrong(f"`{setting.name}` is a time of at most {MAX_SECONDS:g} s, as in `{name} 50 ms`")
        return {name: seconds}
    if name == "liveliness":
        kinds = {str(kind): kind for kind in Liveliness}
        if setting.word is None or setting.word.text.lower() not in kinds:
            hint = did_you_mean(setting.word.text.lower(), kinds) if setting.word else ""
            raise _Wrong(f"`{setting.name}` is one of {', '.join(kinds)}", hint)
        return {name: kinds[setting.word.text.lower()]}
    if setting.amount or setting.word:
        raise _Wrong(f"`{setting.name}` stands alone")
    return dict([_FLAGS[name]]) if name in _FLAGS else {}


def _depth(setting: m.Setting) -> int:
    amount = setting.amount
    if amount is None or amount.unit or amount.number % 1 != 0 or int(amount.number) not in DEPTHS:
        raise _Wrong(f"`{setting.name}` takes a whole number of messages, 1 to {DEPTHS[-1]}")
    return int(amount.number)
