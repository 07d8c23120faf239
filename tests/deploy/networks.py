"""Networks that stand still, for what asks them how they are and for what shows that."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

from robocomp_py.deploy.events import EndRequested, RestartRequested, StopRequested
from robocomp_py.deploy.policy import State
from robocomp_py.deploy.scouting import Scout
from robocomp_py.deploy.snapshot import HostStatus, Network, ProcessStatus, Snapshot
from robocomp_py.errors import DeploymentError, HostUnreachable

READY = ProcessStatus(
    name="",
    component="thing",
    instances=(),
    ended=(),
    host="",
    state=State.READY,
    how="",
    pid=4711,
    in_state=1.0,
    uptime=61.0,
    next_start=None,
    starts=1,
    restarts=0,
    cpu=0.25,
    memory=45_000_000,
    calls=20.0,
    worst=0.0012,
    status="",
)


def process(name: str, state: State = State.READY, **more: Any) -> ProcessStatus:
    return dataclasses.replace(READY, **{"name": name, "instances": (name,), "state": state, **more})


def snapshot(*processes: ProcessStatus, hosts: tuple[HostStatus, ...] = (), stopping: bool = False,
             why: str = "") -> Snapshot:  # fmt: skip
    return Snapshot("home", True, stopping, why, 187.0, hosts, processes)


class Standing(Network):
    """A network that is what it is told to be, and keeps what it is asked for."""

    def __init__(self, *processes: ProcessStatus) -> None:
        self.now = snapshot(*processes)
        self.asked: list[RestartRequested | EndRequested | StopRequested] = []
        self.refusal = ""
        """Why nothing is done that is asked for."""
        self.scouts: dict[str, Callable[[], Scout]] = {}
        """What starts one, by the host."""
        self.started: list[Scout] = []

    def snapshot(self) -> Snapshot:
        return self.now

    def ask(self, event: RestartRequested | EndRequested | StopRequested) -> None:
        if self.refusal:
            raise DeploymentError(self.refusal)
        self.asked.append(event)

    def scout(self, host: str) -> Scout:
        if host not in self.scouts:
            raise HostUnreachable(f"{host} is out of reach: its cable was cut")
        self.started.append(self.scouts[host]())
        return self.started[-1]

    def cut(self) -> None:
        """Lose all hosts."""
        self.scouts.clear()
        for each in self.started:
            each.end("base is out of reach: its cable was cut", is_lost=True)
