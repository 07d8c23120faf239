"""The shared part of the exporters: the place of each process, names, and writing."""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any

from ...errors import DeploymentError
from ...runtime.effective import toml
from ...spelling import enumerated
from ...transports.network import Helper
from ...version import __version__
from ..plan import Host, Plan, Process
from ..policy import Restart, When
from ..relocation import places, relocate
from ..run import GRACE

APP, KEYS = "app", "keys"
"""The folders with the components and with their keys, beside the files that start them."""

RUNTIME = "/run/robocomp"
"""The run-time folder in containers."""

USER = 1000
"""The user id of components in containers."""

_MARK = "by rcdeploy export"
"""In the first line of each exported file."""

_OWNER = ".made-by-rcdeploy"
"""A file in each folder of copies, by which a later export knows that it may replace the folder."""

_LEFT_OUT = shutil.ignore_patterns("__pycache__", "*.pyc", ".*", "tests")


@dataclass(frozen=True)
class Export:
    """The files of an export, below the folder that the user names."""

    files: Mapping[PurePosixPath, str]
    copies: Mapping[PurePosixPath, Path] = field(default_factory=dict)
    """Files and folders to copy."""
    notes: tuple[str, ...] = ()
    """Settings of the network that the other engine ignores."""
    steps: tuple[str, ...] = ()
    """The next commands for the user."""


@dataclass(frozen=True)
class Site:
    """A machine and its processes."""

    name: str
    """"" for the only one."""
    host: Host | None
    processes: tuple[Process, ...]
    moved: Mapping[Path, str]
    keys: Mapping[str, Path] = field(default_factory=dict)
    """The folder of keys of each process, if the network has keys."""

    @property
    def folder(self) -> PurePosixPath:
        return PurePosixPath(self.name)

    def command(self, process: Process, python: str) -> tuple[str, ...]:
        return relocate(process, self.moved, python)

    def copies(self) -> dict[PurePosixPath, Path]:
        outermost = [path for path in self.moved if not any(other in path.parents for other in self.moved)]
        return {self.folder.joinpath(*PurePosixPath(self.moved[path]).parts[-2:]): path for path in outermost}


def sites_of(plan: Plan, below: Callable[[Host | None], str]) -> list[Site]:
    """The machines of a network, with their processes.

    `below` returns the folder that the components of a host are copied to; "" leaves them where they are.
    """
    known = {host.name: host for host in plan.hosts}
    names = dict.fromkeys(process.host for process in plan.processes)
    sites: list[Site] = []
    for name in names:
        processes = tuple(process for process in plan.processes if process.host == name)
        host = known.get(name)
        keys = {process.name: found for process in processes if (found := _keys(process))}
        first = name == ("" if "" in names else next(iter(names)))  # it also runs helpers of hosts without components
        helpers = [each for each in plan.helpers if each.host == name or (first and each.host not in names)]
        keys |= {each.name: Path(each.keys) for each in helpers if each.keys}
        moved: dict[Path, str] = {}
        if folder := below(host):
            apart = [
                replace(each, files=tuple(path for path in each.files if path != keys.get(each.name)))
                for each in processes
            ]
            kept = f"{folder.removesuffix(APP)}{KEYS}"
            moved = places(apart, folder) | {path: f"{kept}/{path.name}" for path in keys.values()}
        for helper in helpers:
            processes = _behind(_process(helper, moved, name), processes)
        shown = name or "localhost" if len(names) > 1 else ""
        sites.append(Site(shown, host, processes, moved, keys))
    return sites


def _keys(process: Process) -> Path | None:
    """The folder of its keys, which its command names; a foreign program may use this argument otherwise."""
    words = () if process.is_program else process.command
    return next((Path(folder) for word, folder in pairwise(words) if word == "--keys"), None)


def _relocated(value: Any, moved: Mapping[Path, str]) -> Any:
    """An option of a transport, with paths on the other machine in place of paths here."""
    if isinstance(value, Mapping):
        return {key: _relocated(each, moved) for key, each in value.items()}
    place = moved.get(Path(value).parent) if isinstance(value, str) else None
    return f"{place}/{Path(value).name}" if place else value


def _process(helper: Helper, moved: Mapping[Path, str], host: str) -> Process:
    """A process that runs a helper in place of `rcdeploy`."""
    key, options = f"transports.{helper.middleware}", _relocated(helper.options, moved)
    given = (part for name, value in options.items() for part in ("--set", f"{key}.{name}={toml(value)}"))
    command = (sys.executable, "-m", "robocomp_py.cli.rc", "host", helper.middleware, *given)
    return Process(helper.name, helper.title, command, Path.cwd(), host=host, restart=Restart(When.ALWAYS))


