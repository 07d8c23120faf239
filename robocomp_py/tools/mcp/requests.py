"""What agents ask of a running network, as plain functions: each takes JSON and returns JSON.

Nothing is called that the network does not allow, and everything is written down before it is answered.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from ...contract.interface import Pattern
from ...errors import RobocompError, Unreachable
from ...printable import printable
from ...spelling import closest, unknown
from ...wire import json as values
from .. import asking, params
from ..access import Access, ThrownError
from ..idsl import declared
from ..network import Channel, Network, NotUnderstood
from ..tap import Message, tapped
from .bounds import Bounds, Rate, Refused, fitted
from .permissions import Permissions

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
        bounds: Bounds | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`census` tells what runs now; `write` gets a level and a line for the log."""
        self._access, self._census, self._permissions = access, census, permissions
        self._write, self.bounds, self._clock = write, bounds or Bounds(), clock
        self._lock = threading.Lock()
        self._calls = Rate(self.bounds.calls_a_minute, "calls", clock)
        self._reads = Rate(self.bounds.reads_a_minute, "requests", clock)
        self._known: dict[str, Callable[[Mapping[str, Any]], Any]] = {
            "list_components": self._list_components,
            "list_channels": self._list_channels,
            "describe": self._describe,
            "read_topic": self._read_topic,
            "read_parameters": self._read_parameters,
            "read_measures": self._read_measures,
            "call": self._call,
        }

    @property
    def allowed(self) -> tuple[str, ...]:
        """The operations that may be called."""
        return tuple(self._permissions.calls)

    def answer(self, request: str, arguments: Mapping[str, Any]) -> Answer:
        """The answer to a request, within the bounds. Raises nothing that an agent or the network can cause."""
        begun = self._clock()
        try:
            answer = Answer(self._answered(request, arguments))
        except Refused as exc:
            return self.refuse(request, arguments, str(exc))
        except (RobocompError, ValueError) as exc:
            answer = Answer(printable(str(exc)) or type(exc).__name__, failed=True)
        result = f"failed: {answer.text[:_LOGGED]}" if answer.failed else "answered"
        took = self._clock() - begun
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

    def _network(self) -> tuple[Network, dict[str, Channel]]:
        """All that runs, and the channels of this network by name."""
        network = self._census()
        return network, {
            name: each
            for name, each in network.channels.items()
            if self._permissions.has(name.rsplit("/", 2)[0]) and each.providers
        }

    def _list_components(self, arguments: Mapping[str, Any]) -> Any:
        network, channels = self._network()
        owners = {end.told.owner for each in channels.values() for end in each.ends}
        found = []
        for each in network.components():
            if each.owner in owners or self._permissions.has(each.owner):
                told = asdict(each)
                found.append({"component": told.pop("owner"), **told})
        listed = {each["component"] for each in found}
        silent = [each for each in asking.components(network) if self._permissions.has(each) and each not in listed]
        found += [{"component": each, "offers": [], "uses": []} for each in silent]
        return {"network": self._permissions.network, "components": found, "may_be_called": list(self.allowed)}

    def _list_channels(self, arguments: Mapping[str, Any]) -> Any:
        kind, part = str(arguments.get("kind", "")), str(arguments.get("contains", ""))
        kinds = {"topic": Pattern.PUBLISH, "query": Pattern.QUERY, "command": Pattern.COMMAND}
        if kind and kind not in kinds:
            raise Refused(unknown("kind", kind, kinds))
        _, channels = self._network()
        return [
            {
                "channel": each.name,
                "kind": next(name for name, pattern in kinds.items() if pattern is each.pattern),
                "provided_by": sorted({end.told.owner for end in each.providers}),
                "used_by": sorted({end.told.owner for end in each.users}),
                **({} if each.pattern is Pattern.PUBLISH else {"may_be_called": each.name in self.allowed}),
            }
            for each in channels.values()
            if (not kind or each.pattern is kinds[kind]) and part in each.name
        ]

    def _describe(self, arguments: Mapping[str, Any]) -> Any:
        network, channels = self._network()
        channel = _one(channels, _text(arguments, "name"))
        told = asking.about(self._access, network, channel, asking.DEADLINE)
        comments = {each.about or "operation": " ".join(each.text.split()) for each in told.comments} if told else {}
        try:
            contract, inputs = list(declared(channel.operation)), channel.operation.inputs
        except NotUnderstood as exc:
            return {"channel": channel.name, "not_understood": str(exc)}
        found: dict[str, Any] = {
            "channel": channel.name,
            "kind": "topic" if channel.pattern is Pattern.PUBLISH else str(channel.pattern),
            "contract": contract,
            "comments": comments,
        }
        if channel.pattern is not Pattern.PUBLISH:
            found |= {
                "arguments": values.template(inputs),
                "confirm": bool(told and told.confirm),
                "may_be_called": channel.name in self.allowed,
            }
        return found

    # Reading.

    def _read_topic(self, arguments: Mapping[str, Any]) -> Any:
        count, limit = self.bounds.count(arguments.get("count", 1)), self.bounds.seconds(arguments.get("timeout", 5.0))
        _, channels = self._network()
        channel = _one(channels, _text(arguments, "topic"), Pattern.PUBLISH)
        messages: list[Any] = []
        with contextlib.closing(tapped([channel], first=limit, whole=limit)) as heard:
            for each in heard:
                if isinstance(each, Message):
                    messages.append(each.message)
                if len(messages) == count:
                    break
        if not messages:
            raise Unreachable(f"{channel.name}: no message came in {limit:g} s")
        return {"topic": channel.name, "messages": messages}

    def _read_parameters(self, arguments: Mapping[str, Any]) -> Any:
        network = self._census()
        name = self._component(params.components(network), _text(arguments, "component"))
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
        name = self._component(asking.components(network), _text(arguments, "component"))
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

    # Calling.

    def _call(self, arguments: Mapping[str, Any]) -> Any:
        limit = self.bounds.seconds(arguments.get("timeout", 5.0))
        given = arguments.get("arguments", {})
        _, channels = self._network()
        channel = _one(channels, _text(arguments, "operation"))
        if channel.pattern is Pattern.PUBLISH:
            raise Refused(f"{channel.name} is a topic; read_topic reads it")
        if channel.name not in self.allowed:
            may = f"it allows {', '.join(self.allowed)}" if self.allowed else "it allows no call"
            raise Refused(f"network `{self._permissions.network}` does not allow {channel.name}; {may}")
        taken = values.taken(channel.operation.inputs, given, channel.operation.name)
        with self._lock:
            self._calls.take()
        self._write("INFO", f"call {channel.name} {_spelled(given)[:_LOGGED]}")
        if channel.pattern is Pattern.COMMAND:
            self._access.send(channel, taken, limit, limit)
            return {"sent": channel.name}
        try:
            results = self._access.ask(channel, taken, limit)
        except ThrownError as exc:
            return {
                "exception": exc.kind.name.rpartition("::")[2],
                "fields": values.shown(exc.kind.all_fields, exc.values),
            }
        shown = values.shown(channel.operation.outputs, results)
        return {"result": shown["ret"] if list(shown) == ["ret"] else shown or None}


