"""What agents ask of a running network, as plain functions: each takes JSON and returns JSON.

Nothing is done that the network does not allow, and everything is written down before it is answered.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from ...contract.interface import Pattern
from ...errors import RobocompError, Unreachable
from ...printable import printable
from ...spelling import closest, unknown
from ...wire import json as values
from ...wire import names
from .. import asking, params
from ..access import Access, ThrownError
from ..actions import Offered, offered
from ..actions import told as shown_contract
from ..idsl import declared
from ..network import Channel, Network, NotUnderstood
from ..publishing import publish
from ..tap import Lost, Message, tapped
from .bounds import Bounds, Rate, Refused, fitted
from .goals import Begin, Goals
from .permissions import Permissions

OWN_INSTANCE = "rc-mcp"
"""The publisher of topics that nothing else publishes."""

_LOGGED = 500
"""Characters of the arguments of a request in the log."""


@dataclass(frozen=True)
class Answer:
    """As JSON. `failed`: a text that says why."""

    text: str
    failed: bool = False


class Requests:
    """Answers the requests of one agent, from any thread."""

    def __init__(
        self,
        access: Access,
        census: Callable[[], Network],
        permissions: Permissions,
        write: Callable[[str, str], object],
        begin: Begin,
        bounds: Bounds | None = None,
    ) -> None:
        """`census` tells what runs now; `write` gets a level and a line for the log, from any thread."""
        self._access, self._census, self._permissions = access, census, permissions
        self._write, self.bounds = write, bounds or Bounds()
        self._goals = Goals(begin, write, self.bounds)
        self._lock = threading.Lock()
        self._calls = Rate(self.bounds.calls_a_minute, "calls")
        self._reads = Rate(self.bounds.reads_a_minute, "requests")
        self._known: dict[str, Callable[[Mapping[str, Any]], Any]] = {
            "list_components": self._list_components,
            "list_channels": self._list_channels,
            "describe": self._describe,
            "read_topic": self._read_topic,
            "read_parameters": self._read_parameters,
            "read_measures": self._read_measures,
            "call": self._call,
            "begin_goal": self._begin_goal,
            "read_goal": self._read_goal,
            "cancel_goal": self._cancel_goal,
            "publish": self._publish,
        }

    @property
    def allowed(self) -> Permissions:
        """What the network allows."""
        return self._permissions

    def close(self) -> None:
        """Goals are no longer watched. They are cancelled by what has begun them."""
        self._goals.close()

    def answer(self, request: str, arguments: Mapping[str, Any]) -> Answer:
        """The answer to a request, within the bounds. Raises nothing that an agent or the network can cause."""
        begun = time.monotonic()
        try:
            answer = Answer(self._answered(request, arguments))
        except Refused as exc:
            return self.refuse(request, arguments, str(exc))
        except (RobocompError, ValueError) as exc:
            answer = Answer(printable(str(exc)) or type(exc).__name__, failed=True)
        result = f"failed: {answer.text[:_LOGGED]}" if answer.failed else "answered"
        took = time.monotonic() - begun
        self._write("WARNING" if answer.failed else "INFO", f"{_line(request, arguments)}: {result} ({took:.3f} s)")
        return answer

    def refuse(self, request: str, arguments: Mapping[str, Any], why: str) -> Answer:
        """The answer to what may not be asked. It is written down, too."""
        text = printable(why)
        self._write("WARNING", f"{_line(request, arguments)}: refused: {text[:_LOGGED]}")
        return Answer(text, failed=True)

    def _answered(self, request: str, arguments: Mapping[str, Any]) -> str:
        known = self._known.get(request)
        if known is None:
            raise Refused(unknown("tool", request, self._known))
        if len(_spelled(arguments)) > self.bounds.octets_in:
            raise Refused(f"the arguments are longer than {self.bounds.octets_in} characters")
        with self._lock:
            self._reads.take()
        text, is_cut = fitted(known(arguments), self.bounds.octets_out)
        if is_cut:
            text = json.dumps({"cut": "long arrays and texts are shortened", "answer": json.loads(text)})
        return text

    # What runs.

    def _network(self) -> tuple[Network, dict[str, Channel], dict[str, Offered]]:
        """All that runs; and of this network the channels by name, and the actions, whose parts are no channels."""
        network = self._census()
        actions = {name: each for name, each in offered(network).items() if self._is_own(name)}
        parts = {each.name for action in actions.values() for each in action.parts.values()}
        return (
            network,
            {
                name: each
                for name, each in network.channels.items()
                if self._is_own(name) and each.providers and name not in parts
            },
            actions,
        )

    def _is_own(self, channel: str) -> bool:
        return self._permissions.has(channel.rsplit("/", 2)[0])

    def _list_components(self, arguments: Mapping[str, Any]) -> Any:
        network, channels, _ = self._network()
        owners = {end.told.owner for each in channels.values() for end in each.ends}
        found = []
        for each in network.components():
            if each.owner in owners or self._permissions.has(each.owner):
                told = asdict(each)
                found.append({"component": told.pop("owner"), **told})
        listed = {each["component"] for each in found}
        silent = [each for each in asking.components(network) if self._permissions.has(each) and each not in listed]
        found += [{"component": each, "offers": [], "uses": []} for each in silent]
        may = self._permissions
        return {
            "network": may.network,
            "components": found,
            "may_be_called": list(may.calls),
            "goals_may_be_begun": list(may.goals),
            "may_be_published": list(may.publications),
        }

    def _list_channels(self, arguments: Mapping[str, Any]) -> Any:
        kind, part = str(arguments.get("kind", "")), str(arguments.get("contains", ""))
        kinds = (*_KINDS.values(), _ACTION)
        if kind and kind not in kinds:
            raise Refused(unknown("kind", kind, kinds))
        network, channels, actions = self._network()
        published = {each.name for several in self._hearing(network).values() for each in several}
        found = []
        for each in channels.values():
            is_topic = each.pattern is Pattern.PUBLISH
            may = each.name in (published if is_topic else self._permissions.calls)
            word = "may_be_published" if is_topic else "may_be_called"
            found.append({"channel": each.name, "kind": _KINDS[each.pattern], **_ends(each), word: may})
        for name, action in actions.items():
            may = name in self._permissions.goals
            found.append({"channel": name, "kind": _ACTION, **_ends(action.start), "goals_may_be_begun": may})
        return [each for each in found if kind in ("", each["kind"]) and part in str(each["channel"])]

    def _describe(self, arguments: Mapping[str, Any]) -> Any:
        network, channels, actions = self._network()
        hearing = self._hearing(network)
        name = _one([*channels, *actions, *(each for each in hearing if each not in channels)], arguments, "name")
        action = actions.get(name)
        channel = action.start if action else channels.get(name) or hearing[name][0]
        told = asking.about(self._access, network, channel)
        comments = {each.about or "operation": " ".join(each.text.split()) for each in told.comments} if told else {}
        found: dict[str, Any] = {"channel": name, "kind": _ACTION if action else _KINDS[channel.pattern]}
        try:
            if action:
                whole = action.action
                contract, inputs = list(shown_contract(whole)), whole.inputs
            else:
                contract, inputs = list(declared(channel.operation)), channel.operation.inputs
        except NotUnderstood as exc:
            return found | {"not_understood": str(exc)}
        found |= {"contract": contract, "comments": comments, "arguments": values.template(inputs)}
        found["confirm"] = told.confirm if told else not action and channel.operation.confirm
        if action:
            return found | {"goals_may_be_begun": name in self._permissions.goals}
        if channel.pattern is not Pattern.PUBLISH:
            return found | {"may_be_called": name in self._permissions.calls}
        published = {each.name for several in hearing.values() for each in several}
        return found | {"may_be_published": name in hearing or name in published}

    def _hearing(self, network: Network) -> dict[str, list[Channel]]:
        """The channels that each topic that may be published goes to, by its path. None if nothing subscribes now."""
        found = {path: self._heard(network, *path.rsplit("/", 2)) for path in self._permissions.publications}
        return {path: channels for path, channels in found.items() if channels}

    def _heard(self, network: Network, instance: str, interface: str, operation: str) -> list[Channel]:
        """The topics that an instance subscribes to.

        A subscriber of any publisher may have no publisher. Its topic then gets a name of this program.
        """
        patterns = {
            each.told.channel
            for each in network.ends
            if each.role == "subscribes" and each.told.owner.strip("/") == instance
        }
        wanted = [each for each in sorted(patterns) if each.rsplit("/", 2)[1:] == [interface, operation]]
        found = [
            each
            for each in network.channels.values()
            if each.providers
            and (each.name in wanted or self._is_own(each.name))
            and any(names.matches(pattern, each.name) for pattern in wanted)
        ]
        return found or [network.topic(each.replace(names.ANY, OWN_INSTANCE)) for each in wanted]

    # Reading.

    def _read_topic(self, arguments: Mapping[str, Any]) -> Any:
        count, limit = self.bounds.count(arguments.get("count", 1)), self.bounds.seconds(arguments.get("timeout", 5.0))
        _, channels, _ = self._network()
        topics = {name: each for name, each in channels.items() if each.pattern is Pattern.PUBLISH}
        channel = topics[_one(list(topics), arguments, "topic")]
        messages: list[Any] = []
        lost: list[str] = []
        subscriptions = channel.each_way()
        with contextlib.closing(tapped(subscriptions, first=limit, whole=limit)) as heard:
            for each in heard:
                if isinstance(each, Message):
                    told = {"host": each.host, "message": each.message}
                    messages.append(told if len(subscriptions) > 1 else each.message)
                if isinstance(each, Lost):
                    lost.append(each.why)
                if len(messages) == count:
                    break
        if not messages:
            raise Unreachable(f"{channel.name}: no message came in {limit:g} s")
        return {"topic": channel.name, "messages": messages, **({"lost": lost} if lost else {})}

    def _read_parameters(self, arguments: Mapping[str, Any]) -> Any:
        network = self._census()
        name = self._component(params.components(network), _text(arguments, "component", "as list_components shows it"))
        settings = params.read(self._access, network, name, asking.DEADLINE)
        return {
            "component": name,
            "parameters": [
                {
                    "name": each.name,
                    "value": params.typed(each),
                    "allowed": params.allowed(each),
                    "dynamic": each.editable,
                    "about": each.comment,
                }
                for each in settings
            ],
        }

    def _read_measures(self, arguments: Mapping[str, Any]) -> Any:
        network = self._census()
        name = self._component(asking.components(network), _text(arguments, "component", "as list_components shows it"))
        measures = asking.measure(self._access, network, name)
        if measures is None:
            raise Unreachable(f"{name} does not tell")
        kind = type(measures).__contract__
        return {"component": name, "measures": values.show(kind, measures)}

    def _component(self, known: list[str], wanted: str) -> str:
        own = [each for each in known if self._permissions.has(each)]
        found = [each for each in own if each == wanted.strip("/") or each.endswith(f"/{wanted.strip('/')}")]
        if len(found) != 1:
            raise Refused(f"`{wanted}` may be {', '.join(found)}" if found else unknown("component", wanted, own))
        return found[0]

    # Acting.

    def _call(self, arguments: Mapping[str, Any]) -> Any:
        limit = self.bounds.seconds(arguments.get("timeout", 5.0))
        given = arguments.get("arguments", {})
        _, channels, actions = self._network()
        name = _one([*channels, *actions], arguments, "operation")
        if name in actions:
            raise Refused(f"{name} is an action; begin_goal begins a goal")
        channel = channels[name]
        if channel.pattern is Pattern.PUBLISH:
            raise Refused(f"{name} is a topic; read_topic reads it")
        self._check(name, self._permissions.calls, "call")
        taken = values.take_fields(channel.operation.inputs, given, channel.operation.name)
        self._note("call", name, given)
        if channel.pattern is Pattern.COMMAND:
            self._access.send(channel, taken, limit, limit)
            return {"sent": channel.name}
        try:
            results = self._access.ask(channel, taken, limit)
        except ThrownError as exc:
            return {
                "exception": exc.kind.name.rpartition("::")[2],
                "fields": values.show_fields(exc.kind.all_fields, exc.values),
            }
        shown = values.show_fields(channel.operation.outputs, results)
        return {"result": shown["ret"] if list(shown) == ["ret"] else shown or None}

    def _begin_goal(self, arguments: Mapping[str, Any]) -> Any:
        limit = self.bounds.seconds(arguments.get("limit", 60.0), "limit", self.bounds.longest_goal)
        given = arguments.get("arguments", {})
        _, _, actions = self._network()
        name = _one(list(actions), arguments, "action")
        self._check(name, self._permissions.goals, "goal")
        action = actions[name].action
        taken = values.take_fields(action.inputs, given, action.name)
        self._note("begin goal of", name, given)
        return self._goals.begin(actions[name], action, taken, limit)

    def _read_goal(self, arguments: Mapping[str, Any]) -> Any:
        limit = self.bounds.seconds(arguments.get("timeout", 5.0))
        return self._goals.read(_text(arguments, "goal", "as begin_goal returns it"), limit)

    def _cancel_goal(self, arguments: Mapping[str, Any]) -> Any:
        return self._goals.cancel(_text(arguments, "goal", "as begin_goal returns it"))

    def _publish(self, arguments: Mapping[str, Any]) -> Any:
        limit = self.bounds.seconds(arguments.get("timeout", 5.0))
        given = arguments.get("arguments", {})
        network, channels, _ = self._network()
        hearing = self._hearing(network)
        known = {each.name: [each] for several in hearing.values() for each in several} | hearing
        others = [name for name, each in channels.items() if each.pattern is Pattern.PUBLISH and name not in known]
        whole = str(arguments.get("topic")).strip("/")
        name = whole if whole in known else _one([*hearing, *others], arguments, "topic")
        self._check(name, known, "publication")
        if len(known[name]) > 1:
            raise Refused(f"{name} has several publishers; name one of {', '.join(each.name for each in known[name])}")
        [channel] = known[name]
        taken = values.take_fields(channel.operation.inputs, given, channel.operation.name)
        self._note("publish", channel.name, given)
        publish(self._access, channel, taken, limit)
        return {"published": channel.name}

    def _check(self, name: str, allowed: Collection[str], what: str) -> None:
        if name not in allowed:
            may = f"it allows {', '.join(allowed)}" if allowed else f"it allows no {what}"
            raise Refused(f"network `{self._permissions.network}` does not allow {name}; {may}")

    def _note(self, deed: str, name: str, given: Any) -> None:
        """Count what changes something, and write it down, before it is done. Raises Refused if it is too much."""
        with self._lock:
            self._calls.take()
        self._write("INFO", f"{deed} {name} {_spelled(given)[:_LOGGED]}")


_ACTION = "action"
_KINDS = {Pattern.PUBLISH: "topic", Pattern.QUERY: "query", Pattern.COMMAND: "command"}


def _ends(channel: Channel) -> dict[str, list[str]]:
    return {
        "provided_by": sorted({end.told.owner for end in channel.providers}),
        "used_by": sorted({end.told.owner for end in channel.users}),
    }


def _one(known: Collection[str], arguments: Mapping[str, Any], argument: str) -> str:
    """The only name that an argument means: a whole one, or a part of it between slashes. Raises Refused."""
    wanted = _text(arguments, argument, "as list_components or list_channels shows it")
    name = wanted.strip("/")
    if name in known:
        return name
    found = [each for each in known if f"/{name}/" in f"/{each}/"]
    if len(found) == 1:
        return found[0]
    if found:
        raise Refused(f"`{wanted}` may be {', '.join(found[:8])}; write more of the name")
    tails = {"/".join(each.split("/")[-count:]) for each in known for count in (1, 2, 3)}
    near = closest(name, tails)
    hint = f"did you mean `{near}`?" if near else "list_channels shows all"
    what = argument if argument in ("topic", "action") else "channel"
    raise Refused(f"unknown {what} `{wanted}`; {hint}")


def _text(arguments: Mapping[str, Any], name: str, kind: str) -> str:
    given = arguments.get(name)
    if not isinstance(given, str) or not given.strip("/"):
        raise Refused(f"`{name}` is missing: a name, {kind}")
    return given


def _line(request: str, arguments: Mapping[str, Any]) -> str:
    return f"{printable(request)[:50]} {_spelled(arguments)[:_LOGGED]}"


def _spelled(arguments: Any) -> str:
    return printable(json.dumps(arguments, default=str))
