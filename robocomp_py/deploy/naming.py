"""The processes that a user means by the name of an instance, process or system."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ..errors import DeploymentError
from ..spelling import unknown
from .snapshot import ProcessStatus

DEPLOYER = "rcdeploy"
"""The name of rcdeploy's own messages among those of the processes."""


def meant(names: Iterable[str], processes: Sequence[ProcessStatus]) -> list[ProcessStatus]:
    """The processes of these instances, processes and systems, each once, in their order.

    Raises DeploymentError, with what may have been meant, for a name that nothing has.
    """
    by_name: dict[str, list[ProcessStatus]] = {}
    for each in processes:
        own = (each.name, *each.instances)
        for name in dict.fromkeys((*own, *(system for one in own for system in _around(one)))):
            by_name.setdefault(name, []).append(each)
    wanted = set[str]()
    for name in names:
        if name not in by_name:
            raise DeploymentError(unknown("instance", name, by_name))
        wanted |= {each.name for each in by_name[name]}
    return [each for each in processes if each.name in wanted]


def _around(name: str) -> list[str]:
    """The systems around an instance: `left` and `left/wrist` for `left/wrist/joint`."""
    parts = name.split("/")
    return ["/".join(parts[:count]) for count in range(1, len(parts))]
