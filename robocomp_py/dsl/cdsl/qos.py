"""The words between the parentheses of `qos( … )`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...contract.qos import PRESETS, Durability, History, Liveliness, QoS, Reliability
from ..diagnostics import Report, did_you_mean
from .model import Setting

_FLAGS: dict[str, tuple[str, object]] = {
    "reliable": ("reliability", Reliability.RELIABLE),
    "best_effort": ("reliability", Reliability.BEST_EFFORT),
    "volatile": ("durability", Durability.VOLATILE),
    "transient_local": ("durability", Durability.TRANSIENT_LOCAL),
    "keep_last": ("history", History.KEEP_LAST),
    "keep_all": ("history", History.KEEP_ALL),
}
_TIMES = {"deadline": "deadline", "lifespan": "lifespan", "lease": "lease"}
_KINDS = {str(kind): kind for kind in Liveliness}


def read_qos(settings: Sequence[Setting], report: Report) -> QoS:
    """The QoS some settings ask for; what is wrong with them goes into the report."""
    qos = PRESETS["default"]
    for setting in settings:
        name = setting.name.text
        if name in PRESETS and not setting.word and setting.number is None:
            qos = PRESETS[name]
        elif name in _FLAGS:
            key, value = _FLAGS[name]
            qos = replace(qos, **{key: value})  # type: ignore[arg-type]  # the table pairs keys with their values
            if setting.number is not None:
                qos = _with_depth(qos, setting, report)
        elif name == "depth":
            qos = _with_depth(qos, setting, report)
        elif name in _TIMES:
            if setting.number is None or setting.number <= 0:
                report.error("bad-qos", f"`{name}` is a time, as in `{name} 50 ms`", setting.name.span)
            else:
                qos = replace(qos, **{_TIMES[name]: setting.number})  # type: ignore[arg-type]  # a time key
        elif name == "liveliness" and setting.word in _KINDS:
            qos = replace(qos, liveliness=_KINDS[setting.word])
        else:
            hint = did_you_mean(name, [*PRESETS, *_FLAGS, "depth", *_TIMES, "liveliness"])
            report.error("bad-qos", f"`{name}` is no QoS setting", setting.name.span, hint)
    return qos


def _with_depth(qos: QoS, setting: Setting, report: Report) -> QoS:
    number = setting.number
    if number is None or number != int(number) or not 1 <= number <= 1_000_000:
        report.error("bad-qos", f"`{setting.name}` takes a whole number of messages, 1 or more", setting.name.span)
        return qos
    return replace(qos, depth=int(number))
