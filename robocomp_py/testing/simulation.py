"""Run a whole network in a test, in virtual time: no waiting, and the same in every run.

    def test_help_is_called_within_a_minute():
        with Simulation(Path("components/rescue.ddsl"), seed=1) as sim:
            assert sim.run(until=lambda: sim["rescue"].state == "ended", at_most=60.0)

See docs/guides/time.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from .. import installed
from ..deploy.plan import Overrides
from ..deploy.planner import make_plan
from ..deploy.simulating import parts
from ..dsl.workspace import Workspace
from ..errors import DeploymentError
from ..virtual.simulation import Part, Simulated
from ..virtual.simulation import Simulation as _Simulation

__all__ = ["Simulated", "Simulation", "network_parts"]


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
