# Generated from plain.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of plain, and the methods its SpecificWorker has to write."""

from __future__ import annotations

from robocomp_py.runtime.api import Component, Worker


class GenericWorker(Worker[None]):
    """Base of SpecificWorker: proxies are attributes, handlers are methods to write."""

    component = Component(
        "plain",
        period=0.1,
    )
    middleware = "auto"
