"""Model to contract. For components in which `check` found no error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...contract.component import Component, PeriodicTimer, Port, numbers
from ...contract.interface import Interface
from ...contract.parameters import ParameterSet
from ...contract.qos import DEFAULT_QOS
from ...contract.statemachine import StateMachine
from ..diagnostics import Report
from . import model as m
from .check import FOREIGN
from .qos import read_qos


def link(
    model: m.Component,
    interfaces: Mapping[str, Sequence[Interface]],
    params: ParameterSet | None,
    machine: StateMachine | None = None,
) -> Component:
    """The component a file describes."""
    ports = []
    for item, number in zip(model.ports, numbers((i.verb, i.interface.text) for i in model.ports), strict=True):
        ports.append(
            Port(
                item.verb,
                interfaces[item.interface.text][0],
                number,
                read_qos(item.qos, Report()) if item.qos else DEFAULT_QOS,
                item.concurrent,
                _middleware(item),
                each=item.each is not None,
                policies=tuple((action.text, policy.text.lower()) for action, policy in item.policies),
            )
        )
    seconds = model.period.seconds if model.period else None
    return Component(
        model.name.text,
        tuple(ports),
        params,
        seconds or Component.period,
        model.doc,
        machine,
        _window(model),
        tuple(PeriodicTimer(each.name.text, each.period.seconds or 0.0) for each in model.timers),
    )


def _window(model: m.Component) -> str:
    """What a `gui Qt(QWidget);` says; `gui Qt;` and the older forms mean the plainest window."""
    for clause in model.all("gui"):
        named = [name.text for name in clause.names if name.text.lower() not in ("qt", "none")]
        return named[-1] if named else "QWidget"
    return ""


def _middleware(item: m.Item) -> str | None:
    """The middleware an item asks for; ROS is not carried yet."""
    if item.marker is None or item.marker.text.lower() in FOREIGN:
        return None
    return item.marker.text.lower()
