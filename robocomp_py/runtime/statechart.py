"""The transition rules of a state machine, as W3C's SCXML defines them. Pure: names in, names out.

The set of active states always satisfies: an active composite state has exactly one active child, an active parallel
state has all its children active, and an inactive state has none. A step exits states from the innermost outwards, in
reverse order of the file. It enters states from the outermost inwards, in order of the file.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile

from ..contract.statemachine import State, StateMachine, Transition

_ROOT = ""
"""The name of the machine itself, as the state that contains all others."""


@dataclass(frozen=True, slots=True)
class Step:
    """The states that are left, then those that are entered, each in order."""

    left: tuple[str, ...]
    entered: tuple[str, ...]


class Chart:
    def __init__(self, machine: StateMachine) -> None:
        self._states = {_ROOT: State(_ROOT, machine.states, machine.initial)}
        self._states |= {state.name: state for state in machine.every_state()}
        self._order = {name: number for number, name in enumerate(self._states)}
        self._above: dict[str, tuple[str, ...]] = {_ROOT: ()}
        """The states that contain a state, innermost first."""
        for name, state in self._states.items():
            self._above |= {inner.name: (name, *self._above[name]) for inner in state.states}
        self._outgoing: dict[str, list[Transition]] = {name: [] for name in self._states}
        for transition in machine.transitions:
            self._outgoing[transition.source].append(transition)
        self._transitions = machine.transitions

    def begin(self) -> tuple[str, ...]:
        """The initial states, in order."""
        wanted: set[str] = set()
        self._enter(_ROOT, wanted)
        return self.ordered(wanted - {_ROOT})

    def step(self, active: Collection[str], taken: Sequence[Transition]) -> Step:
        """The step of taking these transitions: one whose source is active, or those that `chosen` returns."""
        left, wanted = set[str](), set[str]()
        for transition in taken:
            domain = self._domain(transition)
            left |= self._inside(domain, active)
            self._enter(transition.target, wanted)
            self._enter_around(transition.target, domain, wanted)
        return Step(self.ordered(left)[::-1], self.ordered(wanted))

    def chosen(self, active: Collection[str], event: str) -> list[Transition]:
        """The transitions that an event triggers: at most one for each innermost state, and no two in conflict."""
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
            if all(other.source in self._above[each.source] for other in rivals):  # the innermost source wins
                kept = [other for other in kept if other not in rivals] + [each]
        return kept

    def heard(self, event: str) -> bool:
        """Whether any transition of the machine matches this event."""
        return any(_hears(each, event) for each in self._transitions)

    def done(self, entered: Iterable[str], active: Collection[str]) -> Iterator[str]:
        """The `done.state` events of the composite and parallel states that end because these states were entered."""
        for name in entered:
            parent, *around = self._above[name]
            if self._states[name].final and parent != _ROOT:
                yield f"done.state.{parent}"
                if self._states[around[0]].parallel and self._complete(around[0], active):
                    yield f"done.state.{around[0]}"

    def ended(self, active: Collection[str]) -> bool:
        """Whether the whole machine has ended."""
        return self._complete(_ROOT, active)

    def ordered(self, names: Iterable[str]) -> tuple[str, ...]:
        """States in the order of the file: each before the states inside it."""
        return tuple(sorted(names, key=self._order.__getitem__))

    def _enter(self, name: str, wanted: set[str]) -> None:
        """Add a state to `wanted`, and the states inside it that are entered with it."""
        wanted.add(name)
        state = self._states[name]
        if state.parallel:
            self._enter_regions(state, wanted)
        elif state.states:
            self._enter(state.initial, wanted)
            self._enter_around(state.initial, name, wanted)

    def _enter_around(self, name: str, top: str, wanted: set[str]) -> None:
        """Add the states that contain a state, up to `top`, and their parallel regions."""
        for each in takewhile(lambda each: each != top, self._above[name]):
            wanted.add(each)
            if self._states[each].parallel:
                self._enter_regions(self._states[each], wanted)

    def _enter_regions(self, state: State, wanted: set[str]) -> None:
        """Add all regions of a parallel state that have no state in `wanted` yet."""
        for region in state.states:
            if not self._inside(region.name, wanted):
                self._enter(region.name, wanted)

    def _domain(self, transition: Transition) -> str:
        """The innermost composite state that contains both ends; the transition leaves all states inside it."""
        composite = (each for each in self._above[transition.source] if not self._states[each].parallel)
        return next(each for each in composite if each in self._above[transition.target])

    def _leaves(self, transition: Transition, active: Collection[str]) -> set[str]:
        return self._inside(self._domain(transition), active)

    def _inside(self, name: str, among: Iterable[str]) -> set[str]:
        return {each for each in among if name in self._above[each]}

    def _complete(self, name: str, active: Collection[str]) -> bool:
        """Whether a state has ended: a final state in it is active, in each region if it is parallel."""
        state = self._states[name]
        if state.parallel:
            return bool(state.states) and all(self._complete(region.name, active) for region in state.states)
        return any(inner.final and inner.name in active for inner in state.states)


def _hears(transition: Transition, event: str) -> bool:
    """Whether an event matches a transition: `error` and `error.*` match `error`, `error.arm`, `error.arm.hot`, …; `*`
    matches every event."""
    kinds = (each.removesuffix(".*").removesuffix(".") for each in transition.events)
    return any(kind in ("*", event) or event.startswith(f"{kind}.") for kind in kinds)
