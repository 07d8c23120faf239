"""In which order the instances of a deployment start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..source import Name


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
