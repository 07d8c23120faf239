"""The agents of a plan: the launcher of this machine, and one of each other host."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import DeploymentError
from ..agents import Agent, Listener
from ..iceplaces import ICE, LOOPBACK
from ..plan import Host, Plan

if TYPE_CHECKING:
    from .remote import Share

_MODULES = {
    "zeromq": ("zmq", "msgpack"),
    "dds": ("cyclonedds",),
    "zenoh": ("zenoh",),
    "shm": ("iceoryx2",),
    "ice": ("Ice",),
}
"""What our transports import."""

_PACKAGES = {
    "numpy": "numpy",
    "zmq": "pyzmq",
    "msgpack": "msgpack",
    "cyclonedds": "cyclonedds",
    "zenoh": "eclipse-zenoh",
    "iceoryx2": "iceoryx2",
    "Ice": "zeroc-ice",
}


def remote_agents(plan: Plan, listener: Listener, note: Callable[[str], None] | None = None) -> dict[str, Agent]:
    """By host. Raises DeploymentError if what SSH needs is not installed. `note` is told what takes long."""
    if not plan.hosts:
        return {}
    check_ssh()
    from .remote import RemoteAgent

    told: dict[str, Any] = {"note": note} if note else {}
    return {host.name: RemoteAgent(host, share_of(plan, host), listener, **told) for host in plan.hosts}


def keeping(path: Path) -> tuple[str, dict[str, Host]] | None:
    """The name of a network and its hosts that go on without whoever launched it; None if it has none."""
    from ...dsl.workspace import Workspace
    from ..placing import hosts_of

    model = Workspace().deployment(path)
    hosts = {host.name: host for host in hosts_of(model, model.instances) if host.keep} if model else {}
    return (model.name.text, hosts) if model and hosts else None


def end_kept(network: str, hosts: Mapping[str, Host]) -> list[str]:
    """End what hosts kept of a network, and tell what that was. Raises DeploymentError if one cannot be reached."""
    check_ssh()
    from .remote import RemoteAgent, Share

    async def end(host: Host) -> list[str]:
        agent = RemoteAgent(host, Share(network, ()), _Deaf())
        await agent.open()  # which ends what it does not know
        await agent.close()
        return agent.kept

    async def end_all() -> list[str]:
        ends = [asyncio.ensure_future(end(host)) for host in hosts.values()]
        await asyncio.gather(*ends, return_exceptions=True)  # one out of reach: the others are ended all the same
        return [name for each in ends for name in each.result()]

    return asyncio.run(end_all())


class _Deaf(Listener):
    """Wants to know nothing."""

    def output(self, name: str, line: str) -> None: ...

    def ready(self, name: str) -> None: ...

    def status(self, name: str, text: str) -> None: ...

    def left(self, name: str, instance: str) -> None: ...

    def hung(self, name: str) -> None: ...

    def exited(self, name: str, code: int) -> None: ...

    def lost(self, host: str, why: str) -> None: ...

    def back(self, host: str) -> None: ...


def check_ssh() -> None:
    """Raises DeploymentError if what SSH needs is not installed."""
    if find_spec("asyncssh") is None:
        raise DeploymentError("other hosts are reached by asyncssh, which is missing: pip install 'robocomp-py[ssh]'")


def share_of(plan: Plan, host: Host) -> Share:
    """What of a network is that host's business."""
    from .remote import Share

    processes = tuple(process for process in plan.processes if process.host == host.name)
    carriers, router = _carriers(plan, host), plan.routers.get(host.name, {})
    hosted: tuple[tuple[str, Mapping[str, Any]], ...]
    hosted = (("zenoh", router),) if "zenoh" in carriers or router else ()
    if ICE in carriers:  # whose topics go through a program on the one host that has that address
        hosted += tuple((ICE, {"storm": storm}) for storm in plan.storms if LOOPBACK not in storm)
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
