"""What /proc tells of processes: which ones this launcher started, even if the processes in between are gone.

A started process carries a mark in its environment, which its children inherit. A process is identified by its id and
its start time, since ids are reused. Standard library only.
"""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

LAUNCH = "ROBOCOMP_LAUNCH"
"""The environment variable with the mark of the launch, the same for all that it started."""

NAME = "ROBOCOMP_LAUNCHED_AS"
"""The environment variable with the name of the process in its network."""


@dataclass(frozen=True, slots=True)
class Trace:
    """A process as it was when /proc was read."""

    pid: int
    state: str
    parent: int
    session: int
    started: int
    """Ticks from the start of the machine."""
    cpu_ticks: int = 0
    memory_pages: int = 0


def boot() -> str:
    """Identifies the current start of the machine; process ids and start times are valid for one only."""
    with contextlib.suppress(OSError), open("/proc/sys/kernel/random/boot_id") as told:
        return told.read().strip()
    return ""


def look(pid: int) -> Trace | None:
    """None if there is no such process."""
    try:
        return read(pid, content(f"/proc/{pid}/stat"))
    except (OSError, ValueError, IndexError):
        return None


def content(path: str) -> bytes:
    """The content of a short file of /proc. Raises OSError."""
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)  # half the cost of a file object
    try:
        return os.read(file, 4096)
    finally:
        os.close(file)


def read(pid: int, stat: bytes) -> Trace:
    """A line of /proc/PID/stat. The name in it may contain anything."""
    words = stat[stat.rindex(b")") + 2 :].split()
    numbers = [int(words[at]) for at in (1, 3, 19, 11, 12, 13, 14, 21)]
    parent, session, started, *ticks, pages = numbers
    return Trace(pid, words[0].decode(), parent, session, started, sum(ticks), pages)


def all_processes() -> Iterator[Trace]:
    with os.scandir("/proc") as entries:
        pids = [int(entry.name) for entry in entries if entry.name.isdecimal()]
    for pid in pids:
        trace = look(pid)
        if trace:
            yield trace


def environment(pid: int) -> Mapping[str, str]:
    """The environment that it was started with; empty if it may not be read, or the process has ended."""
    try:
        with open(f"/proc/{pid}/environ", "rb") as told:
            lines = told.read().split(b"\0")
    except OSError:
        return {}
    return dict(os.fsdecode(line).split("=", 1) for line in lines if b"=" in line)


def marked(launch: str) -> list[Trace]:
    """All living processes that a launch has started, directly or not."""
    return [each for each in all_processes() if each.state != "Z" and environment(each.pid).get(LAUNCH) == launch]


def family(names: Mapping[str, int], launch: str) -> dict[str, list[Trace]]:
    """The living descendants of processes, by name; `names` has the id of each process.

    They are found by session, by descent, and, if their parents are gone, by environment.
    """
    living = {each.pid: each for each in all_processes() if each.state != "Z"}
    heads = {pid: name for name, pid in names.items()}
    found: dict[str, list[Trace]] = {name: [] for name in names}
    for each in living.values():
        if each.pid in heads:
            continue
        name = heads.get(each.session) or next((heads[above] for above in _above(each, living) if above in heads), None)
        if name is None and each.parent in (1, os.getpid()):
            told = environment(each.pid)
            name = told.get(NAME) if told.get(LAUNCH) == launch else None
        if name in found:
            found[name].append(each)
    return found


def _above(trace: Trace, living: Mapping[int, Trace]) -> Iterator[int]:
    seen: set[int] = set()
    while trace.parent in living and trace.parent not in seen:
        seen.add(trace.parent)
        yield trace.parent
        trace = living[trace.parent]


def is_still(pid: int, started: int) -> bool:
    """Whether it is that process, and lives."""
    trace = look(pid)
    return trace is not None and trace.started == started and trace.state not in ("Z", "X")


def send(pid: int, started: int, number: signal.Signals) -> bool:
    """Signal a process and its group, unless its id was reused. Returns whether it lives."""
    try:
        handle = os.pidfd_open(pid)
    except OSError:
        return False
    try:
        if not is_still(pid, started):
            return False
        with contextlib.suppress(OSError):
            if os.getpgid(pid) == pid:
                os.killpg(pid, number)
            signal.pidfd_send_signal(handle, number)
        return True
    finally:
        os.close(handle)


def send_all(traces: Iterable[Trace], number: signal.Signals) -> bool:
    """Whether any of them lives."""
    return any([send(each.pid, each.started, number) for each in traces])
