"""Run a component in a test: in this process, with fakes for all its peers.

    SpecificWorker = load_component(Path("components/wander"))

    def test_it_stops_before_a_wall():
        with ComponentTest(SpecificWorker, laser={"getLaserData": [TData(0.0, 200.0)]}) as component:
            component.wait_for_computes(1)
            assert component.received("differentialrobot.setSpeedBase")[-1] == (0.0, 0.6)

A fake is a value to return, an exception to raise, a function of the operation's arguments, or one of `late`,
`in_turn` and `gone_after`: see `fakes`. Operations without a fake return zeros.
How to test components: docs/guides/testing.md.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..contract import types as t
from ..contract.component import Port
from ..contract.interface import Action, Operation, Pattern, Verb
from ..contract.parameters import ParameterSet
from ..errors import ConfigurationError, TransportError
from ..runtime import ports, settings
from ..runtime.calls import Outcome
from ..runtime.clock import SECOND
from ..runtime.commonbehavior import port_of
from ..runtime.load import load_worker
from ..runtime.monitor import Monitor
from ..runtime.RoboCompCommonBehavior import COMMONBEHAVIOR_INTERFACE, Parameter
from ..runtime.route import Route
from ..runtime.worker import Worker
from ..spelling import unknown
from ..transports.base import Channel, Link, Reply, Status, Transport
from ..wire import names
from ..wire.codec import Codec, Payload
from .fakes import InTurn, Late, chosen, gone_after, hinders, in_turn, is_late, late
from .patience import SOON
from .stages import Raised, RealTime, VirtualTime

if TYPE_CHECKING:
    from .goals import GoalsOfTest

__all__ = ["ComponentTest", "gone_after", "in_turn", "late", "load_component", "stand_ins"]

load_component: Callable[[Path], type[Worker[Any]]] = load_worker
"""The SpecificWorker of a component's folder."""

_OPPOSITE = {
    Verb.REQUIRES: Verb.IMPLEMENTS,
    Verb.IMPLEMENTS: Verb.REQUIRES,
    Verb.PUBLISHES: Verb.SUBSCRIBES,
    Verb.SUBSCRIBES: Verb.PUBLISHES,
}
_SET_PARAMETERS = next(each for each in COMMONBEHAVIOR_INTERFACE.operations if each.name == "setParameterList")


