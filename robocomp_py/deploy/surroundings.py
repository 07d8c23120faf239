"""Obstacles on this machine to starting a network, found before anything starts.

the run-time folder    sockets in it have paths that are too long for the kernel
other networks         one that runs has an instance of the same name
"""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Iterator, Mapping
from typing import Any

from ..transports.deployment import deployment_of
from ..transports.directory import LONGEST_SOCKET
from ..transports.runtime_folder import runtime_dir
from .place import Place, running
from .plan import Plan

_MOST_STARTS = 99999
"""Each start of a process makes a socket with the next number."""


def hindrances(plan: Plan) -> list[str]:
    """Sentences that say what is in the way; none if nothing is.

    Raises DeploymentError or ConfigurationError if there can be no run-time folder.
    """
    return [*_long_sockets(plan), *_taken_names(plan)]


def _long_sockets(plan: Plan) -> Iterator[str]:
    folder = runtime_dir()
    sockets = {"rcdeploy": Place(plan.name).notify / str(_MOST_STARTS)}
    here = [name for process in plan.processes if not process.host for name in process.instances]
    used = {over.split()[0] for name in here if name in plan.ours for over in plan.ours[name].over}
    sockets |= {each: folder / name for each in sorted(used) if (name := deployment_of(each).longest_socket)}
    user, longest = max(sockets.items(), key=lambda each: len(os.fsencode(each[1])))
    too_much = len(os.fsencode(longest)) - LONGEST_SOCKET
    if too_much > 0:
        yield (
            f"run-time folder {folder}: paths of sockets of {user} in it would have {LONGEST_SOCKET + too_much} bytes, "
            f"and {LONGEST_SOCKET} is the limit; set ROBOCOMP_RUNTIME_DIR to a path that is shorter by {too_much} bytes"
        )


def _taken_names(plan: Plan) -> Iterator[str]:
    ours = _claims(json.loads(json.dumps(plan.to_json())))
    for other, theirs in running(Place(plan.name).folder.parent, _claims):
        for claim, name in ours.items():
            if claim in theirs and other != plan.name:
                yield (
                    f"`{name}` is already running in the network {other}, with the same name and middleware; "
                    f"rename the instance, write `namespace {plan.name.lower()};` into one of the "
                    f"networks, or stop that one: rcdeploy down {shlex.quote(other)}"
                )
                break


def _claims(plan: Mapping[str, Any]) -> dict[tuple[str, str, str], str]:
    """The instances by the name that only one instance of a host may have, over a middleware."""
    addresses = {"": ""} | {host["name"]: host["address"] for host in plan["hosts"]}
    hosts = {name: addresses.get(each["host"], "") for each in plan["processes"] for name in each["instances"]}
    return {
        (hosts[name], instance["channels"], scope): name
        for name, instance in plan["ours"].items()
        for scope in instance["over"]
    }
