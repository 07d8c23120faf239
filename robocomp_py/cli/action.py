"""`rc action`: goals of components that run."""

from __future__ import annotations

import argparse
import json
import queue
import sys
import time
from typing import TYPE_CHECKING, Any

from .common import FINE, INTERRUPTED, USAGE, WRONG, describe, print_table
from .completing import What, completed
from .hosts import add_hosts, code_of, hosts_of
from .live import (
    Absent,
    Wrong,
    add_definitions,
    add_json,
    add_middleware,
    add_request,
    add_waiting,
    add_yes,
    allowed,
    awaited,
    check_one_host,
    positive,
    reported,
    request_of,
    spelled,
)

if TYPE_CHECKING:
    from ..actions.goal import Goal
    from ..contract.goal import GoalState
    from ..contract.interface import Action
    from ..tools.actions import Offered
    from ..tools.hosts import Hosts
    from ..tools.network import Network

NAME = "action"

_EXAMPLES = """\
examples:
  rc action list                                  the actions that are offered now
  rc action info Navigation/goTo                  its types, and the goals that its server knows
  rc action send goTo target.x=3 target.y=0       begin a goal; print its feedback and its result
  rc action send goTo @where.json --detach        ... and leave it
  rc action cancel goTo 1f0c                      cancel the goal whose id begins so
  rc action cancel goTo                           ... all goals of the action

Ctrl-C cancels the goal of `rc action send`; a second Ctrl-C does not wait for its end.

exit status: 0 done (the goal has succeeded), 1 nothing is there, or the goal failed or was cancelled, 2 usage,
130/143 by a signal
"""

_LOOK = 0.1
"""Seconds between two looks at whether a goal is over."""

_WAITING = 1000
"""Messages of feedback that may wait to be printed."""

_LATCHED = 1.0
"""Seconds within which a server that has had goals tells their states."""

_CANCELLING = 5.0
"""Seconds for a cancelled goal to end."""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Begin, watch and cancel goals of actions that components offer."
    to.epilog = _EXAMPLES
    commands = to.add_subparsers(dest="does", metavar="COMMAND", required=True)

    def command(name: str, about: str) -> argparse.ArgumentParser:
        made = commands.add_parser(name, help=about)
        describe(made, about, to)
        return made

    listing = command("list", "list the actions that are offered now")
    info = command("info", "show the types of an action, and the goals that its server knows")
    send = command("send", "begin a goal; print its feedback and its result")
    cancel = command("cancel", "cancel one goal of an action, or all of them")
    for each in (info, send, cancel):
        about = "arm/Navigation/goTo, or an unambiguous part of such a name"
        completed(each.add_argument("action", metavar="NAME", help=about), What.ACTION)
    add_request(send)
    add_yes(send)
    send.add_argument("--detach", action="store_true", help="return when the goal is accepted; it goes on")
    send.add_argument("--for", dest="seconds", type=positive, metavar="SECONDS", help="cancel the goal after this time")
    cancel.add_argument("goal", nargs="?", default="", metavar="ID", help="the beginning of its id (default: all)")
    for each in (info, send, cancel):
        add_definitions(each)
        add_waiting(each)
    for each in (listing, info, send, cancel):
        add_hosts(each)
        add_middleware(each)
        add_json(each)


def run(options: argparse.Namespace) -> int:
    does = {"list": _list, "info": _info, "send": _send, "cancel": _cancel}
    with reported(f"rc action {options.does}") as code, hosts_of(options) as hosts:
        return does[options.does](options, hosts)
    return code()


