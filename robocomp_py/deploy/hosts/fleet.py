"""The agents of a plan: the launcher of this machine, and one of each other host."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import DeploymentError
from ..agents import Agent, Listener
from ..plan import Host, Plan

if TYPE_CHECKING:
    from .remote import Share

_MODULES = {"zeromq": ("zmq", "msgpack"), "dds": ("cyclonedds",), "zenoh": ("zenoh",), "shm": ("iceoryx2",)}
"""What our transports import."""

_PACKAGES = {
    "numpy": "numpy",
    "zmq": "pyzmq",
    "msgpack": "msgpack",
    "cyclonedds": "cyclonedds",
    "zenoh": "eclipse-zenoh",
    "iceoryx2": "iceoryx2",
}


def remote_agents(plan: Plan, listener: Listener, note: Callable[[str], None] | None = None) -> dict[str, Agent]:
    """By host. Raises DeploymentError if what SSH needs is not installed. `note` is told what takes long."""
    if not plan.hosts:
        return {}
    check_ssh()
    from .remote import RemoteAgent

    told: dict[str, Any] = {"note": note} if note else {}
    return {host.name: RemoteAgent(host, share_of(plan, host), listener, **told) for host in plan.hosts}


def check_ssh() -> None:
    """Raises DeploymentError if what SSH needs is not installed."""
    if find_spec("asyncssh") is None:
        raise DeploymentError("other hosts are reached by asyncssh, which is missing: pip install 'robocomp-py[ssh]'")


def share_of(plan: Plan, host: Host) -> Share:
    """What of a network is that host's business."""
    from .remote import Share

    processes = tuple(process for process in plan.processes if process.host == host.name)
    carriers, router = _carriers(plan, host), plan.routers.get(host.name, {})
    hosted = (("zenoh", router),) if "zenoh" in carriers or router else ()
    keys = _router_keys(router.get("router", {}))
    files = sorted(path for path in keys.iterdir() if path.is_file()) if keys else []
    return Share(plan.name, processes, hosted, needs(carriers), {path: path.name for path in files}, keys)


def needs(middlewares: Iterable[str]) -> Mapping[str, str]:
    """The modules that components need beyond Python, and what to install for each."""
    modules = ["numpy", *(module for each in middlewares for module in _MODULES.get(each, ()))]
    wanted = _requirements()
    return {module: wanted.get(_PACKAGES[module], _PACKAGES[module]) for module in dict.fromkeys(modules)}


def _router_keys(settings: Mapping[str, Any]) -> Path | None:
    """The folder of the keys that a router is told to use, if it is; those of components are among their files."""
    key = settings.get("transport/link/tls/listen_private_key")
    return Path(key).parent if key else None


def _carriers(plan: Plan, host: Host) -> list[str]:
    """The middlewares that instances of a host use."""
    there = {name for process in plan.processes if process.host == host.name for name in process.instances}
    used = {way.middleware for way in plan.ways if there & {way.client, way.provider}}
    return sorted(used | ({plan.middleware} & _MODULES.keys()))


def _requirements() -> dict[str, str]:
    """Our own dependencies with their versions, by name."""
    try:
        lines = requires("robocomp-py") or []
    except PackageNotFoundError:
        return {}
    plain = (line.partition(";")[0].strip() for line in lines if "extra ==" not in line)
    return {re.split(r"[^\w-]", line)[0]: line for line in plain}