def _behind(first: Process, processes: Iterable[Process]) -> tuple[Process, ...]:
    """`first`, and the processes, which start after it."""
    return (first, *(replace(each, after=(first.name, *each.after)) for each in processes))


def heading(what: str, network: str) -> str:
    """The first line of an exported file, by which later exports recognize it."""
    return f"# {what}, made from {_one_line(network)} {_MARK} {__version__}; edits are lost when it is made again.\n"


def identifier(text: str, allowed: str) -> str:
    """A name of these characters, with dashes for all others."""
    return re.sub(rf"[^{allowed}]+", "-", text).strip("-.") or "x"


def unique(names: Iterable[str], allowed: str, spelt: Callable[[str], str] = str) -> dict[str, str]:
    """A usable name for each name, all different."""
    found: dict[str, str] = {}
    for name in names:
        wanted = identifier(spelt(name), allowed)
        made, number = wanted, 2
        while made in found.values():
            made, number = f"{wanted}-{number}", number + 1
        found[name] = made
    return found


def watches_itself(process: Process) -> bool:
    """Whether it feeds a watchdog. A helper reports only that it is ready."""
    return process.notifies and not process.is_program and not is_helper(process)


def is_helper(process: Process) -> bool:
    """Whether a transport needs it: names of instances have no dashes."""
    return "-" in process.name


def grace(process: Process) -> float:
    """Seconds it has to end by itself: its components end one after the other."""
    return process.grace if process.grace is not None else GRACE * len(process.instances)


def write_export(export: Export, folder: Path) -> None:
    """Write an export, over a former one, but over nothing else. Raises DeploymentError with what is in the way."""
    if folder.exists() and not folder.is_dir():
        raise DeploymentError(f"{folder} is a file; give a folder by -o")
    for name in export.files:
        path = folder / name
        if path.is_dir() or (path.exists() and not _is_ours(path)):
            raise DeploymentError(f"{path} was not made by rcdeploy; move it away, or give another folder by -o")
    apps = dict.fromkeys(folder / path.parent for path in export.copies)
    for app in apps:
        if app.exists() and not (app / _OWNER).is_file():
            raise DeploymentError(f"{app} was not made by rcdeploy; move it away, or give another folder by -o")
    try:
        for app in apps:
            _copy(app, {path.name: source for path, source in export.copies.items() if folder / path.parent == app})
        for name, text in export.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")
    except OSError as exc:
        raise DeploymentError(f"{exc.filename or folder} cannot be written: {exc.strerror or exc}") from exc


def _copy(app: Path, sources: Mapping[str, Path]) -> None:
    """Put copies into a folder, which is replaced as a whole once all are there."""
    app.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".export-", dir=app.parent) as holder:
        made = Path(holder, "new")
        made.mkdir()
        (made / _OWNER).touch()
        for name, source in sources.items():
            if source.is_dir():
                shutil.copytree(source, made / name, ignore=_LEFT_OUT)
            else:
                shutil.copy2(source, made / name)
        if app.exists():
            app.rename(Path(holder, "old"))
        made.rename(app)


def _is_ours(path: Path) -> bool:
    with path.open(encoding="utf-8", errors="replace") as file:
        return _MARK in file.readline()


def _one_line(text: str) -> str:
    return "".join(char if char.isprintable() else "?" for char in text)


def without_repeats(notes: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(notes))


def notes_on_containers(plan: Plan, engine: str) -> Iterator[str]:
    """What every engine of containers ignores, and what its images need besides the copied files."""
    if plan.clock:
        raise DeploymentError(f"{engine} gives each process a host of its own, but one clock is followed on one host")
    yield from notes_on_escalations(plan, engine)
    if any(watches_itself(each) and each.restart.when is not When.NEVER for each in plan.processes):
        yield f"{engine} does not detect a component that hangs; rcdeploy would restart it"
    for process in plan.processes:
        if process.is_program and not process.files:
            yield f"`{process.name}` runs `{process.command[0]}`: add what installs it to the Dockerfile"
    telling = [each.name for each in plan.processes if each.is_program and each.notifies]
    if telling:  # containers are polled
        without = f"`notifies` of {enumerated(telling)} has no effect"
        yield f"{engine} ignores sd_notify: {without}, a running process counts as ready"


def notes_on_escalations(plan: Plan, engine: str) -> Iterator[str]:
    """The escalations that the other engine ignores."""
    if set(plan.escalations.values()) - {"one_for_one"}:
        yield f"{engine} restarts only the process that has ended: `escalation` has no effect there"
