"""Another host, as a tool sees it: a scout in this process, behind the control socket of a network."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Iterator

from robocomp_py.deploy.scouting import Scout as Reached
from robocomp_py.tools.scout import Scout

from ..deploy.networks import Standing, process
from ..deploy.test_control import Running


@contextlib.contextmanager
def network(*hosts: str, **instances: str) -> Iterator[Running]:
    """The network `home` with these hosts, and the hosts of its instances. Each host has what runs in this process."""
    standing = Standing(*(process(name, host=host) for name, host in instances.items()))
    running = Running(standing)
    standing.scouts = {host: lambda: _scout(running.loop) for host in hosts}
    plan = {
        "name": "home",
        "hosts": [{"name": host} for host in hosts],
        "processes": [{"name": name, "host": host, "instances": [name]} for name, host in instances.items()],
    }
    running.place.leave_plan(json.dumps(plan))
    try:
        yield running
    finally:
        running.close()


def _scout(loop: asyncio.AbstractEventLoop) -> Reached:
    scout = Scout(lambda message: loop.call_soon_threadsafe(reached.hear, json.dumps(message)))
    reached = Reached(lambda line: scout.ask(json.loads(line)), lambda: _leave(loop, scout))
    return reached


def _leave(loop: asyncio.AbstractEventLoop, scout: Scout) -> None:
    loop.run_in_executor(None, scout.close)