class ComponentTest:
    """A running component, from entering the `with` block until leaving it.

    `config` holds settings by dotted key (`{"params.max_speed": 0.5, "component.period": 0.01}`), or is a
    configuration that was read; the keyword arguments are fakes: by port (`laser`), then by operation.

    With `virtual`, the component runs in virtual time: it acts only within the methods of this class, a wait takes no
    time, and each run of the test is the same. It must not start threads then, nor read the machine's clock.
    """

    def __init__(
        self,
        worker: type[Worker[Any]],
        config: Mapping[str, Any] | settings.Document | None = None,
        *,
        virtual: bool = False,
        **fakes: Mapping[str, Any],
    ) -> None:
        self._operations = {
            port.name: {operation.name: operation for operation, _ in port.interface.under(port.verb)}
            for port in worker.component.ports
        }
        self._actions = {
            port.name: {each.name: each for each in port.interface.actions_under(port.verb)}
            for port in worker.component.ports
        }
        for name, faked in fakes.items():
            for operation in faked:
                self._known(f"{name}.{operation}")
            self._known(name)
        document, given = (config, {}) if isinstance(config, settings.Document) else (settings.Document(), config or {})
        document.passed_on = worker._takes_any_params and worker.component.params is None
        sources = {
            f"ports.{port.name}.from": _source(port) for port in worker.component.ports if not port.verb.provides
        }
        for key, value in {"component.startup_timeout": SOON, **given, **sources}.items():
            settings.override(document, f"{key}={_toml(value)}")
        try:
            checked = settings.check(worker.component, document)
        except ConfigurationError as exc:
            raise ConfigurationError(f"{exc}{_advice(worker.component.params, document)}") from exc
        kind = VirtualTime if virtual else RealTime
        # If an answer may be late, no thread of the component waits for it longer than the deadline.
        self._stage = kind(worker, checked, self._hindered, hand_over=any(map(is_late, _answers(fakes))))
        self._running = self._stage.running
        self._transport: Transport | None = None
        """From entering the block on: its threads would keep a program from ending that never enters it."""
        self._fakes = fakes
        self._received: list[tuple[str, tuple[Any, ...]]] = []
        self._proxies: dict[str, ports.Proxy] = {}
        self._goals: GoalsOfTest | None = None
        """If the component has actions."""
        self._monitor = Monitor("fakes", self._stage.threads)
        self._facing: dict[str, list[Link]] = {}
        """The links of each port's other side."""

    @property
    def worker(self) -> Any:
        """The SpecificWorker itself, to look into. Its code runs on another thread, but not in virtual time."""
        return self._running.worker

    @property
    def fine(self) -> bool:
        """After the block: whether the component ended without failing."""
        return self._running.is_over and not self._running.failed

    @property
    def time(self) -> float:
        """Seconds on the component's clock, since the start of the test in virtual time."""
        return self._running.clock.now() / SECOND

    def __enter__(self) -> Self:
        self._monitor.open()
        self._transport = self._stage.open()
        try:
            if self._running.component.has_actions:
                from .goals import GoalsOfTest  # few components need it

                self._goals = GoalsOfTest(self._stage, self._monitor, self._route, self._act)
            for port in self._running.component.ports:
                self._face(port)
            self._stage.start()
            self._stage.wait(self._running.ready.is_set, SOON * 2, "the component is ready")
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._stop():
            raise AssertionError("the component did not stop")

    def _stop(self) -> bool:
        """Returns whether the component has ended."""
        assert self._transport
        ended = self._stage.stop(self._transport)
        for links in self._facing.values():
            ports.close_all(links)
        self._monitor.close()
        self._transport.close()
        return ended

    def call(self, operation: str, *arguments: Any, deadline: float = SOON) -> Any:
        """Call what the component implements: `call("Speech.say", "hello")`.

        For an action, that returns its `Goal`, as soon as the component has accepted it.
        """
        name, _, action = operation.partition(".")
        if self._goals and action in self._actions.get(name, {}):
            return self._goals.begin(name, self._actions[name][action], arguments, deadline)
        proxy, contract = self._proxy(operation)
        return self._stage.do(partial(proxy._ask, contract, arguments, deadline))

    def send(self, operation: str, *arguments: Any) -> None:
        """Publish to the component, or send it a command: `send("LaserPub.pushLaserData", scan)`."""
        proxy, contract = self._proxy(operation)
        self._stage.do(partial(proxy._send, contract, arguments, SOON))

    def change(self, params: Mapping[str, Any]) -> None:
        """Change dynamic parameters, as another component would: `change({"max_speed": 1.0})`.

        Raises RemoteFailure if the component or its PDSL file does not allow it.
        """
        port = port_of(self._running.component)
        if port is None:
            raise ValueError("the component implements CommonBehavior itself: call its setParameterList")
        if port.name not in self._proxies:
            self._face(port)
        given = {name: Parameter(editable=True, value=str(value), type="") for name, value in params.items()}
        self._stage.do(partial(self._proxies[port.name]._ask, _SET_PARAMETERS, (given,), SOON))

    @contextlib.contextmanager
    def without(self, port: str) -> Iterator[None]:
        """Within this context the peer of a port is missing: calls of the component are `Unreachable`."""
        self._known(port)
        ports.close_all(self._facing[port])
        try:
            yield
        finally:
            self._face(next(each for each in self._running.component.ports if each.name == port))

    def received(self, operation: str) -> list[tuple[Any, ...]]:
        """The arguments of every call, command or publication so far: `received("batterypub.pushBattery")`.

        Calls that a fake answers with `Unreachable` or a similar error are included. After the block, the list is
        complete.
        """
        self._known(operation)
        return [arguments for name, arguments in list(self._received) if name == operation]

    def run(self, seconds: float) -> None:
        """Let the component run for so many seconds. In virtual time, that takes no longer than its work."""
        self._stage.run(seconds)

    def wait_for(self, condition: Callable[[], object], timeout: float = SOON) -> None:
        """Wait until a condition holds. Fails if it does not within `timeout` seconds, or if the component ends."""
        self._stage.wait(condition, timeout)
        assert condition(), "the component ended"

    def wait_for_computes(self, number: int) -> None:
        """Wait until `compute` was called this many more times."""
        wanted = self._running.computes + number
        self.wait_for(lambda: self._running.computes >= wanted)

    def _face(self, port: Port) -> None:
        """Make the other side of a port."""
        facing = replace(port, verb=_OPPOSITE[port.verb], proxy=ports.Proxy)
        if port.verb.has_proxy:
            self._facing[port.name] = ports.bind_handlers(facing, _Fake(self, port), self._route, self._monitor)
        else:
            self._proxies[port.name], self._facing[port.name] = ports.bind_proxy(facing, self._route, self._monitor)
        if self._goals and port.interface.actions_under(port.verb):
            self._facing[port.name] += self._goals.face(port, facing)

    def _proxied(self, place: str) -> Port:
        """The port by which the component sends to this place."""
        component = self._running.component
        return next(
            port
            for port in component.ports
            if port.verb.has_proxy
            and (place.endswith(f"/{component.segment(port)}") if port.verb.provides else place == _source(port))
        )

    def _route(self, port: Port, operation: Operation[Any]) -> Route:
        """The way to the component, from the fake that faces one of its ports."""
        own = replace(port, verb=_OPPOSITE[port.verb], proxy=None)
        assert self._transport
        place = _source(own) if port.verb.provides else f"{names.ANY}/{self._running.component.segment(own)}"
        return Route(self._transport, "inproc", f"{place}/{operation.name}", port.qos, SOON)

    def _proxy(self, name: str) -> tuple[ports.Proxy, Operation[Any]]:
        port, operation = self._known(name)
        if operation is None or port not in self._proxies:
            raise ValueError(f"`{name}` is nothing to call: the component calls it itself, or it is a whole port")
        return self._proxies[port], operation

    def _act(self, port: Port, action: Action, arguments: tuple[Any, ...]) -> Any:
        """What the fake of an action does: see `fakes`."""
        self._received.append((f"{port.name}.{action.name}", arguments))
        fake = self._fakes.get(port.name, {}).get(action.name, _zeros)
        return _zeros(action) if fake is _zeros else chosen(fake)

    def _known(self, name: str) -> tuple[str, Operation[Any] | None]:
        """A port, and its operation if the name has a second part. Raises ValueError for unknown names."""
        port, dot, operation = name.partition(".")
        if port not in self._operations:
            raise ValueError(unknown("port", port, self._operations))
        if dot and operation not in {**self._operations[port], **self._actions[port]}:
            known = [*self._operations[port], *self._actions[port]]
            raise ValueError(f"port `{port}`: {unknown('operation', operation, known)}")
        return port, self._operations[port].get(operation)

    def _answer(self, port: Port, operation: Operation[Any], arguments: tuple[Any, ...]) -> Any:
        self._received.append((f"{port.name}.{operation.name}", arguments))
        fake = self._fakes.get(port.name, {}).get(operation.name, _zeros)
        if fake is _zeros:
            return _zeros(operation)
        if operation_pattern(port, operation) is not Pattern.QUERY and isinstance(fake, InTurn | TransportError):
            return None  # `_hindered` has looked at it when the message was sent
        answer = chosen(fake)
        if isinstance(answer, Late):
            with self._monitor.suspended():
                self._stage.sleep(answer.seconds)
            answer = chosen(answer.answer)
        try:
            if isinstance(answer, BaseException):
                raise answer
            return answer(*arguments) if callable(answer) else answer
        except TransportError as exc:
            raise Outcome(Reply(Status.FAILED, Raised(exc))) from exc

    def _hindered(self, channel: Channel, payload: Payload, codec: Codec) -> TransportError | None:
        """The error with which a command or publication of the component ends; None if it is sent."""
        place, _, name = channel.name.rpartition("/")
        if "-" in name:
            return None  # a part of an action
        port = self._proxied(place)
        answer = self._fakes.get(port.name, {}).get(name)
        error = hinders(chosen(answer)) if isinstance(answer, InTurn | TransportError) else None
        if error:
            operation = self._operations[port.name][name]
            self._received.append((f"{port.name}.{name}", codec.decoder(operation.request)(payload)))
        return error


