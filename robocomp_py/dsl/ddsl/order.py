"""Which instances of a deployment run together, and in which order they start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..source import Name
from . import model as m


def processes_of(model: m.Deployment) -> dict[str, list[m.Instance]]:
    """The instances by the names of their processes, all as they are written."""
    found: dict[str, list[m.Instance]] = {}
    for instance in model.instances:
        found.setdefault(instance.runs_in.text, []).append(instance)
    return found


def process_dependences(model: m.Deployment) -> dict[str, list[Name]]:
    """For each process, the other ones that must be ready before it starts, where the network says so."""
    process = {instance.name.text: instance.runs_in.text for instance in model.instances}
    return {
        name: [
            Name(process[other.text], other.span)
            for instance in together
            for other in instance.dependences
            if process.get(other.text, name) != name
        ]
        for name, together in processes_of(model).items()
    }


def start_order(waits_for: Mapping[str, Sequence[Name]]) -> tuple[list[str], list[tuple[str, Name]]]:
    """The instances, those that others wait for first, else as they are given; and what makes that impossible.

    That is, of each cycle, the step that closes it: an instance, and the one it cannot wait for.
    """
    order: list[str] = []
    closing: list[tuple[str, Name]] = []
    entered: set[str] = set()
    for first in waits_for:
        path = {} if first in entered else {first: iter(waits_for[first])}
        while path:
            instance, names = next(reversed(path.items()))
            entered.add(instance)
            for name in names:
                if name.text in path:
                    closing.append((instance, name))
                elif name.text in waits_for and name.text not in entered:
                    path[name.text] = iter(waits_for[name.text])
                    break
            else:
                order.append(instance)
                del path[instance]
    return order, closing
