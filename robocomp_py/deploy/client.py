"""Queries and controls a running network, for `rcdeploy status|logs|restart|stop|start|down`.

Blocking, with a deadline on every wait, and quick to import. `control.py` answers.
"""

from __future__ import annotations

import contextlib
import json
import re
import socket
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from ..closing import Closing
from ..errors import DeploymentError, HostUnreachable
from ..runtime.records import record_of
from ..transports.runtime_folder import runtime_dir
from .agents import Life
from .naming import meant
from .place import Place
from .policy import State
from .ring import MOST_LINES, Line
from .snapshot import HostStatus, ProcessStatus, Snapshot
from .sockets import connected

ANSWER_TIMEOUT_S = 5.0
"""Seconds within which a controller answers; none of its other work takes long."""

AGAIN_S = 5.0
"""Seconds for which a connection that is lost before the answer is made again."""

LOOK_S = 0.1
"""Seconds between two checks of progress."""

_LATE_S = 60.0
"""Seconds without progress while a network stops, beyond the grace of its processes."""

_LISTEN_S = 0.5
"""Seconds of one wait: a signal just before an endless wait would not end it."""

_COMING_S = 3.0
"""Seconds for which a starting or ending network may have no socket."""

_LONGEST_QUESTION = 60_000
"""Octets of a question to a scout."""

_WORDS = re.compile(r"//[^\n]*|/\*.*?\*/|\"(?:[^\"\\\n]|\\.)*\"|\bDeployment\s+(\w+)", re.DOTALL)


class NotRunning(DeploymentError):
    """This network is not running."""


class Stuck(DeploymentError):
    """Something did not come in time."""


def network_of(text: str) -> str:
    """The name of a network by its file, or by itself. Raises DeploymentError, with what to do.

    The file is only looked into, not checked: it may be half changed while the network runs.
    """
    path = Path(text)
    if re.fullmatch(r"\w+", text) and not path.is_file():
        return text
    try:
        found = _WORDS.finditer(path.read_text(encoding="utf-8", errors="replace"))
    except OSError as exc:
        from ..spelling import beside  # most commands do without

        near = beside(path) if isinstance(exc, FileNotFoundError) else None
        hint = f"did you mean `{near}`?" if near else "give it a network (.ddsl)"
        raise DeploymentError(f"{path} cannot be read: {exc.strerror}; {hint}") from exc
    name = next((each[1] for each in found if each[1]), "")
    if not name:
        raise DeploymentError(f"{path} is not a network: it has no `Deployment`")
    return name


def networks() -> list[str]:
    """The names of this user's networks that run on this machine."""
    folder = runtime_dir("deploy")
    return [each.name for each in sorted(folder.glob("*")) if each.is_dir() and Place(each.name).runner()]


def not_running(network: str, advice: str = "") -> str:
    """The message for a network that does not run here, with advice, and the one that was meant, or those that do."""
    from ..spelling import and_then, closest  # most commands do without

    running = networks()
    near = closest(network, running)
    told = f"network `{network}` is not running on this machine" + (f"; did you mean `{near}`?" if near else "")
    told = and_then(told, advice) if advice else told
    return f"{told}; running: {', '.join(running)}" if running and not near else told


def running_plan(network: str) -> dict[str, Any] | None:
    """The plan that a network runs by, as JSON; None if it does not run, or is only just beginning or ending.

    Raises DeploymentError.
    """
    place = Place(network)
    if place.runner() is None:
        return None
    try:
        found = json.loads(place.plan.read_text(encoding="utf-8"))
    except FileNotFoundError:  # its runner writes it once it can be asked, and removes it before it ends
        return None
    except (OSError, ValueError) as exc:
        raise DeploymentError(f"network `{network}` runs, but its plan cannot be read: {place.plan}: {exc}") from exc
    return found if isinstance(found, dict) else {}


class NoSocket(Stuck):
    """A network runs and has no control socket: it is starting or ending."""


