"""Programs that announce nothing, as the networks that run here describe them: where they are, and what they offer."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from ..contract.told import Supplement
from ..errors import ConfigurationError, DeploymentError, TransportError
from ..transports.census import Told
from ..transports.deployment import deployment_of
from ..transports.runtime_folder import runtime_dir

log = logging.getLogger("robocomp.tools")

_LARGEST = 64 * 1024 * 1024
"""Octets of a plan; larger files are not read."""

_ROLES = {"query": "serves", "command": "receives", "publish": "publishes"}


class Described(NamedTuple):
    """One end of a channel, as a network describes it."""

    instance: str
    middleware: str
    told: Told
    supplement: Supplement
    host: str
    """Where its program runs, by the name in its network; "" for this host."""
    options: Mapping[str, Any]
    """With which the middleware reaches it."""


def described(*, running: bool = True) -> list[Described]:
    """What foreign programs serve and publish, of all networks that run here.

    With `running`, their networks are asked which of them run. Else the programs have no process number.
    """
    try:
        plans = sorted(runtime_dir("deploy").glob("*/plan.json"))
    except (OSError, ConfigurationError, TransportError):
        return []
    return [each for plan in plans if _served(plan) for each in _of(plan, asks=running)]


def _served(plan: Path) -> tuple[Described, ...]:
    """What a plan describes, whether its network runs or not; nothing if it is not understood."""
    try:
        at = plan.stat()
        return _read(plan, at.st_ino, at.st_mtime_ns) if at.st_size <= _LARGEST else ()
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as exc:
        log.debug("%s is not understood: %r", plan, exc)  # its network is ending, or is of another version
        return ()


@lru_cache(100)
def _read(plan: Path, inode: int, changed: int) -> tuple[Described, ...]:
    """A plan does not change while its network runs, and may be large."""
    whole = json.loads(plan.read_bytes())
    hosts = {name: str(each["host"]) for each in whole["processes"] for name in each["instances"]}
    return tuple(
        Described(
            each["instance"],
            str(programs["middleware"]),
            _told(each),
            _supplement(each["supplement"]),
            hosts[each["instance"]],
            dict(programs["options"]),
        )
        for programs in whole.get("programs", ())
        for each in programs["serve"]
    )


def _told(each: Mapping[str, Any]) -> Told:
    role = _ROLES[each["pattern"]]
    return Told(str(each["owner"]), 0, role, str(each["channel"]), int(each["fingerprint"]), str(each["text"]))


def _supplement(each: Mapping[str, Any]) -> Supplement:
    bases = {
        str(name): tuple((str(base), int(number)) for base, number in those) for name, those in each["bases"].items()
    }
    return Supplement(bool(each["idempotent"]), bool(each["confirm"]), bases)


def _of(plan: Path, *, asks: bool) -> Iterator[Described]:
    from ..deploy.place import Place  # most networks have no such programs

    if Place(plan.parent.name, plan.parents[1]).runner() is None:
        return
    if not asks:
        yield from _served(plan)
        return
    pids = _pids(plan.parent.name)
    for each in _there(_served(plan)):
        pid = 0 if pids is None else pids.get(each.instance)
        if pid is not None:
            yield each._replace(told=each.told._replace(pid=pid))


def _there(every: Iterable[Described]) -> Iterator[Described]:
    """Without the topics that there are not now."""
    topics: dict[tuple[str, str], list[Described]] = {}
    for each in every:
        if each.told.role != "publishes":
            yield each
        else:
            topics.setdefault((each.middleware, json.dumps(each.options, sort_keys=True)), []).append(each)
    for (middleware, _), together in topics.items():
        names = [each.told.channel for each in together]
        now = deployment_of(middleware).published(together[0].options, names)
        yield from (each for each in together if each.told.channel in now)


def _pids(network: str) -> Mapping[str, int] | None:
    """The instances of a network whose processes exist, and their numbers, 0 if unknown; None if it does not tell."""
    from ..deploy.client import Connection, NotRunning

    try:
        with Connection(network) as connection:
            processes = connection.status().processes
    except NotRunning:
        return {}
    except DeploymentError:
        return None
    return {name: each.pid or 0 for each in processes if not each.state.gone for name in each.instances}