class _Fake:
    """The handlers of a port's peer."""

    def __init__(self, test: ComponentTest, port: Port) -> None:
        for operation, _ in port.interface.under(port.verb):
            setattr(self, port.handler(operation.name), _Handler(test, port, operation))


class _Handler:
    def __init__(self, test: ComponentTest, port: Port, operation: Operation[Any]) -> None:
        self._test, self._port, self._operation = test, port, operation
        self.__qualname__ = f"fake {port.name}.{operation.name}"

    def __call__(self, *arguments: Any) -> Any:
        return self._test._answer(self._port, self._operation, arguments)


def _answers(fakes: Mapping[str, Mapping[str, Any]]) -> Iterator[Any]:
    for faked in fakes.values():
        yield from faked.values()


def _source(port: Port) -> str:
    """Where a port of the component finds its fake."""
    return f"fake/{port.label}"


def _zeros(operation: Operation[Any] | Action) -> Any:
    values = tuple(zero(output.type) for output in operation.outputs)
    return values if len(values) > 1 else values[0] if values else None


def stand_ins(worker: type[Worker[Any]]) -> dict[str, Any]:
    """A value for each mandatory parameter of a component, if its declaration offers one.

    So tests that do not use parameters still pass when a mandatory one is added.
    """
    params = worker.component.params
    return {f"params.{key}": value for key, value in _mandatory(params).items()} if params else {}


