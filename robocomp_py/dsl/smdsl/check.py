"""Model to diagnostics: states that are missing, duplicate or unreachable."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from ...contract.statemachine import label
from ..diagnostics import Proposals, Report
from ..source import Name, Span
from ..syntax import MAX_NESTING
from . import model as m
from .ends import resolved, shared

_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def check(file: m.File, report: Report) -> None:
    """Report the errors in a file."""
    found, ends = Report(), shared(file)
    file = resolved(file)
    _Checker(file, found, ends).check()
    if not any(each.span.source is file.source for each in (*report.errors, *found.errors)):
        _check_reach(file, found)
    report.extend(found.diagnostics)


@dataclass
class _Checker:
    file: m.File
    report: Report
    ends: dict[str, dict[str, str]]
    """See `shared`."""
    states: dict[str, m.State] = field(default_factory=dict)
    around: dict[str, str] = field(default_factory=dict)
    """The parent of each state; "" for those of the machine itself."""
    told: set[Span] = field(default_factory=set)
    """Names that are already reported: the source of several transitions is reported once."""

    def check(self) -> None:
        self.propose = Proposals()
        self.is_scxml = self.file.source.path.suffix.lower() == ".scxml"
        self.parallel = {block.parent.text for block in self.file.blocks if block.parent and block.parallel}
        for block in self.file.blocks:
            for state in block.states:
                self._check_state(state, block)
        parents: dict[str, Name] = {}
        for block in self.file.blocks:
            self._check_block(block)
            if block.parent:
                self._check_parent(block.parent, parents)
        self._check_transitions([each for block in self.file.blocks for each in block.transitions])

    def _check_state(self, state: m.State, block: m.Block) -> None:
        name = state.name
        first = self.states.setdefault(name.text, state).name
        if first is not name:
            here = any(first is other.name for other in block.states)
            hint = "" if here else "names of states are unique in a machine"
            if here and (first in block.initial or state.final):
                clause = "initial_state" if first in block.initial else "end_state"
                hint = f"`{clause}` says that it exists: do not list it under `states`, too"
            self.report.error(
                "duplicate", f"state `{name}` is defined twice", name.span, hint, ("first here", first.span)
            )
            return
        self.around[name.text] = block.parent.text if block.parent else ""
        if not _IDENTIFIER.fullmatch(name.text if self.is_scxml else label(name.text)):
            message = f"`{name}` cannot be part of a name in Python: `sm_{name}`"
            hint = f"call it `{re.sub('[^A-Za-z0-9_]', '_', name.text)}`"
            self.report.error("bad-state-name", message, name.span, hint)

    def _check_parent(self, parent: Name, seen: dict[str, Name]) -> None:
        first = seen.setdefault(parent.text, parent)
        if first is not parent:
            message = f"the inside of `{parent}` is defined twice"
            self.report.error("duplicate", message, parent.span, "make it one block", ("first here", first.span))
            return
        state = self._known(parent)
        if state and state.final:
            message = f"`{parent}` is an end state: nothing can be in it"
            self.report.error("leaves-end-state", message, parent.span, "", ("declared as one here", state.name.span))
        around = self._all_around(parent.text)
        if len(around) > MAX_NESTING:
            self.report.error("too-deep", f"nested deeper than {MAX_NESTING} levels", parent.span)
        elif state and parent.text in around:
            message = f"`{parent}` is inside itself, directly or indirectly"
            self.report.error("state-in-itself", message, parent.span, "", ("declared here", state.name.span))

    def _check_block(self, block: m.Block) -> None:
        what = f"`{block.parent}`" if block.parent else f"the machine `{self.file.name}`"
        at = block.parent.span if block.parent else self.file.name.span
        finals = [state.name for state in block.states if state.final]
        if block.parallel:
            for name in (*block.initial, *finals):
                clause = "initial state" if name in block.initial else "end state"
                message = f"{what} is parallel, so it has no {clause}: all its states are active together"
                hint = "make it a `<state>`" if self.is_scxml else "list it under `states`"
                self.report.error("clause-of-parallel", message, name.span, hint)
            if not block.states:
                hint = "put some into it, or make it a `<state>`" if self.is_scxml else "list them: `states a, b;`"
                self.report.error("no-states", f"{what} is parallel, but has no states", at, hint)
        elif not block.initial and not {"initial_state", "initial"} & self.file.skipped:
            hint = "add one: `initial_state begin;`"
            self.report.error("no-initial-state", f"{what} has no initial state", at, hint)
        for extra in () if block.parallel else block.initial[1:]:
            related = ("first here", block.initial[0].span)
            self.report.error(
                "duplicate", f"{what} has two initial states", extra.span, "list it under `states`", related
            )
        for name in block.initial:
            inside = block.parent.text if block.parent else ""
            if self._known(name) and inside not in self._all_around(name.text):
                self.report.error("unknown-state", f"`{name}` is not inside of {what}", name.span)

    def _check_transitions(self, transitions: list[m.Transition]) -> None:
        seen: dict[tuple[str, str, tuple[str, ...]], m.Transition] = {}
        triggers: dict[str, m.Transition] = {}
        for each in transitions:
            source, target = self._known(each.source), self._known(each.target)
            if source and source.final and each.source.span not in self.told:
                self.told.add(each.source.span)
                message = f"`{each.source}` is an end state: nothing leads out of it"
                self.report.error("leaves-end-state", message, each.source.span, "", ("said here", source.name.span))
            first = seen.setdefault((each.source.text, each.target.text, each.events), each)
            if first is not each:
                message, related = (
                    f"`{each.source} => {each.target}` is defined twice",
                    ("first here", first.target.span),
                )
                self.report.warning("repeated-transition", message, each.target.span, "remove it", related)
                continue
            trigger = f"t_{each.source}_to_{label(each.target.text)}"
            other = triggers.setdefault(trigger, each)
            if (other.source.text, other.target.text) != (each.source.text, each.target.text):
                message = f"this and `{other.source} => {other.target}` are both called `{trigger}` in Python"
                related = ("first here", other.target.span)
                self.report.error("same-attribute", message, each.target.span, "rename a state", related)
            if source and target:
                self._check_regions(each)

    def _check_regions(self, transition: m.Transition) -> None:
        """Warn about a transition between states that are active together."""
        source, target = (
            [*[*self._all_around(end.text)][::-1], end.text] for end in (transition.source, transition.target)
        )
        for outer, one, other in zip(source, source[1:], target[1:], strict=False):
            if one != other:
                if outer in self.parallel:
                    message = (
                        f"`{one}` and `{other}` are active together: this leaves `{outer}` and enters all of it again"
                    )
                    self.report.warning("between-regions", message, transition.target.span)
                return

    def _all_around(self, name: str) -> dict[str, None]:
        """The ancestors of a state, innermost first, then "" for the machine itself; limited in number."""
        found: dict[str, None] = {}
        while name and (around := self.around.get(name)) is not None and around not in found:
            if len(found) > MAX_NESTING:
                break
            found[around] = None
            name = around
        return found

    def _known(self, name: Name) -> m.State | None:
        state = self.states.get(name.text)
        if name.text in self.ends and state is None:
            return self._known_end(name)
        if state is None and name.text not in self.file.skipped and name.span not in self.told:
            self.told.add(name.span)
            add = f'add it: `<state id="{name}"/>`' if self.is_scxml else "list it under `states`"
            hint = self.propose(name.text, self.states) or add
            self.report.error("unknown-state", f"there is no state `{name}`", name.span, hint)
        return state

    def _known_end(self, name: Name) -> m.State:
        """Report a name that several end states share, if its place does not decide which one is meant."""
        parents = self.ends[name.text]
        state = self.states[next(iter(parents.values()))]
        is_target = any(name is each.target for block in self.file.blocks for each in block.transitions)
        if is_target and name.span not in self.told:
            self.told.add(name.span)
            message = f"there are end states `{name}` of {' and of '.join(f'`{each}`' for each in parents)}"
            hint = "a transition leads to that of a state around its source: give the one you mean another name"
            self.report.error("unknown-state", message, name.span, hint)
        return state


def _check_reach(file: m.File, report: Report) -> None:
    """Warn about states that no sequence of transitions leads to."""
    inside = {block.parent.text if block.parent else "": block for block in file.blocks}
    around = {state.name.text: name for name, block in inside.items() for state in block.states}
    leading: dict[str, list[str]] = {}
    for each in (each for block in file.blocks for each in block.transitions):
        leading.setdefault(each.source.text, []).append(each.target.text)
    reached: set[str] = set()
    waiting = [""]
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting += [*leading.get(name, []), *([around[name]] if name else []), *_entered_in(inside.get(name))]
    for block in file.blocks:
        for state in block.states:
            if state.name.text not in reached and around[state.name.text] in reached:
                message = f"nothing leads to `{state.name}`"
                report.warning("unreachable-state", message, state.name.span, "add a transition to it, or remove it")


def _entered_in(block: m.Block | None) -> Iterator[str]:
    """The states that are entered together with their parent."""
    if block and block.parallel:
        yield from (state.name.text for state in block.states)
    elif block:
        yield from (name.text for name in block.initial)
