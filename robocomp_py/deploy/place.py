"""The folder of a running network on each of its hosts, and the lock that has it run only once.

    <run-time folder>/deploy/<network>/pid            locked while it runs, however it ends; the process that runs it
                                       control        control socket for other commands
                                       plan.json      what runs
                                       leftovers      what was started, for the cleanup after a killed launcher
                                       notify/        sockets at which processes say how they are
                                       logs/          their output, unless the run keeps it elsewhere; and the
                                                      file `newest`: where the newest run keeps it
                                       rcdeploy.err   Python's own errors while it runs without a terminal

The run-time folder is that of `transports/directory.py`.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

from ..errors import ConfigurationError, DeploymentError
from .launcher import traces

M = TypeVar("M")

_TRIES, _PAUSE = 10, 0.03
"""Number of attempts to lock while the network's runner lives, since it may be ending."""

_TRIES_WITHOUT_RUNNER = 170
"""Number of attempts otherwise, for five seconds: a command that looks for the runner holds the lock for a moment, and
so does a cleanup after a killed runner; either may be held up."""


class AlreadyRuns(DeploymentError):
    """This network is running here."""


@dataclass(frozen=True, slots=True)
class Runner:
    """The process that runs a network."""

    pid: int
    since: float = 0.0
    """Seconds since the Unix epoch."""
    command: str = ""

    @property
    def is_there(self) -> bool:
        """Whether it is known, and lives. If not, the lock is held only briefly, or could not be written to."""
        trace = traces.look(self.pid)
        return trace is not None and trace.state != "Z"


@dataclass(frozen=True, slots=True)
class Run:
    """Where a run of a network keeps what its components print."""

    logs: Path
    began: float
    """Seconds since the Unix epoch; older lines in the same files are of earlier runs."""


def file_name(instance: str) -> str:
    """The beginning of an instance's file names: `left.arm` for `left/arm`. Never a path, whatever its name."""
    return re.sub(r"[^A-Za-z0-9_.-]", "_", instance.replace("/", ".")).lstrip(".") or "_"


