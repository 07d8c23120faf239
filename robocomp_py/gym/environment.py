"""A network as an environment of Gymnasium."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, SupportsFloat

import numpy as np
from numpy.typing import NDArray

from ..client.values import fitted
from ..contract.interface import Pattern
from ..errors import ConfigurationError, EncodeError
from ..spelling import unknown
from ..testing.simulation import network_parts
from ..virtual.outside import Provided, goals, provided
from ..virtual.simulation import Simulation
from ..wire.explain import explain
from .driving import MOST_SEED, Driver, driver
from .values import Action, Observation, Range

try:
    import gymnasium
    from gymnasium import spaces
except ImportError as exc:
    raise ConfigurationError(f"environments need Gymnasium: pip install 'robocomp-py[gym]' ({exc})") from exc

Observed = dict[str, Any]
"""Arrays of one dimension by the names of the observations."""

Chosen = NDArray[np.float32]

Reward = Callable[[Observed, Chosen, Observed], float]
"""The reward of a step, from the observation before it, the action, and the observation after it."""

Ended = Callable[[Observed], bool]


def _never(observed: Observed) -> bool:
    return False


class NetworkEnv(gymnasium.Env[Observed, Chosen]):
    """Runs a network in virtual time; the agent calls operations of it, and observes messages of it.

    Its action is an array of numbers from -1 to 1, one for each `Range` in `actions`, in their order. Its observation
    is a dictionary of arrays of one dimension, one for each item of `observations`.
    """

    def __init__(
        self,
        network: Path | str,
        *,
        actions: Mapping[str, Mapping[str, Any]],
        observations: Mapping[str, Range | None],
        reward: Reward,
        ended: Ended = _never,
        begin: Callable[[NetworkEnv], object] | None = None,
        seconds: float = 0.05,
        include: Sequence[Path] = (),
        settings: Sequence[tuple[str, str]] = (),
    ) -> None:
        """`network` is a .ddsl file.

        `actions` has the calls of each step by the names of their operations, `base/DifferentialRobot/setSpeedBase`,
        and for each its inputs by name, with a `Range` in the place of each number that the agent chooses.
        `observations` has what is observed, `laser/Laser/getLaserData.ret[*].dist`: an operation without inputs, which
        is called after each step, or a topic, of which the latest message counts; and the path of a number or of
        several ones in its message. Each has a `Range`, or None for the whole range of an integer type.

        `ended` says of an observation whether the episode ends with it. `begin` is called at the start of each
        episode, before the first observation; it uses `call` and `np_random`. A step lasts `seconds` of virtual time.
        `include` and `settings` are those of `robocomp_py.testing.simulation.Simulation`.

        The network is started once, to learn the lengths of its sequences. Raises DeploymentError for a network that
        cannot be simulated, KeyError for an unknown operation, ValueError for an action or what does not fit, and
        ComponentError if the network does not start.
        """
        for what, given in (("actions", actions), ("observations", observations)):
            if not isinstance(given, Mapping):
                raise TypeError(f"{what}: it must be a dictionary, not {given!r}")
        if not 0.0 < seconds <= 1000.0:
            raise ValueError(f"a step of {seconds} s: it has to be more than 0, and at most 1000")
        parts = network_parts(network, include=include, settings=settings)
        self._network, self._goals = provided(parts), goals(parts)
        self._actions = [self._action(name, arguments) for name, arguments in actions.items()]
        self._observations = [self._observation(name, bounds) for name, bounds in observations.items()]
        if not sum(each.size for each in self._actions):
            raise ValueError("actions: there is nothing to choose; write a Range in the place of a number")
        if not observations:
            raise ValueError("observations: there are none")
        self._reward, self._ended, self._begin = reward, ended, begin
        observed = list(dict.fromkeys(operation for operation, _ in self._observations))
        self._driver: Driver = driver(parts, [*actions, *self._asked(observed)], observed, seconds)
        self._now: Observed = {}
        """The latest observation."""
        self._is_over = True
        self._size = sum(each.size for each in self._actions)
        self.action_space = spaces.Box(-1.0, 1.0, (self._size,), np.float32)
        self._lengths: dict[str, int] = {}
        """Of the observations, at the beginning."""
        self._driver.reset(0)
        try:
            self.observation_space = self._space()
        except BaseException:
            self._driver.close()
            raise

    @property
    def simulation(self) -> Simulation:
        """The network of this episode, to look into: `env.simulation["house"].worker`. The next one has another."""
        return self._driver.simulation

    def call(self, operation: str, **inputs: Any) -> Any:
        """Call an operation of the network now, by the names of its inputs, and return its result.

        Structs may be given as dictionaries of their fields. Raises KeyError for an unknown operation, TypeError for
        wrong names of inputs, ValueError for an action, EncodeError for wrong values, and what the call raises.
        """
        each = self._found(operation)
        known = [field.name for field in each.operation.inputs]
        if sorted(known) != sorted(inputs):
            raise TypeError(
                f"{operation} takes {', '.join(known) or 'nothing'}, and not {', '.join(inputs) or 'nothing'}"
            )
        values = tuple(
            fitted(field.type, inputs[field.name], f"{operation}: {field.name}") for field in each.operation.inputs
        )
        try:
            return self._driver.call(operation, values)
        except (TypeError, ValueError) as exc:  # a scene is called without a codec, which would check the values
            if wrong := explain(each.operation.request, values):
                raise EncodeError(wrong) from exc
            raise

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observed, dict[str, Any]]:
        """Begin an episode: the network begins again, with random numbers of its own.

        They are those of all components, and the value of each parameter `seed`. There are no options.
        """
        super().reset(seed=seed)
        if options:
            raise ValueError(f"{unknown('option', next(iter(options)), ())}: `reset` has no options")
        self._driver.reset(int(self.np_random.integers(MOST_SEED + 1)))
        if self._begin:
            self._begin(self)
            self._driver.settle()
        self._now, self._is_over = self._observed(), False
        return _copied(self._now), {}

    def step(self, action: Chosen) -> tuple[Observed, float, bool, bool, dict[str, Any]]:
        """Call what the action says, let a step pass, and observe. Numbers beyond -1 and 1 count as those.

        Raises ValueError for an action of another shape, or with NaN, and after the end of the episode.
        """
        if self._is_over:
            raise ValueError("the episode is over: call `reset`")
        chosen = np.asarray(action, np.float32)
        if chosen.shape != (self._size,) or not all(map(math.isfinite, chosen.tolist())):
            raise ValueError(f"{action} is no action, which has {self._size} finite numbers")
        taken = iter(chosen.tolist())
        self._driver.step({each.name: each.arguments(taken) for each in self._actions})
        before, self._now = self._now, self._observed()
        self._is_over = bool(self._ended(self._now))
        reward = self._reward(before, chosen, self._now)
        if not isinstance(reward, float | SupportsFloat):  # the latter alone takes 20 times as long
            raise TypeError(f"reward: it returned {reward!r}, which is not a number")
        return _copied(self._now), float(reward), self._is_over, False, {}

    def close(self) -> None:
        """Stop the network. Idempotent."""
        self._is_over = True
        self._driver.close()
        super().close()

    def _action(self, name: str, arguments: Mapping[str, Any]) -> Action:
        each = self._found(name)
        if each.pattern is Pattern.PUBLISH:
            raise ValueError(f"{name} is a topic: an action calls an operation")
        return Action(name, each.operation, arguments)

    def _observation(self, name: str, bounds: Range | None) -> tuple[str, Observation]:
        operation, _, path = name.partition(".")
        each = self._found(operation)
        if not isinstance(bounds, Range | None):
            raise TypeError(f"{name}: give it a Range, or None, and not {bounds!r}")
        if each.pattern is Pattern.PUBLISH:
            fields = each.operation.inputs
        elif each.operation.inputs:
            inputs = ", ".join(field.name for field in each.operation.inputs)
            raise ValueError(f"{operation} needs {inputs}: only what is called without inputs is observed")
        else:
            fields = each.operation.outputs
        if not fields:
            raise ValueError(f"{operation} has no result, so there is nothing to observe")
        if not path:
            raise ValueError(f"{name}: name a number in its message, such as {operation}.{fields[0].name}")
        return operation, Observation(name, fields, path, bounds)

    def _found(self, name: str) -> Provided:
        if name in self._goals:
            raise ValueError(f"{name} is an action, whose goals last for many steps: an environment calls operations")
        if name not in self._network:
            raise KeyError(unknown("operation", name, [*self._network, *sorted(self._goals)]))
        return self._network[name]

    def _asked(self, observed: Sequence[str]) -> list[str]:
        return [each for each in observed if self._network[each].pattern is not Pattern.PUBLISH]

    def _observed(self) -> Observed:
        values = self._driver.observe()
        made = {each.name: each.of(values[operation]) for operation, each in self._observations}
        for name, length in self._lengths.items():
            if made[name].size != length:
                raise ValueError(f"{name} has {made[name].size} numbers now, and had {length} at the beginning")
        return made

    def _space(self) -> spaces.Dict[Any]:
        self._lengths = {name: array.size for name, array in self._observed().items()}
        if empty := [name for name, length in self._lengths.items() if not length]:
            raise ValueError(f"{', '.join(empty)}: empty at the beginning, so there is no fixed length")
        found = [
            (each.name, spaces.Box(each.low, each.high, (self._lengths[each.name],), each.dtype.type))
            for _, each in self._observations
        ]
        return spaces.Dict(found)  # a list keeps its order, unlike a dictionary


def _copied(observed: Observed) -> Observed:
    """For the agent, which may change it."""
    return {name: array.copy() for name, array in observed.items()}
