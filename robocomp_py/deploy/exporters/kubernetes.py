"""Manifests for Kubernetes: a pod for each machine, with a container for each process."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import Any

from ...runtime.notify import READY_FILE
from ..plan import Plan, Process
from ..policy import When
from .base import (
    KEYS,
    RUNTIME,
    USER,
    Export,
    Site,
    brought,
    enumerated,
    escalating,
    grace,
    heading,
    identifier,
    sites_of,
    told_once,
)
from .base import unique as unique_names
from .containers import INSIDE, READY, as_yaml, dockerfile

_NAME = "a-z0-9"
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
        files[site.folder / "Dockerfile"] = heading("The image of a network", network) + dockerfile(plan)
        if site.keys:
            files[site.folder / ".dockerignore"] = heading("What is none of the image", network) + f"{KEYS}\n"
    return Export(files, copies, told_once(_notes(plan)), tuple(_steps(plan, all_sites)))


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
            "template": {"metadata": {"labels": labels}, "spec": _pod(site, name)},
        },
    }


def _pod(site: Site, image: str) -> dict[str, Any]:
    names = unique_names((each.name for each in site.processes), _NAME, str.lower)
    pod: dict[str, Any] = {}
    if site.host:
        # By its addresses the other machines find it; the labels of nodes are their operator's.
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
            *({"name": f"{KEYS}-{names[name]}", "secret": _secret(image, names[name])} for name in site.keys),
        ],
    }


def _secret(image: str, name: str) -> dict[str, Any]:
    return {"secretName": f"{image}-{name}", "defaultMode": 0o400}


def _container(site: Site, process: Process, name: str, image: str) -> dict[str, Any]:
    environment = {name: _plain(value) for name, value in process.env.items()}
    environment["ROBOCOMP_RUNTIME_DIR"] = f"{RUNTIME}/private"  # a folder that only its user may enter
    container: dict[str, Any] = {
        "name": name[:_LONGEST],
        "image": f"{image}:latest",
        "imagePullPolicy": "IfNotPresent",
        "command": [_plain(word) for word in site.command(process, "python")],
    }
    if process.notifies:
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
    yield from escalating(plan, "Kubernetes")
    yield from brought(plan, "the Dockerfile")
    others = [each.name for each in plan.processes if each.restart.when is not When.ALWAYS]
    if others:
        yield f"Kubernetes starts again whatever ends, also {enumerated(others)}, with delays of its own"
    ordered = [each.name for each in plan.processes if each.after]
    if ordered:
        yield f"Kubernetes starts all of a pod at once: `dependences` of {enumerated(ordered)} have no effect"


def _steps(plan: Plan, all_sites: list[Site]) -> Iterator[str]:
    for site in all_sites:
        folder = site.name or "."
        yield f"docker build -t {_called(plan, site)} {folder}"
        names = unique_names((each.name for each in site.processes), _NAME, str.lower)
        for process, path in site.keys.items():
            files = f"{'' if folder == '.' else f'{folder}/'}{KEYS}/{path.name}"
            secret = f"{_called(plan, site)}-{names[process]}"
            yield f"kubectl create secret generic {secret} --from-file={shlex.quote(files)}"
        yield f"kubectl apply -f {'' if folder == '.' else f'{folder}/'}{_called(plan, site)}.yaml"
