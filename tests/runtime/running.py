"""Components of tests: made from a worker class, and run on a thread."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from robocomp_py.runtime import settings
from robocomp_py.runtime.run import Running
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import TransportFactory


def make(worker: type[Worker[Any]], find: Callable[[str], TransportFactory], *sets: str, name: str = "") -> Running:
    """A component of a worker class, with assignments such as `component.period=0.25`."""
    document = settings.Document()
    for assignment in sets:
        settings.override(document, assignment)
    return Running(worker, settings.check(worker.component, document, name or None), find)


@contextmanager
def running(made: Running, *, ready: bool = True) -> Iterator[Any]:
    """The worker, while the component runs; `outcome` has what `run` returned."""
    outcome: list[bool] = []
    thread = threading.Thread(target=lambda: outcome.append(made.run()))
    thread.start()
    try:
        if ready:
            wait_until(lambda: made.ready.is_set() or not thread.is_alive())
        yield made.worker
    finally:
        made.stop()
        thread.join(3 * SOON)
        assert not thread.is_alive()
        made.worker.outcome = outcome[0]  # type: ignore[attr-defined]  # tests read it
