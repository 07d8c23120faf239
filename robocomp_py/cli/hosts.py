"""The hosts that a command looks at: this one, and those of running networks, by their scouts."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .common import FINE, UNREACHABLE
from .completing import What, completed

if TYPE_CHECKING:
    from ..tools.network import Network
    from ..tools.posts import Post

HERE = "here"
"""The name of this host, for options."""


def add_hosts(to: argparse.ArgumentParser) -> None:
    network = to.add_argument(
        "--network",
        metavar="NET",
        help="a network that rcdeploy runs here, by its name or file: also look at its other hosts (default: all that "
        "run here)",
    )
    completed(network, What.NETWORK)
    to.add_argument(
        "--keys",
        metavar="DIR",
        help="folder of the keys of a network with `security lan`, made by rcdeploy keys --operator (default: with "
        "--network, that of its rcdeploy, if it has such keys)",
    )
    to.add_argument(
        "--host",
        dest="hosts",
        action="append",
        default=[],
        metavar="HOST",
        help=f"look at this host only; `{HERE}` is this machine; may be repeated",
    )


class Hosts:
    """What runs on all hosts that the options of `add_hosts` mean."""

    def __init__(
        self,
        posts: Sequence[Post],
        host_of: Mapping[str, str],
        *,
        here: bool,
        options: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> None:
        """`options` are those of middlewares on this host."""
        self.posts, self._host_of, self._here, self._options = posts, host_of, here, options
        self.lost: dict[str, str] = {}
        """The hosts that the last census could not ask, and why."""

    def census(self, middlewares: Sequence[str], *, own: bool = False) -> Network:
        """As `tools.census.take_census`. What cannot be asked on another host is told on stderr, once."""
        from ..tools.census import check_names, take_census
        from ..tools.network import Network

        if not self.posts:
            return take_census(middlewares, own=own, options=self._options)
        from ..tools.posts import merged, survey
        from ..transports.deployment import deployment_of

        check_names(middlewares)
        here = take_census(middlewares, own=True, options=self._options).ends if self._here else ()
        elsewhere, lost, troubles = survey(self.posts, middlewares)
        for text in [why for host, why in lost.items() if host not in self.lost] + troubles:
            print(f"warning: {text}", file=sys.stderr)
        self.lost = lost
        ends = merged(here, elsewhere, self._host_of, lambda name: bool(deployment_of(name).directory))
        return Network(ends, own=own)

    def code(self, code: int = FINE) -> int:
        """The exit code of a command that would end with `code`: it says so if a host was out of reach."""
        return UNREACHABLE if self.lost else code


@contextlib.contextmanager
def hosts_of(options: argparse.Namespace) -> Iterator[Hosts]:
    """The hosts that these options mean. Their scouts end with it. Raises RobocompError."""
    from ..errors import ConfigurationError
    from ..spelling import unknown

    plans = _plans(options.network)
    known = {host["name"]: name for name, plan in plans.items() for host in plan["hosts"]}
    for name in options.hosts:
        if name not in known and name != HERE:
            if not known:
                raise ConfigurationError(f"--host {name}: no network with other hosts runs here")
            raise ConfigurationError(unknown("host", name, [HERE, *known]))
    here = not options.hosts or HERE in options.hosts
    if not known:
        yield Hosts((), {}, here=here, options=_operator(plans, options))
        return
    from ..tools.posts import Post  # a command on a single host does without

    wanted = [name for name in known if name in options.hosts or not options.hosts]
    posts = [Post(name, partial(_connected, known[name], name)) for name in wanted]
    processes = [each for plan in plans.values() for each in plan["processes"]]
    host_of = {instance: each["host"] for each in processes for instance in each["instances"]}
    try:
        yield Hosts(posts, host_of, here=here, options=_operator(plans, options))
    finally:
        for each in posts:
            each.close()


def _operator(plans: Mapping[str, Any], options: argparse.Namespace) -> dict[str, Mapping[str, Any]]:
    """The options of middlewares with which a tool takes part in a network with keys, as its operator."""
    from ..errors import ConfigurationError
    from ..transports.deployment import deployment_of
    from ..transports.permissions import OPERATOR

    if not (options.network or options.keys):
        return {}
    helpers = [each for plan in plans.values() for each in plan.get("helpers", ()) if each["keys"]]
    found: dict[str, Mapping[str, Any]] = {}
    for each in sorted(helpers, key=lambda each: bool(each["host"])):  # that of this host first
        folder = Path(options.keys or Path(each["keys"]).parent, OPERATOR)
        if not (folder / "certificate.pem").is_file():
            continue
        visiting = deployment_of(each["middleware"]).visiting(each["options"], str(folder), is_here=not each["host"])
        if visiting:
            found.setdefault(each["middleware"], visiting)
    if options.keys and not found:
        if not Path(options.keys, OPERATOR, "certificate.pem").is_file():
            raise ConfigurationError(
                f"--keys {options.keys}: there are no keys of an operator; make them: rcdeploy keys NET.ddsl --operator"
            )
        raise ConfigurationError("--keys: no network that needs an operator runs here")
    return found


def _connected(network: str, host: str) -> Any:
    from ..deploy.client import ScoutLine

    return ScoutLine(network, host)


def _plans(wanted: str | None) -> dict[str, Any]:
    """The plans of running networks that have other hosts, by name.

    What makes a connection takes long to import, so plans are looked into first.
    """
    from ..errors import ConfigurationError, DeploymentError, TransportError
    from ..transports.directory import runtime_dir

    if not wanted:
        try:
            if not any(map(_has_hosts, runtime_dir("deploy").glob("*/plan.json"))):
                return {}
        except (ConfigurationError, TransportError):
            return {}  # a census says so, too
    from ..deploy.client import NotRunning, network_of, networks, not_running, running_plan

    found = {}
    for name in [network_of(wanted)] if wanted else networks():
        try:
            plan = running_plan(name)
        except DeploymentError as exc:
            if wanted:
                raise
            print(f"warning: {exc}", file=sys.stderr)
            continue
        if wanted and plan is None:
            raise NotRunning(not_running(name))
        if plan and plan.get("hosts"):
            found[name] = plan
    return found


def _has_hosts(plan: Any) -> bool:
    try:
        return bool(json.loads(plan.read_text(encoding="utf-8")).get("hosts"))
    except (OSError, ValueError, AttributeError):
        return False