class Connection(Closing):
    """A connection to the rcdeploy that runs a network; to be closed.

    Raises NotRunning if the network does not run, NoSocket or Stuck if it runs and does not answer. Nothing is
    concluded from a lost connection alone: whether the network runs is told by the lock that its rcdeploy holds.
    """

    def __init__(self, network: str) -> None:
        self.network = network
        self._socket = _connect(Place(network))
        self._rest = b""
        self._is_ended = False
        self.meanwhile: Callable[[], object] = lambda: None
        """Called every 0.5 s while an answer is awaited, however long that takes."""

    def close(self) -> None:
        self._socket.close()

    def end(self) -> None:
        """Let a thread that waits for answers of this connection go on, as if the network had ended."""
        self._is_ended = True
        with contextlib.suppress(OSError):  # the other side has closed it
            self._socket.shutdown(socket.SHUT_RDWR)

    @property
    def is_ended(self) -> bool:
        """Whether `end` was called."""
        return self._is_ended

    def writing(self) -> socket.socket:
        """The same connection, for a thread that writes while another one reads; to be closed."""
        made = self._socket.dup()
        made.settimeout(ANSWER_TIMEOUT_S)
        return made

    def ask(self, do: str, **more: Any) -> dict[str, Any]:
        """Send a command. Raises DeploymentError, with the reason, if it is refused.

        A connection that is lost before the answer is made again: other clients may have taken its place. A request
        that rcdeploy has read is always answered, so none is carried out twice.
        """
        end = time.monotonic() + AGAIN_S
        while True:
            if self._told(do, **more) and (answer := self.answer(ANSWER_TIMEOUT_S)) is not None:
                return answer
            self._retry_until(end)

    def tell(self, do: str, **more: Any) -> None:
        """Send a request. Raises the same errors as making a connection."""
        end = time.monotonic() + AGAIN_S
        while not self._told(do, **more):
            self._retry_until(end)

    def _retry_until(self, end: float) -> None:
        """Make a new connection after a pause. Raises Stuck after `end`, and what making a connection raises."""
        if time.monotonic() > end:
            self._insist_running()
            raise Stuck(self.crowded())
        time.sleep(LOOK_S)
        self._connect_again(_COMING_S)

    def _told(self, do: str, **more: Any) -> bool:
        """Send a request. Returns whether the connection still existed."""
        request = json.dumps({"do": do, **more}).encode() + b"\n"
        try:
            self._socket.settimeout(ANSWER_TIMEOUT_S)
            self._socket.sendall(request)
        except TimeoutError as exc:
            raise Stuck(self._stuck()) from exc
        except OSError:
            return False
        return True

    def _connect_again(self, coming_s: float) -> None:
        self._socket.close()
        self._rest = b""
        try:
            self._socket = _connect(Place(self.network), coming_s)
        except NotRunning as exc:
            raise NotRunning(f"network `{self.network}` has just ended") from exc

    def goes_on(self) -> bool:
        """After the other side has closed the connection: whether the network goes on. Then there is a new one."""
        if self._is_ended:
            return False
        try:
            self._connect_again(0.0)
        except (NotRunning, NoSocket):
            return False
        return True

    def _insist_running(self) -> None:
        if Place(self.network).runner() is None:
            raise NotRunning(f"network `{self.network}` has just ended")

    def crowded(self) -> str:
        return (
            f"network `{self.network}` runs{self._process()}, but it closed the connection to serve other clients: "
            f"too many programs connect to {Place(self.network).control}; end them, and try again"
        )

    def answer(self, timeout_s: float | None) -> dict[str, Any] | None:
        """The next answer; None if the other side has gone. Without patience: however long that takes."""
        end = time.monotonic() + timeout_s if timeout_s is not None else None
        while b"\n" not in self._rest:
            left = _LISTEN_S if end is None else end - time.monotonic()
            try:
                if left <= 0:
                    raise TimeoutError
                self._socket.settimeout(left)
                chunk = self._socket.recv(1 << 16)
            except TimeoutError as exc:
                if end is None:
                    self.meanwhile()
                    continue
                raise Stuck(self._stuck()) from exc
            except ConnectionError:
                return None
            if not chunk:
                return None
            self._rest += chunk
        line, _, self._rest = self._rest.partition(b"\n")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise (HostUnreachable if answer.get("unreachable") else DeploymentError)(answer["error"])
        return answer

    def status(self) -> Snapshot:
        return _snapshot(self.ask("status")["status"])

    def _stuck(self) -> str:
        runner = f"the process that runs network `{self.network}`{self._process()}"
        return f"{runner} does not answer: it is suspended or overloaded"

    def _process(self) -> str:
        runner = Place(self.network).runner()
        return f" (process {runner.pid})" if runner and runner.pid else ""


