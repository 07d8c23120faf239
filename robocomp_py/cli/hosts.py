"""The hosts that a command looks at: this one, and those of running networks, by their scouts."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .common import FINE, UNREACHABLE
from .completing import What, completed

if TYPE_CHECKING:
    from ..tools.census import Seen
    from ..tools.network import Network
    from ..tools.posts import Post

HERE = "here"
"""The name of this host, for options."""


def add_hosts(to: argparse.ArgumentParser, *, network: bool = True) -> None:
    """Without `network`, for commands that have another argument for it."""
    if network:
        named = to.add_argument(
            "--network",
            metavar="NET",
            help="a network that rcdeploy runs here, by its name or file: also look at its other hosts (default: all "
            "that run here)",
        )
        completed(named, What.NETWORK)
    to.add_argument(
        "--keys",
        metavar="DIR",
        help="folder of the keys of a network with `security lan`, made by rcdeploy keys --operator (default: with "
        "--network, that of its rcdeploy, if it has such keys)",
    )
    host = to.add_argument(
        "--host",
        dest="hosts",
        action="append",
        default=[],
        metavar="HOST",
        help=f"look at this host only; `{HERE}` is this machine; may be repeated",
    )
    completed(host, What.HOST)


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
        self.posts, self._host_of, self.here, self._options = posts, host_of, here, options
        self.lost: dict[str, str] = {}
        """The hosts that the last census could not ask, and why."""

    def census(self, middlewares: Sequence[str], *, own: bool = False) -> Network:
        """As `tools.census.take_census`. What cannot be asked on another host is told on stderr, once."""
        from ..tools.census import Seen, check_names, take_census
        from ..tools.network import Network

        if not self.posts:
            return take_census(middlewares, own=own, options=self._options)
        check_names(middlewares)
        here = take_census(middlewares, own=True, options=self._options).ends if self.here else ()
        known = set(self.lost)
        seen = self._merged(Seen(list(here)), middlewares)
        for text in [why for host, why in self.lost.items() if host not in known] + seen.troubles:
            print(f"warning: {text}", file=sys.stderr)
        return Network(seen.ends, own=own)

    def look(self, middlewares: Sequence[str]) -> Seen:
        """As `tools.census.take_each`. Hosts that cannot be asked are among the troubles."""
        from ..tools.census import Seen, take_each

        here = take_each(middlewares, self._options) if self.here else Seen()
        if not self.posts:
            return here
        seen = self._merged(here, middlewares)
        return replace(seen, troubles=[*self.lost.values(), *seen.troubles])

    def _merged(self, here: Seen, middlewares: Sequence[str]) -> Seen:
        from ..tools.census import Seen
        from ..tools.survey import merged, survey
        from ..transports.deployment import deployment_of

        there, self.lost = survey(self.posts, middlewares)
        ends = merged(here.ends, there.ends, self._host_of, lambda name: bool(deployment_of(name).directory))
        return Seen(ends, {**here.tellers, **there.tellers}, [*here.troubles, *there.troubles])

    def code(self, code: int = FINE) -> int:
        """The exit code of a command that would end with `code`: it says so if a host was out of reach."""
        return UNREACHABLE if self.lost else code


@contextlib.contextmanager
def hosts_of(options: argparse.Namespace, *, running: bool = True) -> Iterator[Hosts]:
    """The hosts that these options mean. Their scouts end with it.

    Unless `running`, the network need not run: then there is only this host. Raises RobocompError.
    """
    from ..errors import ConfigurationError
    from ..spelling import unknown

    plans = _plans(options.network, running=running)
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
    for plan in plans.values():  # some are not called as their channels are
        ours = plan.get("ours", {})
        host_of |= {each["channels"].strip("/"): host_of[name] for name, each in ours.items() if name in host_of}
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


def _plans(wanted: str | None, *, running: bool) -> dict[str, Any]:
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
        if wanted and plan is None and running:
            raise NotRunning(not_running(name))
        if plan and plan.get("hosts"):
            found[name] = plan
    return found


def _has_hosts(plan: Any) -> bool:
    try:
        return bool(json.loads(plan.read_text(encoding="utf-8")).get("hosts"))
    except (OSError, ValueError, AttributeError):
        return False
