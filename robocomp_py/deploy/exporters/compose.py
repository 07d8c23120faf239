"""A compose file for each machine, by the Compose Specification, with an image for its components."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import Any

from ...runtime.notify import READY_FILE
from ..plan import Plan, Process
from ..policy import Restart, When
from .base import (
    KEYS,
    RUNTIME,
    USER,
    Export,
    Site,
    grace,
    heading,
    identifier,
    notes_on_containers,
    sites_of,
    unique,
    without_repeats,
)
from .containers import INSIDE, READY, as_yaml, dockerfile

_NAME = "a-zA-Z0-9._-"


def compose(plan: Plan, network: str) -> Export:
    project = identifier(plan.name.lower(), "a-z0-9_-")
    files: dict[PurePosixPath, str] = {}
    copies = {}
    all_sites = sites_of(plan, lambda host: INSIDE)
    for site in all_sites:
        copies.update(site.copies())
        files[site.folder / "compose.yaml"] = heading("A network", network) + as_yaml(_project(site, project))
        files[site.folder / "Dockerfile"] = heading("The image of a network", network) + dockerfile()
        if site.keys:
            files[site.folder / ".dockerignore"] = heading("Files that stay out of the image", network) + f"{KEYS}\n"
    return Export(files, copies, without_repeats(_notes(plan)), tuple(_steps(all_sites)))


def _project(site: Site, project: str) -> dict[str, Any]:
    names = unique((each.name for each in site.processes), _NAME)
    return {
        "name": project,
        "services": {names[each.name]: _service(site, each, project, names) for each in site.processes},
        "volumes": {
            "runtime": {
                "driver_opts": {"type": "tmpfs", "device": "tmpfs", "o": f"mode=0700,uid={USER}"},
            }
        },
    }


def _service(site: Site, process: Process, project: str, names: dict[str, str]) -> dict[str, Any]:
    image = f"{project}-{identifier(site.name.lower(), 'a-z0-9_-')}" if site.name else project
    command = [_plain(word) for word in site.command(process, "python")]
    environment = {name: _plain(value) for name, value in process.env.items()}
    service: dict[str, Any] = {"image": image, "build": ".", "command": command}
    if not process.is_program:
        environment[READY_FILE] = READY
        service["tmpfs"] = ["/tmp"]  # empty at each start
        service["healthcheck"] = {
            "test": ["CMD", "test", "-e", READY],
            "interval": "2s",
            "start_period": "60s",
            "start_interval": "0.5s",
        }
    if environment:
        service["environment"] = environment
    first = {
        names[other]: _condition(site, other) for other in (*process.after, *process.ready_after) if other in names
    }
    if first:
        service["depends_on"] = first
    mounts = [f"runtime:{RUNTIME}"]
    if keys := site.keys.get(process.name):
        mounts.append(f"./{KEYS}/{keys.name}:{site.moved[keys]}:ro")
    # Components of one machine meet in their run-time folder and shared memory, and see which processes live.
    shared = {"network_mode": "host", "ipc": "host", "pid": "host", "volumes": mounts}
    return {
        **service,
        **shared,
        "init": True,
        "restart": _restart(process.restart),
        "stop_grace_period": f"{grace(process):g}s",
    }


def _condition(site: Site, name: str) -> dict[str, str]:
    is_program = any(each.is_program for each in site.processes if each.name == name)
    return {"condition": "service_started" if is_program else "service_healthy"}


def _restart(restart: Restart) -> str:
    match restart.when:
        case When.NEVER:
            return "no"
        case When.ON_FAILURE:
            return f"on-failure:{restart.intensity}"
        case When.ALWAYS:
            return "unless-stopped"


def _plain(text: str) -> str:
    """A text in which compose finds no variable."""
    return text.replace("$", "$$")


def _notes(plan: Plan) -> Iterator[str]:
    yield from notes_on_containers(plan, "compose")
    if any(each.restart.when is not When.NEVER for each in plan.processes):
        yield "compose chooses the delays between restarts and counts all of them: `delay` and `period` have no effect"


def _steps(all_sites: list[Site]) -> Iterator[str]:
    for site in all_sites:
        where = f" --project-directory {site.name}" if site.name else ""
        yield f"docker compose{where} up --build --detach"
