"""Units for systemd (Type=notify): a service for each process, and a target for the network."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterable, Iterator
from pathlib import PurePosixPath

from ...errors import DeploymentError
from ..launcher.local import TRACES, WATCHDOG
from ..plan import Host, Plan, Process
from ..policy import Restart, When
from .base import (
    APP,
    Export,
    Site,
    grace,
    heading,
    identifier,
    is_helper,
    notes_on_escalations,
    sites_of,
    unique,
    watches_itself,
    without_repeats,
)

_RESTART = {When.NEVER: "no", When.ON_FAILURE: "on-failure", When.ALWAYS: "always"}
_NAME = "A-Za-z0-9_.:"
_AT_ONCE = 0.001
"""Minimum number of seconds: systemd reads 0 as endless."""


def systemd(plan: Plan, network: str) -> Export:
    """Units for each machine; their users start them, with `systemctl --user` or without."""
    whole = f"robocomp-{identifier(plan.name, _NAME)}"
    files: dict[PurePosixPath, str] = {}
    copies = {}
    all_sites = sites_of(plan, lambda host: f"{_home(host, whole)}/{APP}" if host else "")
    for site in all_sites:
        copies.update(site.copies())
        names = {
            name: f"{whole}-{unit}.service"
            for name, unit in unique((each.name for each in site.processes), _NAME).items()
        }
        files[site.folder / f"{whole}.target"] = heading("A network", network) + _target(plan, list(names.values()))
        for process in site.processes:
            text = heading("A process of a network", network) + _service(plan, site, process, whole, names)
            files[site.folder / names[process.name]] = text
    return Export(files, copies, without_repeats(_notes(plan)), tuple(_steps(all_sites, whole)))


def _target(plan: Plan, services: list[str]) -> str:
    return f"""
[Unit]
Description={_text(f"All of {plan.name}")}
Wants={" ".join(services)}

[Install]
WantedBy=default.target
"""


def _service(plan: Plan, site: Site, process: Process, whole: str, names: dict[str, str]) -> str:
    first = [names[other] for other in process.after if other in names]
    order = f"\nWants={' '.join(first)}" if first else ""
    if before := list(dict.fromkeys((*first, *(names[other] for other in process.ready_after if other in names)))):
        order += f"\nAfter={' '.join(before)}"
    python = site.host.python if site.host else sys.executable
    ours = list(site.moved.values())
    meant = ours if is_helper(process) else ()  # in a user's text, only whole words are files
    words = site.command(process, python)
    command = " ".join(_word(each, [each] if each in ours else meant) for each in words)
    folder = _home(site.host, whole) if site.host else _specified(str(process.cwd))
    environment = {"PYTHONUNBUFFERED": "1", **process.env}
    given = "".join(f"\nEnvironment={_quoted(f'{name}={value}')}" for name, value in environment.items())
    restart = process.restart
    return f"""
[Unit]
Description={_text(f"{process.name} ({process.component}) of {plan.name}")}
PartOf={whole}.target{order}{_limits(restart)}

[Service]
Type={"notify" if process.notifies else "exec"}
ExecStart={command}
WorkingDirectory={_path(folder)}{given}
Environment=ROBOCOMP_RUNTIME_DIR=%t/{whole}
RuntimeDirectory={whole}
RuntimeDirectoryMode=0700
RuntimeDirectoryPreserve=yes
Restart={_RESTART[restart.when]}{_delay(restart)}{_watchdog(process)}
SuccessExitStatus=130 143
TimeoutStartSec=infinity
TimeoutStopSec={grace(process) or _AT_ONCE:g}
"""


def _home(host: Host, whole: str) -> str:
    """The folder on another machine: the network's `workdir`, or one below the home folder, which systemd knows."""
    return _specified(host.workdir) if host.workdir else f"%h/{whole}"


def _limits(restart: Restart) -> str:
    if restart.when is When.NEVER:
        return ""
    return f"\nStartLimitIntervalSec={restart.period:g}\nStartLimitBurst={restart.intensity}"


def _delay(restart: Restart) -> str:
    return "" if restart.when is When.NEVER else f"\nRestartSec={restart.delay:g}"


def _watchdog(process: Process) -> str:
    """From when it is ready; it tells systemd itself if its configuration gives it another time."""
    return f"\nWatchdogSec={WATCHDOG:g}\nTimeoutAbortSec={TRACES:g}" if watches_itself(process) else ""


def _notes(plan: Plan) -> Iterator[str]:
    yield from notes_on_escalations(plan, "systemd")
    if any(each.restart.when is not When.NEVER for each in plan.processes):
        yield "systemd waits the same time before each restart: `max_delay` has no effect"
    here = {each.host for each in plan.processes if each.host == ""}
    if here and any(each.host for each in plan.processes):
        yield "the units of `localhost` refer to files on this machine; files for other hosts are included"


def _steps(all_sites: list[Site], whole: str) -> Iterator[str]:
    for site in all_sites:
        folder = f"{site.name}/" if site.name else ""
        if site.host:
            there = shlex.quote(site.host.workdir or whole)
            unpack = f"mkdir -p {there} && tar --extract --preserve-permissions --directory {there}"
            units = f"mkdir -p .config/systemd/user && mv {there}/{whole}* .config/systemd/user/"
            yield f"tar --create --directory {site.folder} . | {_on(site.host, unpack)}"
            yield _on(site.host, f"{units} && systemctl --user enable --now {whole}.target")
        else:
            yield "mkdir -p ~/.config/systemd/user"
            yield f"cp {folder}{whole}* ~/.config/systemd/user/"
            yield f"systemctl --user enable --now {whole}.target"


def _on(host: Host, script: str) -> str:
    """The command that runs a script on a host. The shell there gets the script as one text, and splits it again."""
    port = ["-p", str(host.port)] if host.port else []
    return shlex.join(["ssh", *port, f"{host.user}@{host.address}" if host.user else host.address, script])


# Quoting: systemd.syntax(7), systemd.service(5) and systemd.unit(5).


def _text(text: str) -> str:
    """A description in one line."""
    return "".join(char if char.isprintable() else " " for char in text).replace("%", "%%").replace("\\", "/")


def _specified(text: str) -> str:
    """A text in which systemd finds nothing to fill in."""
    return text.replace("%", "%%")


def _word(text: str, ours: Iterable[str]) -> str:
    """One word of a command line, in which `$` begins a variable; in what is `ours`, systemd fills in what it knows."""
    word = _quoted(text.replace("$", "$$"))
    for place in ours:
        word = word.replace(_specified(place), place)
    return word


def _quoted(text: str) -> str:
    plain = text and all(char.isalnum() or char in "-_./=:,+@" for char in text) and text.isascii()
    if plain:
        return text
    return '"' + "".join(_escaped(char) for char in text) + '"'


def _escaped(char: str) -> str:
    if char in '"\\':
        return f"\\{char}"
    if char == "%":
        return "%%"
    if char.isprintable():
        return char
    return "".join(f"\\x{octet:02x}" for octet in char.encode("utf-8", "surrogateescape"))


def _path(text: str) -> str:
    """Of a folder, which systemd takes as it stands, to the end of the line."""
    if not text.isprintable() or text != text.strip():
        raise DeploymentError(f"systemd cannot run anything in a folder called {text!r}; rename it")
    return text
