"""Where the instances of a network run, and how they are restarted: the clauses of the file as values.

`robocomp_py.dsl.ddsl.check` has checked them before.
"""

from __future__ import annotations

import os
import shlex
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..contract.component import Component
from ..dsl.ddsl.clauses import CLAUSES
from ..dsl.ddsl.clocks import check_clock, read_clock
from ..dsl.ddsl.model import Clock, Deployment, Instance
from ..dsl.ddsl.model import Host as Block
from ..dsl.ddsl.scope import HERE, host_of
from ..dsl.diagnostics import Report
from ..dsl.numbers import whole
from ..dsl.source import Name, Source
from ..runtime.effective import toml
from ..wire.names import whole as whole_name
from .asjson import fields_from_json
from .plan import Host, Overrides, Plan, Security
from .policy import Escalation
from .process import Process


def host_name(model: Deployment, instance: Instance) -> str:
    """The host that it runs on, "" for this one. A host without a name is called by its address."""
    said = host_of(model, instance)
    if said is None or said.text in HERE:
        return ""
    if said is instance.ip:
        return next((each.name.text for each in model.hosts if _is_at(each, said.text)), said.text)
    return said.text


def on_this_machine(model: Deployment, is_here: Callable[[str], bool]) -> Deployment:
    """The same network, with `localhost` in place of each `ip` that is this machine's.

    An `ip` that is the address of a `host` means that host, which may be reached over SSH as another user.
    """

    def placed(instance: Instance) -> Instance:
        ip = instance.ip
        if ip is None or ip.text in HERE or any(_is_at(host, ip.text) for host in model.hosts) or not is_here(ip.text):
            return instance
        return replace(instance, ip=replace(ip, text=HERE[0]))

    instances = tuple(map(placed, model.instances))
    return model if instances == model.instances else replace(model, instances=instances)


def _is_at(host: Block, address: str) -> bool:
    return host.address is not None and host.address.text.lower() == address.lower()


def hosts_of(model: Deployment, instances: Sequence[Instance]) -> tuple[Host, ...]:
    """The hosts that are used, in the order of the file, if they exist and have an address."""
    hosts = {host.name.text: _host(host) for host in model.hosts if host.address}
    used = {host_name(model, each): host_of(model, each) is each.ip for each in instances}
    hosts |= {name: Host(name, name) for name, unnamed in used.items() if name and unnamed and name not in hosts}
    return tuple(host for name, host in hosts.items() if name in used)


def _host(block: Block) -> Host:
    return Host(
        block.name.text,
        block.address.text if block.address else "",
        block.user.text if block.user else "",
        whole(block.port.text) if block.port else 0,
        block.workdir.text if block.workdir else "",
        block.python.text if block.python else Host.python,
        bool(block.lost and block.lost.text == "keep"),
    )


def of_process(model: Deployment, together: Sequence[Instance]) -> dict[str, Any]:
    """The fields of `Process` that the clauses of its instances set."""
    values = {each.name: each.process(model, together) for each in CLAUSES if each.process}
    return {**fields_from_json(Process, values), "system": together[-1].system}


def of_plan(model: Deployment, components: Mapping[str, Component], report: Report) -> dict[str, Any]:
    """The fields of `Plan` that the clauses of a network set. `components` are those of its instances, by name."""
    values = {each.name: each.plan(model, components, report) for each in CLAUSES if each.plan}
    return {**fields_from_json(Plan, values), "escalations": escalations(model)}


def escalations(model: Deployment) -> dict[tuple[str, ...], Escalation]:
    """By system; "" is the whole network."""
    said = {tuple(each.name.text.split("/")): each.escalation for each in model.systems if each.escalation}
    if model.escalation:
        said[()] = model.escalation
    return {path: Escalation(name.text) for path, name in said.items()}


def security(model: Deployment) -> Security:
    return Security(model.security.text) if model.security else Security.LOCAL


def with_clock(model: Deployment, overrides: Overrides, report: Report) -> Deployment:
    """The same network with the clock and the speed of the command line, which are checked."""
    clock = model.clock
    if overrides.clock == "":
        clock = None
    elif overrides.clock:
        source = Source(Path(f"--clock {overrides.clock}"), "", has_places=False)
        clock = Clock(Name(overrides.clock, source.span(0, 0)), (), source.span(0, 0))
    if overrides.speed is not None and clock is None:
        place = Source(Path("--speed"), "", has_places=False).span(0, 0)
        report.error("bad-clock", "the network has no clock of its own", place, "add --clock INSTANCE")
    changed = replace(model, clock=clock)
    if overrides.clock:
        check_clock(changed, report)
    return model if report.errors else changed


def clock_of(model: Deployment, instance: Instance, speed: float | None) -> Iterator[str]:
    """What a clock means for an instance, as assignments to its configuration."""
    if model.clock is None or instance.program:
        return
    named = {each.name.text: whole_name(each.local, namespace(model, each)) for each in model.instances}
    leader = model.clock.leader.text
    if leader not in named:  # which has been reported
        return
    said = read_clock(model.clock, Report())
    yield f"clock.leader={toml(named[leader])}"
    if instance.name.text != leader and "mode" in said:
        yield f"clock.mode={toml(said['mode'])}"
    if instance.name.text == leader:
        others = [named[each.name.text] for each in model.instances if not each.program and each is not instance]
        yield f"clock.followers={toml(others)}"
        if speed is not None:
            said["speed"] = speed
        yield from (f"clock.{name}={toml(value)}" for name, value in said.items())


def port(instance: Instance) -> int:
    """The TCP port at which it can be called from outside; 0 without one."""
    return whole(instance.port.text) if instance.port else 0


def ports_of_offers(instance: Instance) -> dict[str, int]:
    """The TCP ports at which its named instances can be called from outside."""
    return {each.local: whole(each.port.text) for each in instance.offers if each.port}


def namespace(model: Deployment, instance: Instance) -> str:
    """That of its channels: the systems around it are a part of it."""
    return "/".join(filter(None, (model.namespace, *instance.system)))


def channels(model: Deployment, instance: Instance) -> Iterator[tuple[str, str]]:
    """The full names of an instance and its named instances, and what their channels begin with.

    That is so if nothing else configures the namespace.
    """
    for name in (*(offer.name.text for offer in instance.offers), instance.name.text):
        yield name, "/".join(filter(None, (namespace(model, instance), name.rpartition("/")[2])))


def existing_command(command: str) -> list[str]:
    """The words of an `existing`, split as in a shell, but without one; empty if it cannot be split."""
    try:
        return shlex.split(command)
    except ValueError:
        return []


def is_elsewhere(model: Deployment, instance: Instance) -> bool:
    """Whether its program is installed on its host, rather than a file beside the network."""
    return instance.path is not None and Path(instance.path.text).is_absolute() and bool(host_name(model, instance))


def find_program(word: str, folder: Path, env: Mapping[str, str]) -> Path | None:
    """The program that a word names in a folder on this host; None if it does not exist."""
    if "/" in word:
        path = folder / word
        return path.absolute() if path.is_file() and os.access(path, os.X_OK) else None
    found = shutil.which(word, path=env.get("PATH"))
    return Path(found) if found else None
