# Generated from plain.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of plain, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from robocomp_py.runtime.api import Component, Worker


class GenericWorker(Worker[None]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "plain",
        period=0.1,
    )
    middleware = "auto"
