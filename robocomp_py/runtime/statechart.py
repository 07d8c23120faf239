"""The rules by which a state machine moves, as W3C's SCXML has them. Names in, names out; nothing happens here.

What is active (a configuration) is always: of a composite state that is active, exactly one state in it; of a
parallel one, all; of one that is not active, none. A step leaves states from the inside out, last in the file first,
and enters states from the outside in, first in the file first.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile

from ..contract.statemachine import State, StateMachine, Transition

_ROOT = ""
"""Stands for the machine itself, as the state that all the others are in."""


@dataclass(frozen=True, slots=True)
class Step:
    """What is left, then what is entered, each in order."""

    left: tuple[str, ...]
    entered: tuple[str, ...]


class Chart:
    def __init__(self, machine: StateMachine) -> None:
        self._states = {_ROOT: State(_ROOT, machine.states, machine.initial)}
        self._states |= {state.name: state for state in machine.every_state()}
        self._order = {name: number for number, name in enumerate(self._states)}
        self._above: dict[str, tuple[str, ...]] = {_ROOT: ()}
        """The states that a state is in, innermost first."""
        for name, state in self._states.items():
            self._above |= {inner.name: (name, *self._above[name]) for inner in state.states}
        self._outgoing: dict[str, list[Transition]] = {name: [] for name in self._states}
        for transition in machine.transitions:
            self._outgoing[transition.source].append(transition)
        self._transitions = machine.transitions

    def begin(self) -> tuple[str, ...]:
        """What is entered first, in order."""
        wanted: set[str] = set()
        self._enter(_ROOT, wanted)
        return self.ordered(wanted - {_ROOT})

    def step(self, active: Collection[str], taken: Sequence[Transition]) -> Step:
        """What taking these transitions does: one whose source is active, or those `chosen`."""
        left, wanted = set[str](), set[str]()
        for transition in taken:
            domain = self._domain(transition)
            left |= self._inside(domain, active)
            self._enter(transition.target, wanted)
            self._enter_around(transition.target, domain, wanted)
        return Step(self.ordered(left)[::-1], self.ordered(wanted))

    def chosen(self, active: Collection[str], event: str) -> list[Transition]:
        """The transitions that an event has taken: at most one for each innermost state, none in the way of another."""
        found: dict[Transition, None] = {}
        for name in self.ordered(active):
            if not self._states[name].states:
                heard = (
                    each for at in (name, *self._above[name]) for each in self._outgoing[at] if _hears(each, event)
                )
                found |= dict.fromkeys([*heard][:1])
        kept: list[Transition] = []
        for each in found:
            rivals = [other for other in kept if self._leaves(each, active) & self._leaves(other, active)]
            if all(other.source in self._above[each.source] for other in rivals):  # what is further inside wins
                kept = [other for other in kept if other not in rivals] + [each]
        return kept

    def heard(self, event: str) -> bool:
        """Whether any transition waits for such an event."""
        return any(_hears(each, event) for each in self._transitions)

    def done(self, entered: Iterable[str], active: Collection[str]) -> Iterator[str]:
        """The events that tell of composite and parallel states that have come to their end by entering these."""
        for name in entered:
            parent, *around = self._above[name]
            if self._states[name].final and parent != _ROOT:
                yield f"done.state.{parent}"
                if self._states[around[0]].parallel and self._complete(around[0], active):
                    yield f"done.state.{around[0]}"

    def ended(self, active: Collection[str]) -> bool:
        """Whether the machine as a whole has come to its end."""
        return self._complete(_ROOT, active)

    def ordered(self, names: Iterable[str]) -> tuple[str, ...]:
        """As they stand in the file: each before what is in it."""
        return tuple(sorted(names, key=self._order.__getitem__))

    def _enter(self, name: str, wanted: set[str]) -> None:
        """Want a state, and those in it that are entered with it."""
        wanted.add(name)
        state = self._states[name]
        if state.parallel:
            self._enter_regions(state, wanted)
        elif state.states:
            self._enter(state.initial, wanted)
            self._enter_around(state.initial, name, wanted)

    def _enter_around(self, name: str, top: str, wanted: set[str]) -> None:
        """Want what a state is in, below `top`, and the regions beside it."""
        for each in takewhile(lambda each: each != top, self._above[name]):
            wanted.add(each)
            if self._states[each].parallel:
                self._enter_regions(self._states[each], wanted)

    def _enter_regions(self, state: State, wanted: set[str]) -> None:
        """Want all regions of a state that are not wanted yet."""
        for region in state.states:
            if not self._inside(region.name, wanted):
                self._enter(region.name, wanted)

    def _domain(self, transition: Transition) -> str:
        """The innermost composite state that has both ends in it: all inside of it is left."""
        composite = (each for each in self._above[transition.source] if not self._states[each].parallel)
        return next(each for each in composite if each in self._above[transition.target])

    def _leaves(self, transition: Transition, active: Collection[str]) -> set[str]:
        return self._inside(self._domain(transition), active)

    def _inside(self, name: str, among: Iterable[str]) -> set[str]:
        return {each for each in among if name in self._above[each]}

    def _complete(self, name: str, active: Collection[str]) -> bool:
        """Whether a state has come to its end: one that it ends with is active, in all its regions if it has those."""
        state = self._states[name]
        if state.parallel:
            return bool(state.states) and all(self._complete(region.name, active) for region in state.states)
        return any(inner.final and inner.name in active for inner in state.states)


def _hears(transition: Transition, event: str) -> bool:
    """`error` and `error.*` stand for all of `error`, `error.arm` and `error.arm.hot`, `*` for everything."""
    kinds = (each.removesuffix(".*").removesuffix(".") for each in transition.events)
    return any(kind in ("*", event) or event.startswith(f"{kind}.") for kind in kinds)