class ScoutLine:
    """A connection to a scout that starts with it, on another host of a running network; see `tools.posts`.

    One thread may read, while others write.
    """

    def __init__(self, network: str, host: str) -> None:
        """Raises HostUnreachable, and what making a connection raises."""
        self._host = host
        with contextlib.ExitStack() as end:
            self._connection = end.enter_context(Connection(network))
            self._connection.ask("scout", host=host)
            self._writing = self._connection.writing()
            end.pop_all()

    def say(self, message: Mapping[str, Any]) -> None:
        """Raises HostUnreachable if the connection is lost, or takes nothing, and DeploymentError if it is long."""
        data = json.dumps(message).encode() + b"\n"
        if len(data) > _LONGEST_QUESTION:
            raise DeploymentError(
                f"{self._host}: to another host, at most {_LONGEST_QUESTION} octets are sent at a time"
            )
        try:
            self._writing.sendall(data)
        except OSError as exc:
            raise HostUnreachable(f"{self._host}: its scout takes no questions: {exc.strerror or exc}") from exc

    def told(self) -> dict[str, Any] | None:
        """The next answer, or `{"dropped": NUMBER}`, however long it takes; None once this is closed.

        Raises HostUnreachable if the host is lost, and DeploymentError if its scout has ended otherwise, or says what
        is no answer.
        """
        answer = self._connection.answer(None)
        if answer is None:
            if self._connection.is_ended:
                return None
            raise HostUnreachable(f"{self._host}: the connection to the network that runs there was lost")
        if answer.get("end"):
            raise (HostUnreachable if answer.get("unreachable") else DeploymentError)(answer["why"])
        if "heard" not in answer:
            return answer
        try:
            said = json.loads(answer["heard"])
        except (ValueError, RecursionError) as exc:
            raise DeploymentError(f"{self._host}: the answer of its scout is not understood") from exc
        return said if isinstance(said, dict) else {}

    def close(self) -> None:
        """Let a thread that reads go on, too. Idempotent."""
        self._connection.end()

    def release(self) -> None:
        """Free the connection; called once no thread reads any more."""
        self._writing.close()
        self._connection.close()


def _connect(place: Place, coming_s: float = _COMING_S) -> socket.socket:
    end = time.monotonic() + coming_s
    while True:
        try:
            return connected(place.control, ANSWER_TIMEOUT_S)
        except TimeoutError as exc:
            raise Stuck(f"the process that runs network `{place.network}` does not answer") from exc
        except OSError as exc:
            if place.runner() is None:
                raise NotRunning(not_running(place.network)) from exc
            if time.monotonic() > end:
                raise NoSocket(f"network `{place.network}` is starting or stopping; try again") from exc
        time.sleep(LOOK_S)


def _snapshot(found: Any) -> Snapshot:
    try:
        processes = tuple(
            ProcessStatus(
                **each | {"instances": tuple(each["instances"]), "ended": tuple(each["ended"]),
                          "state": State(each["state"]),
                          "lives": {name: Life(**life) for name, life in each["lives"].items()}}
            )
            for each in found["processes"]
        )  # fmt: skip
        return Snapshot(
            **found | {"processes": processes, "hosts": tuple(HostStatus(**host) for host in found["hosts"])}
        )
    except (TypeError, KeyError, ValueError) as exc:
        raise _another_version() from exc


def _another_version() -> DeploymentError:
    return DeploymentError("the network is run by another version of rcdeploy, whose answers cannot be read")


# Commands that wait.


def restart(
    connection: Connection, names: Collection[str], timeout_s: float, tell: Callable[[list[str]], object]
) -> list[ProcessStatus]:
    """Restart processes, and wait until they are ready, or have ended. Returns their states.

    `tell` is called whenever the waiting ones change. Raises HostUnreachable, Stuck, or DeploymentError with
    the reason if it is refused.
    """
    before = {each.name: each.starts for each in _reachable(connection.status(), names)}
    connection.ask("restart", names=list(names))
    end, told = time.monotonic() + timeout_s, list[str]()
    while True:
        now = [each for each in connection.status().processes if each.name in before]
        missing = [each.name for each in now if not _has_come(each, before[each.name])]
        if not missing:
            return now
        if time.monotonic() > end:
            raise Stuck(f"not ready after {timeout_s:g} s: {', '.join(missing)}; see: rcdeploy logs")
        if missing != told:
            tell(missing)
            told = missing
        time.sleep(LOOK_S)


def to_start(connection: Connection, names: Collection[str]) -> list[str]:
    """The processes of `names` that do not run, or are about to end. Raises DeploymentError for an unknown name."""
    return [each.name for each in meant(names, connection.status().processes) if each.state in _IDLE]


_IDLE = frozenset({State.STOPPING, State.RESTARTING, State.LOST, State.ENDED, State.FAILED})


