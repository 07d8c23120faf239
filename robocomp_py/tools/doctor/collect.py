"""Reads the facts: from the operating system, from what processes announce, and from components' answers."""

from __future__ import annotations

import contextlib
import os
import platform
import re
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...errors import RobocompError
from ...transports import directory
from ...transports.deployment import deployment_of, deployments
from ...transports.runtime_folder import runtime_dir
from .. import asking
from ..access import Access
from ..census import Seen, take_each
from ..network import End, Network
from ..posts import Post
from . import elsewhere
from .facts import Asked, Complaints, Facts, Launched, Left, Machine, Place, Process, Space, Used

_PATIENCE = 1.0
"""Seconds that a component has for an answer."""

_PROC = Path("/proc")


def collect(
    middlewares: Sequence[str] = (),
    plans: Sequence[Mapping[str, Any]] = (),
    killed_networks: Sequence[str] = (),
    launched: Sequence[Launched] = (),
    complaints: Sequence[Complaints] = (),
    *,
    look: Callable[[Sequence[str]], Seen] = take_each,
    posts: Sequence[Post] = (),
    here: bool = True,
) -> tuple[Facts, list[str]]:
    """The facts, and what could not be looked at. Takes at most a second for each component that does not answer.

    `look` tells what runs, of the hosts of `posts`, too; unless it is `here`, nothing of this machine is looked at.
    """
    names = list(middlewares or deployments())
    left = leftovers(names) if here else []  # before anything is opened, which would remove them
    there = elsewhere.left_there(posts, names) if posts else {}
    seen = look(names)
    places, troubles = elsewhere.places(there, names, seen)
    network = Network(seen.ends)
    machine_here = Machine()
    if here:
        pids = {end.told.pid for end in seen.ends if not end.host}
        machine_here = machine(pids, memory=shared_memory(seen.tellers[""]))
    return (
        Facts(
            platform.node(),
            machine_here,
            network,
            tuple(_asked(network, places)),
            tuple(left),
            tuple(killed_networks),
            tuple(plans),
            tuple(launched),
            tuple(complaints),
            seen.tellers,
            tuple(places),
        ),
        [*seen.troubles, *troubles],
    )


def _asked(network: Network, places: Iterable[Place]) -> Iterable[Asked]:
    hosts = asking.hosts(network)
    states = {(place.host, each.pid): each.state for place in places for each in place.machine.processes}
    with Access() as access:
        for name in asking.components(network):
            yield replace(_answers(access, network, name, states), host=hosts.get(name, ""))


def _answers(access: Access, network: Network, name: str, states: Mapping[tuple[str, int], str]) -> Asked:
    """`states` are those of processes on other hosts."""
    description = asking.describe(access, network, name, _PATIENCE)
    if description is None:
        host, pid = next((each.process for each in _ends_of(network, name)), ("", 0))
        state = states.get((host, pid), "") if host else directory.state_of(pid)
        return Asked(name, pid, state if pid else "")
    before, begun = time.time(), time.monotonic()
    measures = asking.measure(access, network, name, _PATIENCE)
    took = time.monotonic() - begun
    offset = measures.at / 1e9 - (before + took / 2) if measures else None
    return Asked(name, description.pid, "", description, measures, offset, took / 2)


def _ends_of(network: Network, component: str) -> list[End]:
    stock = network.stock(asking.INTERFACE)
    return [end for each in stock if each.name.startswith(f"{component}/") for end in each.providers]


# The operating system.


def shared_memory(middlewares: Iterable[str]) -> Path | None:
    """Where the shared memory is that one of these middlewares uses; None without one."""
    found = (deployment_of(name).shared_memory for name in middlewares)
    return next((Path(each) for each in found if each), None)


def machine(
    pids: Iterable[int],
    proc: Path = _PROC,
    memory: Path | None = None,
    statvfs: Callable[[Path], os.statvfs_result] = os.statvfs,
) -> Machine:
    """The limits and the space of this machine; `memory` is where its shared memory is, if it is of use."""
    processes = [found for pid in sorted(pids) if (found := _process(proc, pid))]
    instances, watches = _inotify(proc)
    shared = _space(memory, "messages in shared memory", statvfs) if memory else None
    return Machine(
        tuple(processes),
        Used(instances, _number(proc / "sys/fs/inotify/max_user_instances")),
        Used(watches, _number(proc / "sys/fs/inotify/max_user_watches")),
        shared,
        str(memory) if memory and not shared else "",
        tuple(_disks(statvfs)),
    )


def _disks(statvfs: Callable[[Path], os.statvfs_result]) -> Iterable[Space]:
    seen: set[int] = set()
    with contextlib.suppress(RobocompError, OSError):
        for path, purpose in (
            (runtime_dir(), "sockets, directory entries and logs"),
            (Path(tempfile.gettempdir()), "temporary files"),
        ):
            device = path.stat().st_dev
            if device not in seen and (found := _space(path, purpose, statvfs)):
                seen.add(device)
                yield found


def _space(path: Path, purpose: str, statvfs: Callable[[Path], os.statvfs_result]) -> Space | None:
    try:
        found = statvfs(path)
    except OSError:
        return None
    unit = found.f_frsize
    return Space(str(path), purpose, found.f_blocks * unit, found.f_bavail * unit, found.f_files, found.f_favail)


def _process(proc: Path, pid: int) -> Process | None:
    """None if it is on another host, or of another user."""
    try:
        limits = (proc / str(pid) / "limits").read_text()
        number = len(os.listdir(proc / str(pid) / "fd"))
    except OSError:
        return None
    found = re.search(r"^Max open files\s+(\d+)", limits, re.MULTILINE)
    return Process(pid, number, int(found[1]) if found else 0, directory.state_of(pid, proc))


def _inotify(proc: Path) -> tuple[int, int]:
    """The instances and watches that processes of this user have, as far as they may be seen."""
    instances = watches = 0
    for folder in proc.glob("[0-9]*"):
        with contextlib.suppress(OSError):
            for each in os.scandir(folder / "fd"):
                with contextlib.suppress(OSError):
                    if "inotify" in os.readlink(each.path):
                        instances += 1
                        watches += (folder / "fdinfo" / each.name).read_text().count("inotify wd:")
    return instances, watches


def _number(path: Path) -> int:
    try:
        return int(path.read_text())
    except (OSError, ValueError):
        return 0


# Leftovers.


def leftovers(middlewares: Iterable[str]) -> list[Left]:
    """What killed processes have left on this host."""
    found = []
    for name in middlewares:
        with contextlib.suppress(RobocompError, OSError):
            living, dead = directory.members_of(runtime_dir(name))
            memory = 0 if living else len(deployment_of(name).memory_files())
            if dead or memory:
                found.append(Left(name, living, dead, memory))
    return found