def _list(options: argparse.Namespace, hosts: Hosts) -> int:
    from ..tools.actions import offered

    found = offered(hosts.census(options.middleware)).values()
    rows = []
    for each in found:
        provided = list(dict.fromkeys(end.told.owner or "?" for end in each.start.providers))
        used = list(dict.fromkeys(end.told.owner or "?" for end in each.start.users))
        if options.json:
            listed = {"action": each.name, "middlewares": each.start.middlewares, "providers": provided, "users": used}
            print(json.dumps(listed))
        rows.append((each.name, ", ".join(each.start.middlewares), ", ".join(provided), ", ".join(used)))
    if rows and not options.json:
        print_table(("action", "over", "provided by", "used by"), rows, wrapped=("provided by", "used by"))
    if not rows:
        print(f"rc action list: no action is offered {'there' if hosts.posts else 'on this host'}", file=sys.stderr)
    return code_of(hosts, FINE if rows else WRONG)


def _info(options: argparse.Namespace, hosts: Hosts) -> int:
    from .info import described_action, told_action

    offered = _awaited(options, hosts)
    goals = _goals(offered)
    if options.json:
        print(json.dumps(told_action(offered) | {"goals": {goal.hex(): state.name for goal, state in goals.items()}}))
        return FINE
    for line in described_action(offered):
        print(line)
    for goal, state in goals.items():
        print(f"  goal {goal.hex()}: {state.name}")
    return FINE


def _cancel(options: argparse.Namespace, hosts: Hosts) -> int:
    from ..contract.goal import GoalState
    from ..tools.access import Access

    offered = _awaited(options, hosts)
    action = offered.action
    known = _goals(offered)
    wanted = {goal: state for goal, state in known.items() if goal.hex().startswith(options.goal.lower())}
    active = [goal for goal, state in wanted.items() if not state.is_over]
    if not active:
        raise Absent(_no_goal(offered.name, options.goal, wanted))
    if options.goal and len(active) > 1:
        listed = ", ".join(each.hex()[:8] for each in active)
        raise Absent(f"`{options.goal}` may be {listed}; write more of the id")
    with Access() as access:
        for goal in active:
            (state,) = access.ask(offered.parts["cancel"], (list(goal),), options.timeout)
            if options.json:
                print(json.dumps({"goal": goal.hex(), "status": GoalState(state).name}))
            else:
                print(f"{action.name} {goal.hex()[:8]}: {GoalState(state).name}")
    return FINE


def _no_goal(name: str, given: str, known: dict[bytes, GoalState]) -> str:
    if given and known:
        goal, state = next(iter(known.items()))
        return f"goal {goal.hex()[:8]} of {name} is over: {state.name}"
    return f"{name} has no goal {given}" if given else f"{name} has no goal that could be cancelled"


def _send(options: argparse.Namespace, hosts: Hosts) -> int:
    from ..client.goals import Action as Sending
    from ..client.session import Session
    from ..tools import asking
    from ..tools.access import Access
    from ..tools.network import TOOL

    network, offered = awaited(options, lambda network: (network, _picked(network, options)), hosts)
    action = offered.action
    with Access() as access:
        about = asking.about(access, network, offered.start)
    taken = request_of(offered.name, action.inputs, options.arguments, "rc action send", about)
    if taken is None:
        return USAGE
    if refused := allowed(offered.start, about, "rc action send", yes=options.yes):
        return refused
    feedback: queue.Queue[tuple[bytes, Any]] = queue.Queue(_WAITING)
    session = Session("", options.middleware, options.timeout, TOOL)
    try:
        sending = Sending(session, offered, lambda goal, told: _note(feedback, goal, told))
        goal = sending(*taken, detached=options.detach)
        _say(options, f"goal {goal.id.hex()[:8]} of {offered.name}: accepted", goal=goal.id.hex())
        return FINE if options.detach else _follow(goal, action, feedback, options)
    finally:
        session.close()


def _note(feedback: queue.Queue[tuple[bytes, Any]], goal: bytes, told: Any) -> None:
    """On a thread of the transport: it never waits."""
    if not feedback.full():
        feedback.put_nowait((goal, told))