def made_in(folder: Path, make: Callable[[], M], tries: int = 10) -> M:
    """Makes something in a folder, and the folder if it is missing. Raises OSError.

    A process that is just ending may remove the folder while it is empty; a file in it keeps the folder.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        return make()
    except (FileNotFoundError, FileExistsError):
        if tries <= 1:
            raise
    return made_in(folder, make, tries - 1)


class Place:
    """The folder of one network; `take` creates it."""

    def __init__(self, network: str, folder: Path | None = None) -> None:
        """Raises DeploymentError if there can be no run-time folder."""
        self.network = network
        self.folder = folder / file_name(network) if folder else _deployment(file_name(network))
        self._held = -1

    @property
    def control(self) -> Path:
        return self.folder / "control"

    @property
    def plan(self) -> Path:
        return self.folder / "plan.json"

    @property
    def leftovers(self) -> Path:
        return self.folder / "leftovers"

    @property
    def notify(self) -> Path:
        return self.folder / "notify"

    @property
    def logs(self) -> Path:
        return self.folder / "logs"

    @property
    def newest(self) -> Path:
        return self.logs / "newest"

    @property
    def complaints(self) -> Path:
        return self.folder / "rcdeploy.err"

    def take(self, command: str = "") -> None:
        """Become the runner of this network, until `release` or the end of this process.

        Raises AlreadyRuns, or DeploymentError if nothing can be written there.
        """
        self._take()
        told = json.dumps(asdict(Runner(os.getpid(), time.time(), command)))
        with contextlib.suppress(OSError):  # on a full disk; the lock holds without it
            os.ftruncate(self._held, 0)
            os.pwrite(self._held, told.encode(), 0)

    def clear(self) -> None:
        """Remove what a killed launcher has left, without becoming the runner. Raises as `take` does."""
        self._take()
        self.release()

    def runner(self) -> Runner | None:
        """The process that runs it now; None if it is not running."""
        try:
            probe = os.open(self._lock, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
        except OSError:
            return None
        try:
            fcntl.flock(probe, fcntl.LOCK_SH | fcntl.LOCK_NB)
            return None
        except BlockingIOError:
            return _read(os.pread(probe, 65536, 0))
        finally:
            os.close(probe)

    def leave_plan(self, text: str) -> None:
        """Write the plan for other commands; they see all of it, or nothing. Raises OSError."""
        _replace(self.plan, text)

    def leave_run(self, run: Run) -> None:
        """Note where this run keeps its output. The note stays when the run has ended. Raises OSError."""
        self.logs.mkdir(mode=0o700, exist_ok=True)
        _replace(self.newest, json.dumps({"logs": str(run.logs.absolute()), "began": run.began}))

    def last_run(self) -> Run | None:
        """The newest run, whether it has ended or not; None if it is unknown."""
        try:
            found = json.loads(self.newest.read_text(encoding="utf-8"))
            return Run(Path(found["logs"]), float(found["began"]))
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def release(self) -> None:
        """Let others run it. Removes all but logs and errors. May be called twice."""
        if self._held < 0:
            return
        for each in (self.control, self.plan, self.leftovers):
            with contextlib.suppress(OSError):
                each.unlink()
        with contextlib.suppress(OSError):  # usually there is none
            if not self.complaints.stat().st_size:
                self.complaints.unlink()
        shutil.rmtree(self.notify, ignore_errors=True)
        with contextlib.suppress(OSError):  # the last step: a later file belongs to another process
            self._lock.unlink()
        os.close(self._held)
        self._held = -1
        for folder in (self.folder, self.folder.parent):
            with contextlib.suppress(OSError):  # there are logs in it, or other networks
                folder.rmdir()

    @property
    def _lock(self) -> Path:
        return self.folder / "pid"

    def _take(self) -> None:
        for tried in range(_TRIES_WITHOUT_RUNNER):
            try:
                held = made_in(self.folder, self._opened)
            except OSError as exc:
                raise DeploymentError(f"{self.folder}: {exc.strerror}; set ROBOCOMP_RUNTIME_DIR") from exc
            if _lock(held, self._lock):
                self._held = held
                return
            runner = _read(os.pread(held, 65536, 0))
            os.close(held)
            if tried >= _TRIES and runner.is_there:
                break
            time.sleep(_PAUSE)
        raise AlreadyRuns(self._taken())

    def _opened(self) -> int:
        return os.open(self._lock, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)

    def _taken(self) -> str:
        runner = self.runner()
        runs = f"process {runner.pid}" if runner and runner.pid else "another process"
        how = f" ({runner.command})" if runner and runner.command else ""
        end = f"rcdeploy down {self.network}" + (f", or kill {runner.pid}" if runner and runner.pid else "")
        return f"{self.network} is already running: {runs}{how}; to end it: {end}"


def running(deployments: Path, look: Callable[[Mapping[str, Any]], M]) -> Iterator[tuple[str, M]]:
    """The networks that run here, by name, each with what `look` makes of its plan, which is JSON."""
    for path in sorted(deployments.glob("*/plan.json")):
        try:
            told = json.loads(path.read_text(encoding="utf-8"))
            name, found = str(told["name"]), look(told)
            if Place(name, deployments).runner():
                yield name, found
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            continue  # it is ending, or is of another version


def _replace(path: Path, text: str) -> None:
    """Write a file that readers see whole, or as it was before. Raises OSError."""
    draft = path.with_suffix(".new")
    try:
        draft.write_text(text, encoding="utf-8")
        draft.replace(path)
    except OSError:  # on a full disk
        with contextlib.suppress(OSError):
            draft.unlink()
        raise


def _lock(held: int, path: Path) -> bool:
    """Whether the file is locked by this process, and still the one of that name: a released lock file is removed."""
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return os.path.samestat(os.fstat(held), path.stat())
    except OSError:
        return False


def _deployment(name: str) -> Path:
    from ..transports.runtime_folder import runtime_dir  # the keeper is told where, and starts sooner without

    try:
        return runtime_dir("deploy", name)
    except ConfigurationError as exc:
        raise DeploymentError(str(exc)) from exc


def _read(told: bytes) -> Runner:
    """The content of the lock, which another version may have written; it may be empty."""
    try:
        found = json.loads(told)
        return Runner(int(found["pid"]), float(found["since"]), str(found["command"]))
    except (ValueError, TypeError, KeyError):
        return Runner(0)