def _mandatory(params: ParameterSet) -> dict[str, Any]:
    values: dict[str, Any] = {each.name: each.default for each in params.parameters if each.mandatory}
    return values | {each.name: [_mandatory(each.items)] * each.minimum for each in params.lists if each.minimum}


def _advice(params: ParameterSet | None, document: settings.Document) -> str:
    """The parameters that the test must still give."""
    wanted = {f"params.{key}": value for key, value in (_mandatory(params) if params else {}).items()}
    given = document.data.get("params", {})
    missing = {key: value for key, value in wanted.items() if key.removeprefix("params.") not in given}
    if not missing:
        return ""
    return (
        f"\nin a test: ComponentTest(SpecificWorker, {missing!r}), or stand_ins(SpecificWorker) "
        "if it does not matter which value"
    )


def operation_pattern(port: Port, operation: Operation[Any]) -> Pattern:
    """How an operation travels."""
    return next(pattern for each, pattern in port.interface.under(port.verb) if each is operation)


def zero(kind: t.Type) -> Any:
    """The value of a field that is not set."""
    match kind:
        case t.Struct(python=python, fields=fields):
            return python() if python else tuple(zero(field.type) for field in fields)
        case t.Enumeration(python=python, members=members):
            return python(members[0][1]) if python else members[0][1]
        case t.Sequence():
            return np.empty(0, kind.dtype) if kind.dtype is not None else []
        case t.Dictionary():
            return {}
        case t.Primitive():
            return kind.zero


def _toml(value: Any) -> str:
    """A value of the configuration as TOML spells it, on one line."""
    match value:
        case bool():
            return str(value).lower()
        case int() | float():
            return repr(value)
        case Mapping():
            return "{" + ", ".join(f"{json.dumps(key)} = {_toml(item)}" for key, item in value.items()) + "}"
        case list() | tuple():
            return f"[{', '.join(map(_toml, value))}]"
        case _:
            return json.dumps(str(value), ensure_ascii=False)