def _follow(
    goal: Goal[Any, Any], action: Action, feedback: queue.Queue[tuple[bytes, Any]], options: argparse.Namespace
) -> int:
    """Print what a goal tells until it is over. Cancel it at Ctrl-C, and when its time is over."""
    interrupted = False
    end = time.monotonic() + options.seconds if options.seconds else None
    try:
        while not goal.done:
            _print_feedback(goal, action, feedback, options)
            if end and time.monotonic() > end:
                _say(options, f"not over in {options.seconds:g} s; cancelling the goal")
                end = None
                goal.cancel()
    except KeyboardInterrupt:
        interrupted = True
        _say(options, "cancelling the goal; Ctrl-C again does not wait for its end")
        goal.cancel()
        while not goal.done:
            _print_feedback(goal, action, feedback, options)
    while not feedback.empty():
        _print_feedback(goal, action, feedback, options)
    code = _outcome(goal, action, options)
    return INTERRUPTED if interrupted else code


def _print_feedback(
    goal: Goal[Any, Any], action: Action, feedback: queue.Queue[tuple[bytes, Any]], options: argparse.Namespace
) -> None:
    """Print the next feedback of this goal, if one comes soon."""
    from ..tools.actions import shown_feedback

    try:
        identity, told = feedback.get(timeout=_LOOK)
    except queue.Empty:
        return
    if identity == goal.id and action.feedback:
        shown = shown_feedback(action, told)
        line = json.dumps({"feedback": shown}) if options.json else f"feedback {spelled(shown)}"
        print(f"{line}\n", end="", flush=True)  # in one piece: after Ctrl-C, more is printed


def _outcome(goal: Goal[Any, Any], action: Action, options: argparse.Namespace) -> int:
    """Print how a goal has ended; its result, or the exception that it has ended with."""
    from ..tools.actions import outcome

    told = outcome(goal, action, _CANCELLING)
    if "exception" in told:
        print(f"rc action send: {told['exception']}: {spelled(told['fields'])}", file=sys.stderr)
    if options.json:
        print(json.dumps(told))
    elif "result" in told:
        print(told["status"], *([spelled(told["result"])] if action.outputs else []))
    elif "exception" not in told:
        print(told["status"])
    return FINE if "result" in told else WRONG


def _say(options: argparse.Namespace, text: str, **told: str) -> None:
    """News for people on stderr, or for machines on stdout."""
    if options.json and told:
        print(json.dumps(told), flush=True)
    elif not options.json:
        print(text, file=sys.stderr if not told else sys.stdout, flush=True)


def _awaited(options: argparse.Namespace, hosts: Hosts) -> Offered:
    """The action of this name, once it is there. Raises Absent."""
    return awaited(options, lambda network: _picked(network, options), hosts)


def _picked(network: Network, options: argparse.Namespace) -> Offered:
    from ..tools.actions import named

    try:
        found = named(network, options.action)
    except ValueError:
        if told := _no_action(network, options.action):
            raise Wrong(told) from None
        raise
    check_one_host(found.name, found.parts.values())
    return found


def _no_action(network: Network, name: str) -> str:
    """The message if the name is that of an operation which is no action; otherwise ""."""
    from ..contract.interface import Pattern

    for each in network.channels.values():
        if f"/{each.name}".endswith(f"/{name.strip('/')}") and each.providers and "-" not in name:
            is_topic = each.pattern is Pattern.PUBLISH
            what, use = ("topic", "`rc echo` prints it") if is_topic else (each.pattern, "`rc call` calls it")
            return f"`{name}` is no action: {each.name} is a {what}; {use}"
    return ""


def _goals(offered: Offered) -> dict[bytes, GoalState]:
    """The goals that the server of an action tells; none if it has never had one."""
    from ..tools.actions import goals
    from ..tools.tap import tap
    from ..wire import json as values

    channel = offered.parts["status"]
    with tap([channel]) as tapping:
        message = tapping.take(_LATCHED)
    if not message:
        return {}
    return goals(*map(bytes, values.take_fields(channel.operation.inputs, message.message, channel.name)))
