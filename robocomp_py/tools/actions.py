"""Actions of a running network, by their parts. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..contract.goal import NO_RESULT, OCTETS, GoalState
from ..contract.interface import PARTS, Action, Operation, Pattern
from ..contract.types import ExceptionType, Struct
from ..errors import Cancelled, DeclaredError
from ..spelling import closest
from ..wire import json as values
from .idsl import declared
from .network import Channel, Network, NotUnderstood

if TYPE_CHECKING:
    from ..actions.goal import Goal

_START = "-start"


@dataclass(frozen=True)
class Offered:
    """An action that a component offers."""

    name: str
    """`arm/Navigation/goTo`"""
    parts: Mapping[str, Channel]
    """By the words of `contract.interface.PARTS`; those that are not there are missing."""

    def is_meant_by(self, name: str) -> bool:
        """Whether this is its name, or a part of it between slashes."""
        return f"/{name.strip('/')}/" in f"/{self.name}/"

    @property
    def is_understood(self) -> bool:
        """Whether its parts are announced, and belong together."""
        try:
            return bool(self.action.name)
        except NotUnderstood:
            return False

    @property
    def start(self) -> Channel:
        return self.parts["start"]

    @property
    def action(self) -> Action:
        """As its parts are announced. Raises NotUnderstood."""
        return action_of(self.name, {part: each.operation for part, each in self.parts.items()})


def offered(network: Network) -> dict[str, Offered]:
    """All actions, by name."""
    found = {}
    for channel in network.channels.values():
        if channel.name.endswith(_START) and channel.providers:
            stem = channel.name.removesuffix(_START)
            parts = {each: network.channels.get(f"{stem}-{each}") for each in PARTS}
            found[stem] = Offered(stem, {each: part for each, part in parts.items() if part})
    return found


def named(network: Network, name: str) -> Offered:
    """The only action that a name means: `arm/Navigation/goTo`, or a part of it. Raises ValueError."""
    known = offered(network)
    if whole := known.get(name.strip("/")):
        return whole
    found = [each for each in known.values() if each.is_meant_by(name)]
    if len(found) == 1:
        return found[0]
    if found:
        raise ValueError(f"`{name}` may be {', '.join(each.name for each in found)}; write more of the name")
    parts = {"/".join(each.split("/")[-count:]) for each in known for count in (1, 2, 3)}
    near = closest(name.strip("/"), parts)
    hint = f"did you mean `{near}`?" if near else "`rc action list` shows all"
    raise ValueError(f"no action `{name}` is offered now; {hint}")


def action_of(name: str, operations: Mapping[str, Operation[Any]]) -> Action:
    """The action that these parts belong to. Raises NotUnderstood if they do not belong together."""
    if missing := {"start", "result", "cancel", "status"} - set(operations):
        raise NotUnderstood(f"{name} is no whole action: it lacks {', '.join(sorted(missing))}")
    start, result, told = operations["start"], operations["result"], operations.get("feedback")
    feedback = told.inputs[1].type if told and len(told.inputs) > 1 else None
    made = Action(
        start.interface,
        start.name.removesuffix(_START),
        start.inputs[2:],
        result.outputs,
        feedback if isinstance(feedback, Struct) else None,
        tuple(each for each in result.raises if each.name != NO_RESULT.name),
    )
    parts = {each.name.rpartition("-")[2]: each for each in made.parts}
    if any(part not in operations or each.text != operations[part].text for part, each in parts.items()):
        raise NotUnderstood(f"{name} is no action that this version knows")
    return made


def goals(octets: bytes, states: bytes) -> dict[bytes, GoalState]:
    """The states of all goals that a server tells, by their ids."""
    known = frozenset(map(int, GoalState))
    return {
        octets[place * OCTETS : (place + 1) * OCTETS]: GoalState(state)
        for place, state in enumerate(states)
        if state in known and len(octets) >= (place + 1) * OCTETS
    }


def outcome(goal: Goal[Any, Any], action: Action, timeout: float) -> dict[str, Any]:
    """How a goal has ended, as JSON: its `status`, and its `result`, or the `exception` that it declares with `fields`.

    Raises Timeout if it does not end within `timeout` seconds, and what it ended with if that is not declared.
    """
    try:
        result = goal.result(timeout)
    except Cancelled:
        return {"status": goal.status.name}
    except DeclaredError as exc:
        kind = getattr(type(exc), "__contract__", None)
        assert isinstance(kind, ExceptionType)
        fields = values.show_fields(kind.fields, [getattr(exc, each.attribute) for each in kind.fields])
        return {"status": goal.status.name, "exception": kind.name.replace("::", "."), "fields": fields}
    outputs = action.outputs
    given = tuple(result) if len(outputs) > 1 else (result,) * len(outputs)
    shown = values.show_fields(outputs, given)
    return {"status": goal.status.name, "result": shown["ret"] if list(shown) == ["ret"] else shown or None}


def shown_feedback(action: Action, told: Any) -> Any:
    """Feedback of a goal as JSON; None if the goal has sent no feedback."""
    if told is None or action.feedback is None:
        return None
    fields = action.feedback.fields
    return values.show_fields(fields, [getattr(told, each.attribute) for each in fields])


def told(action: Action) -> Iterator[str]:
    """An action and its types, much as an IDSL file has them."""
    inside: Operation[Any] = Operation(
        action.interface, action.name, action.inputs, action.outputs, action.raises, Pattern.QUERY
    )
    first, *rest = declared(inside)
    if action.feedback:
        fields = next(declared(Operation(action.interface, "feedback", action.feedback.fields)))
        head, throws, thrown = first.removesuffix(";").partition(" throws ")
        first = f"{head} {fields.removeprefix('void ').removesuffix(';')}{throws}{thrown};"
    yield f"[action] {first}"
    yield from rest
