"""The agents of a plan: the launcher of this machine, and one of each other host."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ... import installed
from ...errors import DeploymentError
from ...transports.deployment import deployment_of
from ..agents import Agent, Listener
from ..plan import Host, Plan

if TYPE_CHECKING:
    from .remote import Share


def remote_agents(plan: Plan, listener: Listener, note: Callable[[str], None]) -> dict[str, Agent]:
    """By host. Raises DeploymentError if the packages for SSH are missing. `note` is called with progress."""
    if not plan.hosts:
        return {}
    check_ssh()
    from .remote import RemoteAgent

    return {host.name: RemoteAgent(host, share_of(plan, host), listener, note=note) for host in plan.hosts}


def keeping(path: Path) -> tuple[str, dict[str, Host]] | None:
    """The name of a network and its hosts that go on without their controller; None if it has none."""
    from ...dsl.workspace import Workspace
    from ..placing import hosts_of

    model = Workspace().deployment(path)
    hosts = {host.name: host for host in hosts_of(model, model.instances) if host.keep} if model else {}
    return (model.name.text, hosts) if model and hosts else None


def end_kept(network: str, hosts: Mapping[str, Host]) -> list[str]:
    """End the processes that hosts kept, and report them. Raises DeploymentError if a host cannot be reached."""
    check_ssh()
    from .remote import RemoteAgent, Share

    async def end(host: Host) -> list[str]:
        agent = RemoteAgent(host, Share(network, ()), _Deaf())
        await agent.open()  # which ends all processes that it was not told
        await agent.close()
        return agent.kept

    async def end_all() -> list[str]:
        ends = [asyncio.ensure_future(end(host)) for host in hosts.values()]
        await asyncio.gather(
            *ends, return_exceptions=True
        )  # the processes of other hosts are ended even if one is out of reach
        return [name for each in ends for name in each.result()]

    return asyncio.run(end_all())


class _Deaf(Listener):
    """A listener that ignores all events."""

    def output(self, name: str, line: str) -> None: ...

    def ready(self, name: str) -> None: ...

    def status(self, name: str, text: str) -> None: ...

    def left(self, name: str, instance: str) -> None: ...

    def contract(self, name: str, instance: str, operations: Mapping[str, str]) -> None: ...

    def hung(self, name: str) -> None: ...

    def exited(self, name: str, code: int) -> None: ...

    def lost(self, host: str, why: str) -> None: ...

    def back(self, host: str) -> None: ...


def check_ssh() -> None:
    """Raises DeploymentError if the packages for SSH are missing."""
    if find_spec("asyncssh") is None:
        raise DeploymentError("other hosts are reached by asyncssh, which is missing: pip install 'robocomp-py[ssh]'")


def share_of(plan: Plan, host: Host) -> Share:
    """The part of a network that runs on that host."""
    from .remote import Share

    processes = tuple(process for process in plan.processes if process.host == host.name)
    carriers = _carriers(plan, host)
    helpers = [
        each for each in plan.helpers if each.host == host.name or (each.host is None and each.middleware in carriers)
    ]
    helped = {each.middleware for each in helpers}
    hosted: list[tuple[str, Mapping[str, Any]]]
    hosted = [(name, {}) for name in carriers if name not in helped and deployment_of(name).shares]
    hosted += [(each.middleware, each.options) for each in helpers]
    folders = [Path(each.keys) for each in helpers if each.keys]
    files = {path: path.name for folder in folders for path in sorted(folder.iterdir()) if path.is_file()}
    return Share(plan.name, processes, tuple(hosted), needs(carriers), files, next(iter(folders), None))


def needs(middlewares: Iterable[str]) -> Mapping[str, str]:
    """The modules that components need beyond Python, and what to install for each."""
    modules = dict((("numpy", "numpy"), *(each for name in middlewares for each in deployment_of(name).modules)))
    wanted = _requirements()
    return {module: wanted.get(package, package) for module, package in modules.items()}


def _carriers(plan: Plan, host: Host) -> list[str]:
    """The middlewares that instances of a host use."""
    there = {name for process in plan.processes if process.host == host.name for name in process.instances}
    used = {way.middleware for way in plan.ways if there & {way.client, way.provider}}
    return sorted(used | ({plan.middleware} & installed.transports().keys()))


def _requirements() -> dict[str, str]:
    """Our own dependencies with their versions, by name."""
    try:
        lines = requires("robocomp-py") or []
    except PackageNotFoundError:
        return {}
    plain = (line.partition(";")[0].strip() for line in lines if "extra ==" not in line)
    return {re.split(r"[^\w-]", line)[0]: line for line in plain}
