"""The order in which components that require each other start and stop. Pure.

A component starts when the components that it requires are ready, and stops before them. If some require each other
in a circle, that cannot hold for all of them: they start at the same time, and stop in an order in which as few
operations as possible lose their provider while their client still runs.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass

Edge = tuple[str, str]
"""A client and its provider."""

_Graph = dict[str, list[str]]


@dataclass(frozen=True)
class Order:
    ready_after: Mapping[str, tuple[str, ...]]
    """By client, the providers that are to be ready before it starts."""
    stops_before: Mapping[str, tuple[str, ...]]
    """By client, the providers that are to go on until it has stopped."""
    circles: tuple[tuple[str, ...], ...]
    """Those that require each other."""
    broken: tuple[Edge, ...]
    """The providers in circles that stop before a client."""


def ordered(nodes: Iterable[str], fixed: Mapping[str, Collection[str]], needs: Mapping[Edge, int]) -> Order:
    """The order of some components, or of the processes they run in.

    `fixed` says which ones each starts after in any case, without circles. `needs` says how many operations each
    client requires of each provider.
    """
    names = list(nodes)
    graph = {name: [*fixed.get(name, ())] for name in names}
    for client, provider in needs:
        graph[client].append(provider)
    circles = [tuple(name for name in names if name in circle) for circle in _together(graph) if len(circle) > 1]
    circle_of = {name: number for number, circle in enumerate(circles) for name in circle}
    inside = [edge for edge in needs if edge[0] in circle_of and circle_of[edge[0]] == circle_of.get(edge[1])]
    broken = _broken({name: graph[name] for name in circle_of}, {edge: needs[edge] for edge in inside})
    return Order(
        _by_client(edge for edge in needs if edge not in inside),
        _by_client(edge for edge in needs if edge not in broken),
        tuple(circles),
        tuple(broken),
    )


def _by_client(edges: Iterable[Edge]) -> dict[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = {}
    for client, provider in edges:
        found[client] = (*found.get(client, ()), provider)
    return found


def _broken(graph: _Graph, needs: Mapping[Edge, int]) -> list[Edge]:
    """The needs to drop so that no circle is left: in each circle, the one for the fewest operations."""
    broken: list[Edge] = []
    while circle := _circle(graph):
        edges = [edge for edge in zip(circle, (*circle[1:], circle[0]), strict=True) if edge in needs]
        if not edges:
            break  # of `dependences` alone, which is reported as an error
        client, provider = least = min(edges, key=lambda edge: needs[edge])
        graph[client] = [other for other in graph[client] if other != provider]
        broken.append(least)
    return broken


def _circle(graph: _Graph) -> list[str]:
    """A circle, or nothing."""
    finished: set[str] = set()
    for first in graph:
        path = {} if first in finished else {first: iter(graph[first])}
        while path:
            name, others = next(reversed(path.items()))
            for other in others:
                if other in path:
                    names = list(path)
                    return names[names.index(other) :]
                if other in graph and other not in finished:
                    path[other] = iter(graph[other])
                    break
            else:
                finished.add(name)
                del path[name]
    return []


def _together(graph: _Graph) -> Iterator[set[str]]:
    """The strongly connected components, by Kosaraju's algorithm."""
    backwards: _Graph = {name: [] for name in graph}
    for name, others in graph.items():
        for other in others:
            backwards[other].append(name)
    seen: set[str] = set()
    for name in reversed(_finishing(graph)):
        if name not in seen:
            found, waiting = set[str](), [name]
            while waiting:
                each = waiting.pop()
                if each not in seen:
                    seen.add(each)
                    found.add(each)
                    waiting += backwards[each]
            yield found


def _finishing(graph: _Graph) -> list[str]:
    """The nodes in the order in which a depth-first search finishes them."""
    finished: dict[str, None] = {}
    for first in graph:
        path = {} if first in finished else {first: iter(graph[first])}
        while path:
            name, others = next(reversed(path.items()))
            other = next((each for each in others if each not in finished and each not in path), None)
            if other is None:
                finished[name] = None
                del path[name]
            else:
                path[other] = iter(graph[other])
    return list(finished)
