"""Manifests for Kubernetes: a pod for each machine, with a container for each process."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import Any

from ...errors import DeploymentError
from ...runtime.notify import READY_FILE
from ...spelling import enumerated
from ..keys import contents, graph_of
from ..plan import Plan, Process
from ..policy import When
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
    without_repeats,
)
from .base import unique as unique_names
from .containers import INSIDE, READY, as_yaml, dockerfile

_NAME = "a-z0-9"
_KEY = "A-Za-z0-9_."
_LONGEST = 63
"""Characters of a name, by RFC 1123."""


def kubernetes(plan: Plan, network: str) -> Export:
    files: dict[PurePosixPath, str] = {}
    copies = {}
    all_sites = sites_of(plan, lambda host: INSIDE)
    for site in all_sites:
        copies.update(site.copies())
        manifest = heading("A network", network) + as_yaml(_deployment(plan, site))
        files[site.folder / f"{_called(plan, site)}.yaml"] = manifest
        files[site.folder / "Dockerfile"] = heading("The image of a network", network) + dockerfile()
        if site.keys:
            files[site.folder / ".dockerignore"] = heading("Files that stay out of the image", network) + f"{KEYS}\n"
    return Export(files, copies, without_repeats(_notes(plan)), tuple(_steps(plan, all_sites)))


def _called(plan: Plan, site: Site) -> str:
    name = f"{plan.name}-{site.name}" if site.name else plan.name
    return identifier(name.lower(), _NAME)[:_LONGEST].strip("-")


def _deployment(plan: Plan, site: Site) -> dict[str, Any]:
    name = _called(plan, site)
    labels = {"app.kubernetes.io/name": name, "app.kubernetes.io/part-of": identifier(plan.name.lower(), _NAME)}
    return {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": {"name": name, "labels": labels},
        "spec": {
            "replicas": 1,
            "strategy": {"type": "Recreate"},
            "selector": {"matchLabels": {"app.kubernetes.io/name": name}},
            "template": {"metadata": {"labels": labels}, "spec": _pod(plan, site, name)},
        },
    }


def _pod(plan: Plan, site: Site, image: str) -> dict[str, Any]:
    names = unique_names((each.name for each in site.processes), _NAME, str.lower)
    secrets = _secrets(plan, site)
    pod: dict[str, Any] = {}
    if site.host:
        # The other machines find it by its addresses; the labels of nodes are the operator's.
        pod = {"nodeSelector": {"kubernetes.io/hostname": site.host.name}, "hostNetwork": True}
    return {
        **pod,
        "shareProcessNamespace": True,
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,
        "terminationGracePeriodSeconds": max(1, round(max(grace(each) for each in site.processes))),
        "securityContext": {"runAsNonRoot": True, "runAsUser": USER, "fsGroup": USER},
        "containers": [_container(site, each, names[each.name], image) for each in site.processes],
        "volumes": [
            {"name": "runtime", "emptyDir": {"medium": "Memory"}},
            {"name": "shared-memory", "emptyDir": {"medium": "Memory"}},
            *(
                {"name": f"{KEYS}-{names[process]}", "secret": _secret(f"{image}-{names[process]}", keys)}
                for process, keys in secrets.items()
            ),
        ],
    }


def _secrets(plan: Plan, site: Site) -> dict[str, dict[str, str]]:
    """By process, the files in the folder of its keys, each with a key of the secret, in which there are no folders."""
    known = contents(graph_of(plan)) if site.keys else {}
    found: dict[str, dict[str, str]] = {}
    for process, path in site.keys.items():
        if path.name not in known:
            raise DeploymentError(
                f"{process}: {path} is not of `rcdeploy keys`, whose keys go to Kubernetes; write `security lan;` "
                "instead of `--keys`"
            )
        found[process] = unique_names(known[path.name], _KEY, lambda file: file.replace("/", "."))
    return found


def _secret(name: str, keys: dict[str, str]) -> dict[str, Any]:
    items = [{"key": key, "path": file} for file, key in keys.items()]
    # They are root's, and the pod's own group (fsGroup) reads them; with it, 0400 would come to 0440 anyway.
    return {"secretName": name, "defaultMode": 0o440, "items": items}


def _container(site: Site, process: Process, name: str, image: str) -> dict[str, Any]:
    environment = {name: _plain(value) for name, value in process.env.items()}
    environment["ROBOCOMP_RUNTIME_DIR"] = f"{RUNTIME}/private"  # a folder that only its user may enter
    container: dict[str, Any] = {
        "name": name[:_LONGEST],
        "image": f"{image}:latest",
        "imagePullPolicy": "IfNotPresent",
        "command": [_plain(word) for word in site.command(process, "python")],
    }
    if not process.is_program:
        environment[READY_FILE] = READY
        container["readinessProbe"] = {"exec": {"command": ["test", "-e", READY]}, "periodSeconds": 1}
    container["env"] = [{"name": key, "value": value} for key, value in environment.items()]
    container["volumeMounts"] = [
        {"name": "runtime", "mountPath": RUNTIME},
        {"name": "shared-memory", "mountPath": "/dev/shm"},
    ]
    if keys := site.keys.get(process.name):
        mount = {"name": f"{KEYS}-{name}", "mountPath": site.moved[keys], "readOnly": True}
        container["volumeMounts"].append(mount)
    return container


def _plain(text: str) -> str:
    """A text in which Kubernetes finds no variable."""
    return text.replace("$(", "$$(")


def _notes(plan: Plan) -> Iterator[str]:
    yield from notes_on_containers(plan, "Kubernetes")
    others = [each.name for each in plan.processes if each.restart.when is not When.ALWAYS]
    if others:
        yield f"Kubernetes restarts every process that ends, also {enumerated(others)}, and chooses the delays"
    ordered = [each.name for each in plan.processes if each.after]
    if ordered:
        yield f"Kubernetes starts all of a pod at once: `dependences` of {enumerated(ordered)} have no effect"


def _steps(plan: Plan, all_sites: list[Site]) -> Iterator[str]:
    for site in all_sites:
        folder = site.name or "."
        yield f"docker build -t {_called(plan, site)} {folder}"
        names = unique_names((each.name for each in site.processes), _NAME, str.lower)
        for process, keys in _secrets(plan, site).items():
            there = f"{'' if folder == '.' else f'{folder}/'}{KEYS}/{site.keys[process].name}"
            files = " ".join(shlex.quote(f"--from-file={key}={there}/{file}") for file, key in keys.items())
            made = f"kubectl create secret generic {_called(plan, site)}-{names[process]} {files}"
            yield f"{made} --dry-run=client -o yaml | kubectl apply -f -"  # also over the keys of before
        yield f"kubectl apply -f {'' if folder == '.' else f'{folder}/'}{_called(plan, site)}.yaml"
