"""Which instances of a deployment run together, and in which order they start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..source import Name
from . import model as m


def processes_of(model: m.Deployment) -> dict[str, list[m.Instance]]:
    """The instances by the names of their processes, in the order of the file."""
    found: dict[str, list[m.Instance]] = {}
    for instance in model.instances:
        found.setdefault(instance.runs_in.text, []).append(instance)
    return found


def process_dependences(model: m.Deployment) -> dict[str, list[Name]]:
    """For each process, the others that must be ready before it starts, as declared in the network."""
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
    """The start order, in which dependencies come first and the given order is otherwise kept; and the cycles.

    Of each cycle, it returns the step that closes it: an instance, and the one it cannot wait for.
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
