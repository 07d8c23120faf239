"""Actions in generated code: their contracts, the methods that begin goals, and those that execute them."""

from __future__ import annotations

from ..contract.component import Port
from ..contract.interface import Action, Interface, Operation
from ..contract.naming import goal_class
from .expressions import accepted, contract, field_literals, hint, operation_doc, returns, zero
from .layout import call, docstring, quoted, signature, spread, tuple_of
from .names import argument, class_name, method, module_name, module_of, operation_constant, reference, short
from .shadows import Shadows


def as_operation(action: Action) -> Operation[object]:
    """The operation that it would be if it did not take long."""
    return Operation(
        action.interface,
        action.name,
        action.inputs,
        action.outputs,
        action.raises,
        doc=action.doc,
        source=action.source,
    )


def own_goals(interface: Interface) -> list[Action]:
    """The actions for which the module of the interface has a class of goals."""
    return [each for each in interface.actions if each.feedback and not each.origin]


def server_goal(action: Action, here: str) -> str:
    """The class of what its handler gets of a goal."""
    if action.feedback is None:
        return "ServerGoal"
    origin = action.origin or action.interface
    name, module = goal_class(short(origin), action.name), module_of(origin)
    return class_name(name) if module == here else f"{module_name(module)}.{class_name(name)}"


def goal_signature(action: Action, here: str) -> str:
    """`def feedback(self, left: float) -> None:`."""
    assert action.feedback
    given = [f"{each.attribute}: {accepted(each.type, here)}" for each in action.feedback.fields]
    return signature("feedback", ["self", *given], "None")


def goal_fed(action: Action, here: str) -> str:
    """`self._tell(NavigationGoToFeedback(left))`."""
    assert action.feedback
    values = [each.attribute for each in action.feedback.fields]
    return f"self._tell({call(reference(action.feedback.name, here), values, 8, 12)})"


def action_statement(action: Action, here: str) -> str:
    """`_Navigation_goTo = _actions.Action( … )`."""
    arguments = [quoted(action.interface), quoted(action.name)]
    for key, fields in (("inputs", action.inputs), ("outputs", action.outputs)):
        if fields:
            arguments.append(f"{key}={tuple_of(field_literals(fields, here), 5 + len(key), 4)}")
    if action.feedback:
        arguments.append(f"feedback={reference(action.feedback.name, here)}.__contract__")
    if action.raises:
        arguments.append(f"raises={tuple_of([contract(each, here) for each in action.raises], 11, 4)}")
    if action.origin:
        arguments.append(f"origin={quoted(action.origin)}")
    if action.feedback:
        arguments.append(f"goal={server_goal(action, here)}")
    arguments += ["confirm=True"] if action.confirm else []
    arguments += [f"doc={quoted(action.doc)}"] if action.doc else []
    inner = "".join(f"    {each},\n" for each in arguments)
    return f"{action_constant(action)} = _actions.Action(\n{inner})"


def action_constant(action: Action) -> str:
    return operation_constant(as_operation(action))


def client_goal(action: Action, here: str) -> str:
    """`_actions.Goal[Arrival, NavigationGoToFeedback]`."""
    feedback = reference(action.feedback.name, here) if action.feedback else "None"
    return f"_actions.Goal[{returns(as_operation(action), here)}, {feedback}]"


def action_signature(action: Action, here: str, shadows: Shadows) -> str:
    """`def goTo(self, target: Place, *, detached: bool = False, …) -> _actions.Goal[Arrival, …]:`."""
    arguments = ["self"]
    for field in action.inputs:
        annotation = shadows.avoid(accepted(field.type, here))
        default = f" = {shadows.avoid(zero(field.type, here, field.default))}" if field.default is not None else ""
        arguments.append(f"{argument(field)}: {annotation}{default}")
    arguments += ["*", f"detached: {shadows.avoid('bool')} = False"]
    arguments += [f"deadline: {shadows.avoid('float')} | None = None"]
    return signature(method(as_operation(action)), arguments, shadows.avoid(client_goal(action, here)))


def action_doc(action: Action) -> str:
    return operation_doc(as_operation(action))


def action_begun(action: Action) -> str:
    """`return self._begin(_Navigation_goTo, (target,), detached, deadline)`."""
    names = [argument(each) for each in action.inputs]
    given = f"({', '.join(names)}{',' if len(names) == 1 else ''})"
    return "return " + call("self._begin", [action_constant(action), given, "detached", "deadline"], 8, 7)


def add_actions(shadows: Shadows, interface: Interface, here: str) -> Shadows:
    """Add the methods that begin goals to those of a proxy."""
    for action in interface.actions:
        uses = [accepted(each.type, here) for each in action.inputs]
        uses += [zero(each.type, here, each.default) for each in action.inputs if each.default is not None]
        shadows.member(method(as_operation(action)), " ".join([*uses, client_goal(action, here), "bool", "float"]))
    return shadows


def steps_signature(port: Port, action: Action) -> str:
    """`def Navigation_goTo(self, goal: …, target: …) -> Generator[None, None, …]:`."""
    given = [f"{argument(each)}: {hint(each.type, '')}" for each in action.inputs]
    value = returns(as_operation(action), "")
    returned = "Generator[None]" if value == "None" else f"Generator[None, None, {value}]"
    return signature(port.handler(action.name), ["self", f"goal: {server_goal(action, '')}", *given], returned)


def steps_doc(action: Action) -> str:
    return (
        f"{action_doc(action)}\n\nEach `yield` waits for the next `compute`, and raises Cancelled if the goal is "
        "cancelled."
    )


def steps_method(port: Port, action: Action) -> str:
    """A new handler of an action, which succeeds at the second `compute`."""
    lines = [steps_signature(port, action), f"    {docstring(steps_doc(action), 8)}", "    yield"]
    zeros = [zero(output.type, "") for output in action.outputs]
    lines += [f"    return {', '.join(zeros)}"] if zeros else []
    return "".join(f"    {line}\n" for line in lines)


def fake_of_action(action: Action, shadows: Shadows) -> str:
    """`goTo: Fake[RoboCompNavigation.Arrival]`."""
    returned = shadows.avoid(returns(as_operation(action), ""))
    return f"{action.name}: {shadows.avoid('Fake')}{spread(f'[{returned}]', 4, len(action.name) + 6, 0)}"
