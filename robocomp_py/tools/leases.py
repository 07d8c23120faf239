"""Leases on what components tell of their calls and logs; see `watch` in Introspection.idsl."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass

from ..errors import RobocompError, TransportError
from ..threads import NO_THREAD, start_thread
from . import asking
from .access import Access
from .network import Channel, Network

LEASE = 10.0
"""Seconds of one lease: so long a component goes on after its tool was killed."""

_LOOK = 0.05
"""Seconds between two looks for a topic that a component is opening."""

log = logging.getLogger("robocomp.tools")


@dataclass(frozen=True)
class Told:
    """What is held."""

    topics: list[Channel]
    """`called` or `logged` of each component that tells, by each way on which it is to be heard."""
    silent: Mapping[str, str]
    """Why the others do not, by their whole names."""


@contextlib.contextmanager
def told(
    access: Access,
    census: Callable[[], Network],
    components: Collection[str],
    operation: str,
    timeout: float = 5.0,
) -> Iterator[Told]:
    """While entered, these components publish `operation` (`called` or `logged`) of IntrospectionPub.

    A component that is restarted meanwhile does so again. Waits at most `timeout` seconds for the topics.
    """
    silent = _renew(access, census(), components, operation)
    stopped = threading.Event()
    renewing = threading.Thread(target=_renew_all, args=(access, census, components, operation, stopped), name="leases")
    if not start_thread(renewing):
        raise TransportError(NO_THREAD)
    try:
        yield _awaited(census, [each for each in components if each not in silent], silent, operation, timeout)
    finally:
        stopped.set()
        renewing.join()


def _awaited(
    census: Callable[[], Network], telling: Collection[str], silent: dict[str, str], operation: str, timeout: float
) -> Told:
    end = time.monotonic() + timeout
    wanted = {f"{each}/IntrospectionPub/{operation}": each for each in telling}
    while True:
        network = census()
        found = {each.name: each for each in network.stock("IntrospectionPub") if each.providers}
        late = [
            name
            for name, component in wanted.items()
            if name not in found or not set(asking.watched_on(network, component)) <= set(found[name].hosts)
        ]
        if not late or time.monotonic() > end:
            silent |= {wanted[name]: f"its topic did not appear in {timeout:g} s" for name in late}
            return Told([way for name in wanted if name in found for way in found[name].each_way()], silent)
        time.sleep(_LOOK)


def _renew_all(
    access: Access,
    census: Callable[[], Network],
    components: Collection[str],
    operation: str,
    stopped: threading.Event,
) -> None:
    while not stopped.wait(LEASE / 3):
        try:
            _renew(access, census(), components, operation)
        except RobocompError as exc:
            log.debug("leases: %s", exc)  # the next attempt comes soon


def _renew(access: Access, network: Network, components: Collection[str], operation: str) -> dict[str, str]:
    """Those that refuse, or do not answer, and why."""
    silent = {}
    for each in components:
        try:
            calls, logs = operation == "called", operation == "logged"
            asking.watch(access, network, each, calls=calls, logs=logs, lease=LEASE)
        except RobocompError as exc:
            silent[each] = str(exc)
    return silent
