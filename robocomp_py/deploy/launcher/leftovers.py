"""What a launch has started, on disk: for the process that cleans up after launcher and keeper were killed.

    {"launch": mark, "boot": …, "cgroup": …}        then one line for each process: {"pid": …, "started": …}

A process is ended only if its id and its start time are those written down, or it carries the launch's mark: never
a stranger that got the id. Standard library only.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from . import cgroups, traces

GRACE = 3.0
"""Seconds that leftovers have to end by themselves."""

_COMPACT = 1 << 20
"""Bytes from which on the file is written anew, without processes that have ended."""


@dataclass
class Leftovers:
    launch: str = ""
    boot: str = ""
    cgroup: str = ""
    processes: dict[int, int] = field(default_factory=dict)
    """Start times by process id."""

    def alive(self) -> list[traces.Trace]:
        """The living ones among them, and among the processes that they started."""
        known = [trace for pid, at in self.processes.items() if (trace := traces.look(pid)) and trace.started == at]
        found = {each.pid: each for each in known if each.state != "Z"}
        inside = filter(None, map(traces.look, cgroups.members(Path(self.cgroup)))) if self.cgroup else ()
        found |= {each.pid: each for each in inside if each.state != "Z"}
        found |= {each.pid: each for each in traces.marked(self.launch)} if self.launch else {}
        return [each for each in found.values() if each.pid != os.getpid()]

    def end(self, grace: float = GRACE, within: float = 5.0) -> int:
        """End all of them, first gently; how many there were. Blocks for `grace` and `within` seconds at most."""
        if self.boot != traces.boot():
            return 0  # the machine was started anew
        found = self.alive()
        traces.send_all(found, signal.SIGTERM)
        _until(lambda: not [each for each in found if traces.is_still(each.pid, each.started)], grace)
        if self.cgroup:
            cgroups.kill(Path(self.cgroup))
        _until(lambda: not traces.send_all(self.alive(), signal.SIGKILL), within)
        if self.cgroup:
            cgroups.end(Path(self.cgroup))
        return len(found)

    def until_waited_for(self) -> None:
        """Wait, at most 5 s, until their parents have reaped them: a zombie counts as having its files open."""

        def is_there(pid: int, started: int) -> bool:
            trace = traces.look(pid)
            return trace is not None and trace.started == started

        _until(lambda: not any(is_there(*each) for each in self.processes.items()), 5.0)


class Record:
    """The file of a running launch."""

    def __init__(self, path: Path, launch: str, cgroup: Path | None) -> None:
        """Raises OSError."""
        self._path = path
        self.content = Leftovers(launch, traces.boot(), str(cgroup or ""))
        self._file = os.open(path, os.O_CREAT | os.O_TRUNC | os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC, 0o600)
        self._write(_head(self.content))

    def add(self, pid: int, started: int) -> None:
        self.content.processes[pid] = started
        self._write({"pid": pid, "started": started})
        with contextlib.suppress(OSError):
            if os.fstat(self._file).st_size > _COMPACT:
                self._compact()

    def remove(self, pid: int) -> None:
        """It has ended. The file may keep its line: the start time shows that the id is stale."""
        self.content.processes.pop(pid, None)

    def close(self) -> None:
        os.close(self._file)
        with contextlib.suppress(OSError):
            self._path.unlink()

    def _compact(self) -> None:
        os.ftruncate(self._file, 0)
        self._write(_head(self.content))
        for pid, started in self.content.processes.items():
            self._write({"pid": pid, "started": started})

    def _write(self, line: dict[str, object]) -> None:
        with contextlib.suppress(OSError):  # on a full disk; the keeper, the mark and the group know them, too
            os.write(self._file, json.dumps(line).encode() + b"\n")


def _head(content: Leftovers) -> dict[str, object]:
    return {"launch": content.launch, "boot": content.boot, "cgroup": content.cgroup}


def load(path: Path) -> Leftovers | None:
    """What a launch left that did not end well; None if there is none. Broken lines are skipped."""
    try:
        lines = path.read_text(errors="replace").splitlines()
    except OSError:
        return None
    found = Leftovers()
    for line in lines:
        with contextlib.suppress(ValueError, TypeError, KeyError):
            told = json.loads(line)
            if "launch" in told:
                found.launch, found.boot, found.cgroup = (str(told[key]) for key in ("launch", "boot", "cgroup"))
            else:
                found.processes[int(told["pid"])] = int(told["started"])
    return found


def _until(condition: Callable[[], bool], seconds: float) -> None:
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.03)
