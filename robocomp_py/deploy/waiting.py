"""The waits of instances when a network starts, and those that would never end.

an instance begins    once its process has begun, and what it depends on in there is ready
a process begins      once the other processes are ready that those in it depend on
an instance is ready  once it has begun, and so have those it requires
a process is ready    once all in it are
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, auto

from ..dsl.ddsl.model import Deployment
from ..dsl.source import Name


@dataclass(frozen=True)
class Requirement:
    """An instance that requires an interface of another one."""

    client: str
    interface: str
    provider: str


@dataclass(frozen=True)
class Endless:
    """`waiting` starts after `name`, which is ready only once that has started, for what one of them requires."""

    waiting: str
    name: Name
    requirement: Requirement


class _Kind(Enum):
    BEGUN = auto()
    READY = auto()
    PROCESS_BEGUN = auto()
    PROCESS_READY = auto()


_Step = tuple[_Kind, str]
_Edges = dict[_Step, list[tuple[_Step, Requirement | None]]]


def endless(model: Deployment, requirements: Iterable[Requirement]) -> list[Endless]:
    """The dependences that make a network wait forever. The check of DDSL reports circles of dependences alone."""
    process = {instance.name.text: instance.runs_in.text for instance in model.instances}
    edges: _Edges = defaultdict(list)
    for name, within in process.items():
        edges[_Kind.READY, name].append(((_Kind.BEGUN, name), None))
        edges[_Kind.BEGUN, name].append(((_Kind.PROCESS_BEGUN, within), None))
        edges[_Kind.PROCESS_READY, within].append(((_Kind.READY, name), None))
    for each in requirements:
        edges[_Kind.READY, each.client].append(((_Kind.BEGUN, each.provider), each))
    waits: list[tuple[str, Name, _Step, _Step]] = []
    for instance in model.instances:
        name = instance.name.text
        for other in instance.dependences:
            if process.get(other.text) == process[name]:
                step, until = (_Kind.BEGUN, name), (_Kind.READY, other.text)
            else:
                step, until = (_Kind.PROCESS_BEGUN, process[name]), (_Kind.PROCESS_READY, process.get(other.text, ""))
            edges[step].append((until, None))
            waits.append((name, other, step, until))
    found = ((name, other, _way(edges, until, step)) for name, other, step, until in waits)
    return [Endless(name, other, way[0]) for name, other, way in found if way]


def _way(edges: _Edges, start: _Step, end: _Step) -> list[Requirement]:
    """The requirements on a way from one step to another; none if there is no way, or if it has none."""
    before: dict[_Step, tuple[_Step, Requirement | None] | None] = {start: None}
    waiting = [start]
    for step in waiting:
        for following, requirement in edges.get(step, ()):
            if following not in before:
                before[following] = step, requirement
                waiting.append(following)
    passed: list[Requirement] = []
    at = before.get(end)
    while at:
        step, requirement = at
        passed += [requirement] if requirement else []
        at = before[step]
    return passed[::-1]
