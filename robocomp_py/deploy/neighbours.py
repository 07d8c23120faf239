"""Other networks that run on this machine, and whose ports between hosts are those of this one."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from .place import Place
from .plan import Plan
from .wiring import BLOCK, FIRST_PORT, block_of


def warnings(plan: Plan) -> list[str]:
    """What is to be told of them before this one starts. Raises DeploymentError if there is no run-time folder."""
    if not _crosses(plan.to_json()):
        return []
    first = FIRST_PORT + block_of(plan.name) * BLOCK
    return [
        f"{other} runs here, and its name gives it the same ports between hosts as {plan.name}: {first} to "
        f"{first + BLOCK - 1}; if one of them cannot listen there, call the network otherwise"
        for other in _running(Place(plan.name).folder.parent)
        if other != plan.name and block_of(other) == block_of(plan.name)
    ]


def _running(deployments: Path) -> Iterator[str]:
    for path in sorted(deployments.glob("*/plan.json")):
        try:
            told = json.loads(path.read_text(encoding="utf-8"))
            name = str(told["name"])
            if _crosses(told) and Place(name, deployments).runner():
                yield name
        except (OSError, ValueError, KeyError, TypeError):
            continue  # it ends just now, or is of another version


def _crosses(told: Mapping[str, Any]) -> bool:
    """Whether anything of a network is carried from one host to another."""
    host = {name: process["host"] for process in told["processes"] for name in process["instances"]}
    return any(host.get(way["client"]) != host.get(way["provider"]) for way in told["ways"])
