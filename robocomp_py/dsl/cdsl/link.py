"""Model to contract. For components in which `check` found no error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...contract.component import Component, Port, numbers
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
    for item, number in zip(model.items, numbers((i.verb, i.interface.text) for i in model.items), strict=True):
        ports.append(
            Port(
                item.verb,
                interfaces[item.interface.text][0],
                number,
                read_qos(item.qos, Report()) if item.qos else DEFAULT_QOS,
                item.concurrent,
                _middleware(item),
            )
        )
    seconds = model.period.seconds if model.period else None
    period = {"period": seconds} if seconds else {}
    return Component(model.name.text, tuple(ports), params, description=model.doc, machine=machine, **period)


def _middleware(item: m.Item) -> str | None:
    """The middleware an item asks for; Ice and ROS are not carried yet."""
    if item.marker is None or item.marker.text.lower() in FOREIGN:
        return None
    return item.marker.text.lower()
