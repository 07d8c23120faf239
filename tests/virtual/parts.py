"""Parts of simulations."""

from __future__ import annotations

from typing import Any

from robocomp_py.runtime import settings
from robocomp_py.runtime.worker import Worker
from robocomp_py.virtual.simulation import Part


def part(worker: type[Worker[Any]], name: str = "", **sets: str) -> Part:
    document = settings.Document()
    for key, value in sets.items():
        settings.override(document, f"{key.replace('__', '.')}={value}")
    return Part(worker, settings.check(worker.component, document, name or None))