def _one(channels: Mapping[str, Channel], wanted: str, pattern: Pattern | None = None) -> Channel:
    """The only channel that a name means: a whole one, or a part of it between slashes. Raises Refused."""
    name = wanted.strip("/")
    every = [each for each in channels.values() if pattern in (None, each.pattern)]
    found = [each for each in every if each.name == name]
    found = found or [each for each in every if f"/{name}/" in f"/{each.name}/"]
    if len(found) == 1:
        return found[0]
    if found:
        raise Refused(f"`{wanted}` may be {', '.join(each.name for each in found[:8])}; write more of the name")
    tails = {"/".join(each.name.split("/")[-count:]) for each in every for count in (1, 2, 3)}
    near = closest(name, tails)
    hint = f"did you mean `{near}`?" if near else "list_channels shows all"
    raise Refused(f"unknown {'topic' if pattern else 'channel'} `{wanted}`; {hint}")


def _text(arguments: Mapping[str, Any], name: str) -> str:
    given = arguments.get(name)
    if not isinstance(given, str) or not given.strip("/"):
        raise Refused(f"`{name}` is missing: a name, as list_components or list_channels shows it")
    return given


def _line(request: str, arguments: Mapping[str, Any]) -> str:
    return f"{printable(request)[:50]} {_spelled(arguments)[:_LOGGED]}"


def _spelled(arguments: Any) -> str:
    return printable(json.dumps(arguments, default=str))
