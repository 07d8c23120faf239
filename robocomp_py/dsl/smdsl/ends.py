"""End states that share a name. Each belongs to its parent: `sweep.done` and `grip.done`, or `done` of the machine."""

from __future__ import annotations

from dataclasses import replace

from ..source import Name
from . import model as m


def shared(file: m.File) -> dict[str, dict[str, str]]:
    """For each name that several end states share: the unique name of each by its parent ("" for the machine).

    Empty for SCXML, where names are unique.
    """
    if file.source.path.suffix.lower() == ".scxml":
        return {}
    kinds: dict[str, set[bool]] = {}
    found: dict[str, dict[str, str]] = {}
    for block in file.blocks:
        parent = block.parent.text if block.parent else ""
        for state in block.states:
            kinds.setdefault(state.name.text, set()).add(state.final)
            found.setdefault(state.name.text, {})[parent] = f"{parent}.{state.name}" if parent else state.name.text
    return {name: found[name] for name, kind in kinds.items() if kind == {True} and len(found[name]) > 1}


def resolved(file: m.File) -> m.File:
    """The file with these unique names, also as targets of transitions.

    A transition leads to the end state of the innermost state around its source that has one. If there is none, its
    target keeps a name that no state has.
    """
    ends = shared(file)
    if not ends:
        return file
    around = {
        state.name.text: block.parent.text if block.parent else ""
        for block in file.blocks
        for state in block.states
        if state.name.text not in ends
    }

    def declared(state: m.State, block: m.Block) -> m.State:
        by_parent = ends.get(state.name.text)
        if by_parent is None:
            return state
        return replace(state, name=_called(state.name, by_parent[block.parent.text if block.parent else ""]))

    def led(transition: m.Transition) -> m.Transition:
        by_parent = ends.get(transition.target.text)
        if by_parent is None:
            return transition
        name, seen = transition.source.text, set[str]()
        while name in around and name not in seen:
            seen.add(name)
            name = around[name]
            if name in by_parent:
                return replace(transition, target=_called(transition.target, by_parent[name]))
        return transition

    blocks = (
        replace(
            block,
            states=tuple(declared(each, block) for each in block.states),
            transitions=tuple(map(led, block.transitions)),
        )
        for block in file.blocks
    )
    return replace(file, blocks=tuple(blocks))


def _called(name: Name, text: str) -> Name:
    return Name(text, name.span)