def stop(
    connection: Connection, names: Collection[str], tell: Callable[[list[str]], object]
) -> tuple[list[ProcessStatus], list[str]]:
    """Stop processes until they are started on request, and wait until they have ended.

    Returns their states, and which of them had ended before. `tell` is called whenever the waiting ones change.
    Raises HostUnreachable, Stuck, or DeploymentError with the reason if it is refused.
    """
    before = _reachable(connection.status(), names)
    ended = [each.name for each in before if each.state in _OVER]
    asked = {each.name for each in before}
    connection.ask("stop", names=list(names))
    timeout_s, told = _LATE_S + _longest_grace(connection.network), list[str]()
    end = time.monotonic() + timeout_s
    while True:
        now = [each for each in connection.status().processes if each.name in asked]
        there = [each.name for each in now if each.state not in _OVER]
        if not there:
            return now, ended
        if time.monotonic() > end:
            raise Stuck(f"not ended after {timeout_s:g} s: {', '.join(there)}; see: rcdeploy logs")
        if there != told:
            tell(there)
            told = there
        time.sleep(LOOK_S)


_OVER = frozenset({State.ENDED, State.FAILED})


def _reachable(snapshot: Snapshot, names: Collection[str]) -> list[ProcessStatus]:
    processes = meant(names, snapshot.processes)
    lost = {host.name: host for host in snapshot.hosts if not host.reachable}
    for each in processes:
        if each.host in lost:
            host = lost[each.host]
            raise HostUnreachable(f"{each.name} is on {host.name} ({host.address}), which is out of reach: {host.why}")
    return processes


def _has_come(process: ProcessStatus, starts: int) -> bool:
    return process.starts > starts and process.state in (State.READY, State.ENDED, State.FAILED)


def down(connection: Connection, grace_s: float | None, tell: Callable[[int, int], object]) -> None:
    """Stop a network, and wait until nothing of it is left.

    `tell` is called with the number of processes left, and of all, whenever that changes. Raises Stuck if it does not
    for longer than a process may take.
    """
    timeout_s = _LATE_S + (_longest_grace(connection.network) if grace_s is None else grace_s)
    connection.ask("down", **({} if grace_s is None else {"grace": grace_s}))
    place, last, end = Place(connection.network), -1, 0.0
    while place.runner() is not None:
        try:
            processes = connection.status().processes
            there = sum(not each.state.gone for each in processes)
        except (NotRunning, NoSocket):
            there, processes = 0, ()  # it only cleans up
        if there != last:
            last, end = there, time.monotonic() + timeout_s
            if processes:
                tell(there, len(processes))
        if time.monotonic() > end:
            raise Stuck(f"{there} processes of network `{connection.network}` have not ended after {timeout_s:g} s")
        time.sleep(LOOK_S)


def _longest_grace(network: str) -> float:
    """Seconds that a process of a network may have to end by itself."""
    try:
        processes = (running_plan(network) or {}).get("processes", ())
    except DeploymentError:  # on a full disk; the default timeout is enough for most networks
        return 0.0
    return max((float(each.get("grace") or 0.0) for each in processes), default=0.0)


def chosen_lines(
    connection: Connection, names: Collection[str], count: int, wanted: Callable[[Line], bool], *, follow: bool
) -> Iterator[Line]:
    """Like `lines`, but only those for which `wanted` is true: the newest `count` of them, followed by new ones."""
    past: deque[Line] | None = deque(maxlen=count)
    for line in _answers(connection, names, MOST_LINES, follow=follow, mark=True):
        if line is None:
            yield from past or ()
            past = None
        elif line.name and not wanted(line):
            continue
        elif past is None:
            yield line
        else:
            past.append(line)
    yield from past or ()


def lines(connection: Connection, names: Collection[str], count: int, *, follow: bool) -> Iterator[Line]:
    """The newest lines of processes, followed by new ones until the network ends.

    A line without a name says how many were lost.
    """
    return (line for line in _answers(connection, names, count, follow=follow) if line)


def _answers(
    connection: Connection, names: Collection[str], count: int, *, follow: bool, **more: bool
) -> Iterator[Line | None]:
    """None at the end of the past."""
    end, heard = time.monotonic() + AGAIN_S, False
    connection.tell("logs", names=list(names), count=count, follow=follow, **more)
    while True:
        answer = connection.answer(None if follow else ANSWER_TIMEOUT_S)
        if answer is None:
            if not connection.goes_on():
                return
            if heard or time.monotonic() > end:
                raise Stuck(connection.crowded())
            time.sleep(LOOK_S)
            connection.tell("logs", names=list(names), count=count, follow=follow, **more)
            continue
        heard = True
        if "end" in answer:
            return
        if "now" in answer:
            yield None
        elif "dropped" in answer:
            yield Line(time.time(), "", f"({answer['dropped']} lines were lost: they came faster than they were read)")
        elif "time" not in answer:
            raise _another_version()
        else:
            yield Line(answer["time"], answer["name"], answer["line"], record_of(answer.get("record")))
