"""Networks that stand still, for what asks them how they are."""

from __future__ import annotations

from robocomp_py.deploy.policy import RestartRequested, State, StopRequested
from robocomp_py.deploy.snapshot import HostStatus, ProcessStatus, Snapshot
from robocomp_py.errors import DeploymentError


def process(name: str, state: State = State.READY, *, starts: int = 1, host: str = "", how: str = "") -> ProcessStatus:
    runs = state in (State.STARTING, State.READY, State.STOPPING)
    return ProcessStatus(
        name=name,
        component=name.rpartition("/")[2].capitalize(),
        instances=(name,),
        ended=(),
        host=host,
        state=state,
        how=how,
        pid=4321 if runs else None,
        in_state=12.0,
        uptime=12.0 if runs else None,
        next_start=None,
        starts=starts,
        restarts=starts - 1,
        cpu=0.25 if runs else None,
        memory=50_000_000 if runs else None,
        calls=None,
        worst=None,
        status="",
    )


def snapshot(*processes: ProcessStatus, hosts: tuple[HostStatus, ...] = ()) -> Snapshot:
    return Snapshot(
        network="home",
        up=all(each.state is State.READY for each in processes),
        stopping=any(each.state is State.STOPPING for each in processes),
        why="",
        uptime=60.0,
        hosts=hosts,
        processes=processes,
    )


class Standing:
    """A network that is what it is told to be, and keeps what it is asked for."""

    def __init__(self, *processes: ProcessStatus) -> None:
        self.now = snapshot(*processes)
        self.asked: list[RestartRequested | StopRequested] = []
        self.refusal = ""
        """Why nothing is done that is asked for."""

    def snapshot(self) -> Snapshot:
        return self.now

    def ask(self, event: RestartRequested | StopRequested) -> None:
        if self.refusal:
            raise DeploymentError(self.refusal)
        self.asked.append(event)
