"""What a state machine is: states within states, regions that are active together, transitions between any of them.

composite    contains states, one of which is active at a time; `initial` is the first
parallel     contains states, its regions, which are all active together
final        ends the state that contains it, or the whole machine
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class State:
    """One state, and what is in it. Names are unique in a machine: an end state whose label others have has the name
    `<parent>.<label>`."""

    name: str
    states: tuple[State, ...] = ()
    initial: str = ""
    """The state inside that is entered if none is named; not always a direct child."""
    parallel: bool = False
    final: bool = False

    @property
    def label(self) -> str:
        """What its file calls it."""
        return label(self.name)

    @property
    def method(self) -> str:
        """What is called when it is entered: `sm_<label>`."""
        return f"sm_{self.label}"


@dataclass(frozen=True)
class Transition:
    """From one state to another; `events` are the names (`go`, `error.*`, `*`) that trigger it besides its own."""

    source: str
    target: str
    events: tuple[str, ...] = ()

    @property
    def trigger(self) -> str:
        """What fires it: `t_<source>_to_<target>`, by their labels."""
        return f"t_{self.source}_to_{label(self.target)}"


@dataclass(frozen=True)
class StateMachine:
    """Everything is in the order of its file, which decides what is entered first and which transition goes first."""

    name: str
    states: tuple[State, ...]
    initial: str
    transitions: tuple[Transition, ...] = ()

    def every_state(self) -> Iterator[State]:
        """All states, each before those in it."""
        return _within(self.states)

    def methods(self) -> list[str]:
        """The methods that are called when states are entered, without duplicates."""
        return list(dict.fromkeys(state.method for state in self.every_state()))

    def triggers(self) -> dict[str, Transition]:
        """The triggers of all transitions, by name. Transitions that differ only in their events share one."""
        found: dict[str, Transition] = {}
        for each in self.transitions:
            found.setdefault(each.trigger, each)
        return found

    def leaving(self, state: str) -> list[str]:
        """The names of the triggers of the transitions out of a state."""
        return list(dict.fromkeys(each.trigger for each in self.transitions if each.source == state))


def label(name: str) -> str:
    """The label, in its file, of the state with this name."""
    return name.rpartition(".")[2]


def _within(states: Iterable[State]) -> Iterator[State]:
    for state in states:
        yield state
        yield from _within(state.states)
