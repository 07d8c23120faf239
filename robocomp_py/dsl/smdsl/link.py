"""Model to contract. For files in which `check` found no error."""

from __future__ import annotations

from ...contract.statemachine import State, StateMachine, Transition
from . import model as m
from .ends import resolved


def link(file: m.File) -> StateMachine:
    """The machine a file describes."""
    file = resolved(file)
    inside = {block.parent.text if block.parent else "": block for block in file.blocks}
    return StateMachine(
        file.name.text,
        _states(inside[""], inside),
        inside[""].initial[0].text,
        tuple(
            dict.fromkeys(
                Transition(each.source.text, each.target.text, each.events)
                for block in file.blocks
                for each in block.transitions
            )
        ),
    )


def _states(block: m.Block, inside: dict[str, m.Block]) -> tuple[State, ...]:
    return tuple(_state(each, inside) for each in block.states)


def _state(state: m.State, inside: dict[str, m.Block]) -> State:
    block = inside.get(state.name.text)
    if block is None:
        return State(state.name.text, final=state.final)
    initial = "" if block.parallel else block.initial[0].text
    return State(state.name.text, _states(block, inside), initial, block.parallel)
