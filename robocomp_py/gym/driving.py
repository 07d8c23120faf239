"""How an environment drives a network: it calls operations, lets time pass, and begins again.

A network runs in virtual time, by its executor, and begins again with new components. If it is nothing but a simulated
scene, the scene itself is stepped, which is faster, and goes back to its beginning.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from ..contract.interface import Pattern
from ..contract.parameters import ParameterKind
from ..errors import Closed, ComponentError
from ..runtime.lifecycle import State
from ..virtual.outside import Outside, Provided, found, provided
from ..virtual.simulation import Part, Simulation

if TYPE_CHECKING:
    from ..sim.remote import Remote

STARTUP = 60.0
"""Virtual seconds that a network may take to start, and to publish what is observed."""

MOST_SEED = 1_000_000
"""The greatest seed of an episode; simulators take such ones."""

NAME = "environment"
"""As what the components of the network see the environment."""

T = TypeVar("T")

Values = tuple[Any, ...]
Inputs = Mapping[str, Values]
"""The inputs of calls, by the names of the operations."""


class Driver(Protocol):
    """A network that is driven."""

    @property
    def simulation(self) -> Simulation: ...

    def reset(self, seed: int) -> None:
        """Begin again, and stop where the components are ready."""
        ...

    def call(self, name: str, inputs: Values) -> Any:
        """Call an operation now, and return its result."""
        ...

    def settle(self) -> None:
        """Let edits of scenes take effect."""
        ...

    def step(self, inputs: Inputs) -> None:
        """Call operations, then let the time of a step pass."""
        ...

    def observe(self) -> dict[str, Values]:
        """The values of the messages that are observed, by the names of their operations."""
        ...

    def close(self) -> None: ...


def driver(parts: Sequence[Part], called: Iterable[str], observed: Sequence[str], seconds: float) -> Driver:
    """`called` and `observed` are names of operations, and `seconds` is the length of a step."""
    network = provided(parts)
    topics = [each for each in observed if found(each, network).pattern is Pattern.PUBLISH]
    if len(parts) == 1 and not topics and _is_scene(parts[0]):
        return SceneDriver(parts[0], observed, seconds)
    return NetworkDriver(parts, called, observed, seconds)


def _is_scene(part: Part) -> bool:
    """Whether a component simulates a scene. Without the extra `[sim]`, none can."""
    try:
        from ..sim.serve.simulator import Simulator  # only scenes need it
    except ImportError:
        return False
    return issubclass(part.worker_class, Simulator)


class NetworkDriver:
    """Runs all components in virtual time. For each episode, they are made anew."""

    def __init__(self, parts: Sequence[Part], called: Iterable[str], observed: Sequence[str], seconds: float) -> None:
        self._parts, self._called, self._observed, self._seconds = parts, list(called), observed, seconds
        self._network = provided(parts)
        self._topics = [each for each in observed if self._network[each].pattern is Pattern.PUBLISH]
        self._running: tuple[Simulation, Outside] | None = None
        self._asks: dict[str, Callable[..., Any]] = {}
        self._heard: dict[str, Values] = {}
        """The latest message of each topic that is observed."""
        self._remotes: dict[str, Remote] = {}
        """The processes that draw for scenes, by instance. They go on when their components are made anew."""

    @property
    def simulation(self) -> Simulation:
        return _open(self._running)[0]

    def reset(self, seed: int) -> None:
        self._end()
        simulation = Simulation([seeded(each, seed) for each in self._parts], seed)
        for name in (each.instance for each in self._parts if _is_scene(each)):
            simulation[name].worker.remote = self._remote(name)
        self._running = simulation, simulation.outside(NAME)
        self._asks, self._heard = {}, {}
        try:
            simulation.__enter__()
            for name in self._topics:
                self._hear(name)
            for name in self._called:
                self._ask(name)
            _start(simulation, self._parts)
        except BaseException:
            self.close()
            raise

    def _remote(self, name: str) -> Remote:
        from ..sim.remote import Remote  # only scenes need it

        return self._remotes.setdefault(name, Remote())

    def _hear(self, name: str) -> None:
        heard = self._heard

        def note(values: Values) -> None:
            heard[name] = values

        _open(self._running)[1].hears(name, note)

    def _ask(self, name: str) -> Callable[..., Any]:
        if name not in self._asks:
            self._asks[name] = _open(self._running)[1].asks(name)
        return self._asks[name]

    def call(self, name: str, inputs: Values) -> Any:
        ask = self._ask(name)
        return self.simulation.do(lambda: ask(*inputs))

    def settle(self) -> None:
        for part in filter(_is_scene, self._parts):
            self.simulation.do(self.simulation[part.instance].worker.settle)

    def step(self, inputs: Inputs) -> None:
        self.simulation.do(lambda: [self._asks[name](*values) for name, values in inputs.items()])
        self.simulation.run(self._seconds)
        _check(self.simulation)

    def observe(self) -> dict[str, Values]:
        """Raises ComponentError for a topic on which nothing is published for a minute after the start."""
        if not self._has_heard():
            self.simulation.run(until=self._has_heard, at_most=STARTUP)
            _check(self.simulation)
        if silent := [each for each in self._topics if each not in self._heard]:
            raise ComponentError(f"nothing was published on {', '.join(silent)} in {STARTUP:g} s of virtual time")
        queries = [each for each in self._observed if each not in self._topics]
        answers = self.simulation.do(lambda: [self._asked(each) for each in queries]) if queries else []
        return {**self._heard, **dict(zip(queries, answers, strict=True))}

    def _has_heard(self) -> bool:
        return all(each in self._heard for each in self._topics)

    def _asked(self, name: str) -> Values:
        return results(self._network[name], self._asks[name]())

    def close(self) -> None:
        try:
            self._end()
        finally:
            for each in self._remotes.values():
                each.close()

    def _end(self) -> None:
        running, self._running = self._running, None
        if running:
            simulation, outside = running
            outside.close()
            simulation.__exit__(None, None, None)


class SceneDriver:
    """Steps the scene of a component that simulates one, without messages. The component is made once."""

    def __init__(self, part: Part, observed: Sequence[str], seconds: float) -> None:
        self._part, self._observed, self._seconds = part, observed, seconds
        self._network = provided([part])
        self._simulation: Simulation | None = None
        self._methods: dict[str, Callable[..., Any]] = {}
        self._observers: list[tuple[str, Provided, Callable[..., Any]]] = []

    @property
    def simulation(self) -> Simulation:
        return _open(self._simulation)

    def reset(self, seed: int) -> None:
        if self._simulation is None:
            self._start()
        world = self._worker.world
        self.settle()
        world.set_physics(self._physics)
        world.reset(seed, self._tree)
        self.settle()  # what was edited away is provided again

    def _start(self) -> None:
        self._simulation = simulation = Simulation([self._part])
        try:
            simulation.__enter__()
            _start(simulation, [self._part])
        except BaseException:
            self.close()
            raise
        self._worker = simulation[self._part.instance].worker
        world = self._worker.world
        self._tree, self._physics = world.tree, world.physics
        self._ticks = round(self._seconds / world.tick)
        if not self._ticks or abs(self._ticks * world.tick - self._seconds) > 1e-9:
            raise ValueError(f"a step of {self._seconds:g} s: it has to be a multiple of the tick, {world.tick:g} s")
        self._methods = {}
        self._observers = [(name, self._network[name], self._observer(name)) for name in self._observed]

    def call(self, name: str, inputs: Values) -> Any:
        return self._method(name)(*inputs)

    def settle(self) -> None:
        self._worker.settle()

    def step(self, inputs: Inputs) -> None:
        for name, values in inputs.items():
            self._method(name)(*values)
        self.settle()
        self._worker.world.step(self._ticks)

    def observe(self) -> dict[str, Values]:
        return {name: results(each, observer()) for name, each, observer in self._observers}

    def _observer(self, name: str) -> Callable[..., Any]:
        """The handler of an operation, or the one that returns an array of records in the place of many objects."""
        method = self._method(name)
        handlers, operation = getattr(method, "__self__", None), getattr(method, "__name__", "")
        found: Callable[..., Any] = getattr(handlers, f"{operation}_records", method)
        return found

    def _method(self, name: str) -> Callable[..., Any]:
        """The handler of an operation."""
        if name not in self._methods:
            each = found(name, self._network)
            handlers = getattr(self._worker, each.port.attribute)[each.named] if each.named else self._worker
            self._methods[name] = getattr(handlers, each.port.handler(each.operation.name))
        return self._methods[name]

    def close(self) -> None:
        simulation, self._simulation = self._simulation, None
        if simulation:
            simulation.__exit__(None, None, None)


def seeded(part: Part, seed: int) -> Part:
    """A component whose parameter `seed` has that value, if it has such a parameter."""
    known = part.component.params.parameters if part.component.params else ()
    wanted = next((each for each in known if each.name == "seed" and each.kind is ParameterKind.INT), None)
    if wanted is None:
        return part
    if wanted.minimum is not None and wanted.maximum is not None:
        seed = int(wanted.minimum) + seed % (int(wanted.maximum) - int(wanted.minimum) + 1)
    return replace(part, settings=replace(part.settings, params={**part.settings.params, "seed": seed}))


def results(each: Provided, returned: Any) -> Values:
    """The values of a reply."""
    values: Values = returned if len(each.operation.outputs) > 1 else (returned,)
    return values


def _open(running: T | None) -> T:
    """What runs. Raises Closed if the environment is closed."""
    if running is None:
        raise Closed("the environment is closed: call `reset`")
    return running


def _start(simulation: Simulation, parts: Sequence[Part]) -> None:
    """Run until all components are ready, and have done what is due at that instant."""
    components = [simulation[each.instance] for each in parts]
    simulation.run(until=lambda: all(each.state is State.COMPUTE for each in components), at_most=STARTUP)
    _check(simulation)
    if late := [each.instance for each in components if each.state is not State.COMPUTE]:
        raise ComponentError(f"{', '.join(late)}: not ready after {STARTUP:g} s of virtual time")
    simulation.run(0.0)


def _check(simulation: Simulation) -> None:
    """Raise ComponentError if a component has failed or all have ended."""
    if simulation.failed:
        raise ComponentError(f"{', '.join(simulation.failed)} failed; the log says why")
    if simulation.over:
        raise ComponentError("all components have ended")
