"""State machines as expressions and methods of Python."""

from __future__ import annotations

from collections.abc import Sequence

from ..contract.component import Component
from ..contract.statemachine import State, StateMachine, Transition
from .layout import call, docstring, quoted, tuple_of


def states_of(component: Component) -> list[State]:
    """The states whose methods a component must have; if states share a method, only the first."""
    found: dict[str, State] = {}
    for state in component.machine.every_state() if component.machine else ():
        found.setdefault(state.method, state)
    return list(found.values())


def machine_expression(machine: StateMachine, indent: int) -> str:
    """The `StateMachine( … )` in generated code, after `machine=`."""
    inner = indent + 4
    arguments = [
        quoted(machine.name),
        f"states={_tuple([_state(each, inner + 4) for each in machine.states], 'states=', inner)}",
        f"initial={quoted(machine.initial)}",
    ]
    if machine.transitions:
        transitions = [_transition(each, inner + 4) for each in machine.transitions]
        arguments.append(f"transitions={_tuple(transitions, 'transitions=', inner)}")
    return call("StateMachine", arguments, indent, len("machine=,"))


def state_signature(state: State) -> str:
    return f"def {state.method}(self) -> None:"


def state_method(state: State, machine: StateMachine) -> str:
    """A new method of a state, which does nothing."""
    lines = (state_signature(state), f"    {docstring(state_doc(state, machine), 8)}")
    return "".join(f"    {line}\n" for line in lines)


def state_doc(state: State, machine: StateMachine) -> str:
    """The docstring of a state's method: when it is called, and which transitions leave the state."""
    leaving = [f"self.{trigger}()" for trigger in machine.leaving(state.name)]
    said = f"Called when `{state.label}` is entered"
    if state.final:
        return f"{said}, which ends {' or '.join(_ended_by(state.method, machine))}."
    return f"{said}. From here: {', '.join(leaving)}." if leaving else f"{said}."


def _ended_by(method: str, machine: StateMachine) -> list[str]:
    """The machine or states that end when the end states of a method are entered."""
    whole = ["the state machine"] if any(each.method == method for each in machine.states) else []
    around = [each for each in machine.every_state() if any(inner.method == method for inner in each.states)]
    return [*whole, *(f"`{each.name}`" for each in around)]


def _state(state: State, indent: int) -> str:
    arguments = [quoted(state.name)]
    if state.states:
        inner = [_state(each, indent + 8) for each in state.states]
        arguments.append(f"states={_tuple(inner, 'states=', indent + 4)}")
    if state.initial:
        arguments.append(f"initial={quoted(state.initial)}")
    arguments += [f"{flag}=True" for flag in ("parallel", "final") if getattr(state, flag)]
    return call("State", arguments, indent, 1)


def _transition(transition: Transition, indent: int) -> str:
    arguments = [quoted(transition.source), quoted(transition.target)]
    if transition.events:
        events = [quoted(each) for each in transition.events]
        line = f"events=({', '.join(events)}{',' if len(events) == 1 else ''})"
        arguments.append(line)
    return call("Transition", arguments, indent, 1)


def _tuple(items: Sequence[str], name: str, indent: int) -> str:
    """A tuple after `name`, which is indented this far."""
    return tuple_of(items, indent + len(name), indent)
