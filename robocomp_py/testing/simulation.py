"""Run a whole network in a test, in virtual time: no waiting, and the same in every run.

    def test_help_is_called_within_a_minute():
        with Simulation(Path("components/rescue.ddsl"), seed=1) as sim:
            assert sim.run(until=lambda: sim["rescue"].state == "ended", at_most=60.0)

See docs/guides/simulating.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from .. import installed
from ..deploy.plan import Overrides
from ..deploy.planner import make_plan
from ..deploy.simulating import parts
from ..dsl.workspace import Workspace
from ..errors import DeploymentError
from ..transports.base import Transport, TransportConfig
from ..virtual.simulation import Failure, Part, Simulated
from ..virtual.simulation import Simulation as _Simulation
from ..virtual.turns import TurnThreads

if TYPE_CHECKING:
    from .calls import Calls

__all__ = ["Failure", "Simulated", "Simulation", "network_parts"]


class Simulation(_Simulation):
    def __init__(
        self,
        network: Path | str,
        seed: int = 0,
        *,
        include: Sequence[Path] = (),
        settings: Sequence[tuple[str, str]] = (),
        write: Callable[[str], object] | None = None,
    ) -> None:
        """`network` is a .ddsl file; `include` are further folders of models; `settings` change the configuration of
        instances: `("world", "params.noise=0.1")`. Raises DeploymentError with all that is wrong.
        """
        super().__init__(network_parts(network, include=include, settings=settings), seed, write)
        self._calls: Calls | None = None
        """Made by the first call."""

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if self._calls:
                self._calls.close(cancel=kind is None)
        finally:
            super().__exit__(kind, exc, trace)

    def call(self, operation: str, *values: Any, **named: Any) -> Any:
        """Call what a component implements, and return the result: `sim.call("world/Laser/getLaserData")`.

        Inputs are given in their order or by name, structs also as dictionaries or tuples of their fields. For an
        action, this returns its `Goal`, as soon as the component has accepted it. `goal.result(timeout)` lets the
        network run for at most `timeout` virtual seconds, by default 60. A call waits until the network has started.

        Raises KeyError for an unknown operation, ValueError for a topic, TypeError for wrong inputs, and what the call
        of a component raises.
        """
        if self._calls is None:
            from .calls import Calls  # few tests need it

            self._calls = Calls(self, self._parts, TurnThreads(self._executor), self._opened_by)
        return self._calls.call(operation, values, named)

    def _opened_by(self, name: str, middleware: str) -> Transport:
        return self._air.factory(middleware)(TransportConfig({}, name))


def network_parts(
    network: Path | str, *, include: Sequence[Path] = (), settings: Sequence[tuple[str, str]] = ()
) -> list[Part]:
    """The components of a network, of which simulations are made. About the arguments see `Simulation`."""
    workspace = Workspace(include)
    with installed.asked_once():
        plan = make_plan(Path(network), workspace, Overrides(settings=tuple(settings)))
    if plan is None:
        raise DeploymentError("\n".join(each.render() for each in workspace.report.diagnostics))
    return parts(plan)
