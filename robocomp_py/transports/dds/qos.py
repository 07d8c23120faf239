"""The QoS of DDS endpoints."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from cyclonedds.core import Policy, Qos

from ...contract.qos import History, Liveliness, QoS
from ..base import Channel, depth_of
from .library import BLOCKING_MS
from .limits import UNLIMITED, Limits

KEEP_ALL = Policy.History.KeepAll

_RELIABLE = Policy.Reliability.Reliable(BLOCKING_MS * 1_000_000)


def best_effort_qos(history: Any, *more: Any) -> Qos:
    """QoS of a reader for best-effort writers."""
    return endpoint_qos(history, *more, reliability=Policy.Reliability.BestEffort)


def endpoint_qos(history: Any, *more: Any, reliability: Any = _RELIABLE) -> Qos:
    """The QoS that all our endpoints share.

    All are reliable on the wire, because a large sample may lose fragments even on one host. Samples are
    ordered by their arrival, because clocks may be set back.
    """
    return Qos(
        reliability,
        history,
        Policy.DestinationOrder.ByReceptionTimestamp,
        Policy.DataRepresentation(use_cdrv0_representation=True),
        *more,
    )


def topic_qos(channel: Channel, limits: Limits, *more: Any, common: Callable[..., Qos] = endpoint_qos) -> Qos:
    qos = channel.qos
    more = (*more, *_policies(qos, limits))
    some = 8 if limits.room == UNLIMITED else min(8, limits.room)
    newest = Policy.History.KeepLast(max(depth_of(qos), some))  # only until we take them
    if not qos.latched:
        return common(Policy.History.KeepAll if qos.reliable else newest, *more)
    return common(
        Policy.History.KeepAll if qos.reliable else newest,
        Policy.Durability.TransientLocal,
        Policy.DurabilityService(0, Policy.History.KeepLast(qos.depth), UNLIMITED, UNLIMITED, UNLIMITED),
        *more,
    )


def _policies(qos: QoS, limits: Limits) -> Iterator[Any]:
    """Our QoS settings as policies of DDS."""
    if qos.history is History.KEEP_ALL:
        limits = limits.keeping_all()
    if limits != Limits():
        yield Policy.ResourceLimits(*limits)
    if qos.deadline is not None:
        yield Policy.Deadline(_nanoseconds(qos.deadline))
    if qos.lifespan is not None:
        yield Policy.Lifespan(_nanoseconds(qos.lifespan))
    manual = qos.liveliness is Liveliness.MANUAL_BY_TOPIC
    if qos.lease is not None:
        lives = Policy.Liveliness.ManualByTopic if manual else Policy.Liveliness.Automatic
        yield lives(_nanoseconds(qos.lease))


def _nanoseconds(seconds: float) -> int:
    return max(1, round(seconds * 1e9))
