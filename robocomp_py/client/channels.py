"""Channels of a running network, as transports know them."""

from __future__ import annotations

from typing import Any

from ..contract.interface import Operation, Pattern
from ..contract.qos import DEFAULT_QOS, QoS
from ..tools.network import Channel
from ..transports import base
from ..transports.base import TypeRef


def transport_channel(channel: Channel, operation: Operation[Any], qos: QoS = DEFAULT_QOS) -> base.Channel:
    """The channel as transports know it. The contract is that which its provider announces."""
    response = operation.response if channel.pattern is Pattern.QUERY else None
    told = channel.operation
    kind = TypeRef(told.request.name, told.fingerprint, told.text, operation.request, response)
    return base.Channel(channel.name, channel.pattern, kind, qos, told.idempotent)
