"""What happens to the processes of a network, and what the supervisor wants done; see `policy`."""

from __future__ import annotations

from dataclasses import dataclass

# Events.


@dataclass(frozen=True, slots=True)
class Ready:
    name: str


@dataclass(frozen=True, slots=True)
class Hung:
    """It does not answer its watchdog any more, and is being ended for that."""

    name: str


@dataclass(frozen=True, slots=True)
class Exited:
    """`code` is negative for a signal, as in subprocess."""

    name: str
    code: int


@dataclass(frozen=True, slots=True)
class Left:
    """An instance has ended whose process goes on."""

    instance: str


@dataclass(frozen=True, slots=True)
class StopRequested:
    """A user or a time limit ends the network. `code` is the exit code if nothing failed; 0 for the time limit."""

    code: int = 0
    grace: float | None = None
    """Seconds that each process has to end, whatever the network says; 0 kills what is left."""
    why: str = "asked to"


@dataclass(frozen=True, slots=True)
class RestartRequested:
    """A user wants these (instances, processes or systems) to be started again."""

    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class EndRequested:
    """A user wants these (instances, processes or systems) to end, and to be started again only on request."""

    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Lost:
    """A host is out of reach, and its processes with it."""

    host: str
    why: str = ""


@dataclass(frozen=True, slots=True)
class Back:
    """A lost host is within reach again; what is to run there is to be started."""

    host: str


@dataclass(frozen=True, slots=True)
class Tick:
    """Nothing but time has passed: `Supervisor.wake` has come."""


Event = Ready | Hung | Exited | Left | StopRequested | RestartRequested | EndRequested | Lost | Back | Tick


# Actions.


@dataclass(frozen=True, slots=True)
class Start:
    name: str


@dataclass(frozen=True, slots=True)
class Stop:
    name: str


@dataclass(frozen=True, slots=True)
class Kill:
    name: str


@dataclass(frozen=True, slots=True)
class Finish:
    code: int


@dataclass(frozen=True, slots=True)
class Retry:
    """To be reported: this process will be started again after `seconds`."""

    name: str
    seconds: float


@dataclass(frozen=True, slots=True)
class GaveUp:
    """To be reported: this process has used up its restarts."""

    name: str
    restarts: int


@dataclass(frozen=True, slots=True)
class Along:
    """To be reported: these are stopped for the sake of another one, and started `again`, or not."""

    names: tuple[str, ...]
    sake: str
    again: bool


@dataclass(frozen=True, slots=True)
class Stuck:
    """To be reported: this process was killed, but has not ended."""

    name: str


Action = Start | Stop | Kill | Finish | Retry | GaveUp | Along | Stuck
