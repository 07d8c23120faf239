"""Checks before the start of a network: whether its security allows it, and whether its keys exist."""

from __future__ import annotations

import argparse
import datetime
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ..common import complain
from ..network import override_words

if TYPE_CHECKING:
    from ...deploy.plan import Plan


def add_keys(to: argparse.ArgumentParser, flags: tuple[str, ...] = ("--keys",)) -> None:
    to.add_argument(
        *flags,
        dest="keys",
        type=Path,
        metavar="DIR",
        help="folder of the network's keys (default: keys/NAME beside the network)",
    )


def add_guards(to: argparse.ArgumentParser) -> None:
    add_keys(to)
    to.add_argument(
        "--insecure",
        action="store_true",
        help="start a network with `security open;`: any machine can listen and send commands",
    )


def keys_of(plan: Plan, options: argparse.Namespace) -> Path:
    """The folder of a network's keys."""
    network: Path = options.network
    chosen: Path | None = options.keys
    return chosen or network.absolute().parent / "keys" / plan.name


def with_keys(plan: Plan, options: argparse.Namespace) -> Plan:
    """The network with the keys that it has, for `rcdeploy plan`. What would keep it from starting is only printed."""
    from ...deploy import security
    from ...errors import DeploymentError

    try:
        errors, warnings = _troubles(plan, options)
    except DeploymentError as exc:
        errors, warnings = [str(exc)], []
    for error in (*errors, *_hindrances(plan)):
        _warn(f"it cannot be started as it is: {error}")
    for warning in warnings:
        _warn(warning)
    try:
        return security.secured(plan, keys_of(plan, options))
    except DeploymentError:  # already printed
        return plan


def guarded(plan: Plan, options: argparse.Namespace) -> Plan | int:
    """The network with its keys; if it must not be started, prints the reasons and returns the exit code."""
    from ...deploy import security
    from ...errors import DeploymentError

    if reason := security.why_not(plan, insecure=options.insecure):
        return complain(f"rcdeploy: {reason}")
    if told := security.warning(plan):
        print(f"rcdeploy: WARNING: {told}", file=sys.stderr, flush=True)
    try:
        errors, warnings = _troubles(plan, options)
    except DeploymentError as exc:
        return complain(f"rcdeploy: {exc}")
    for each in warnings:
        _warn(each)
    errors += _hindrances(plan)
    for each in errors:
        complain(f"rcdeploy: {each}")
    return 1 if errors else security.secured(plan, keys_of(plan, options))


def _hindrances(plan: Plan) -> list[str]:
    """What this machine lacks for the network."""
    from ...deploy.surroundings import hindrances
    from ...errors import ConfigurationError, DeploymentError

    try:
        return hindrances(plan)
    except (ConfigurationError, DeploymentError) as exc:
        return [str(exc)]


def _troubles(plan: Plan, options: argparse.Namespace) -> tuple[list[str], list[str]]:
    """What is wrong with the keys of a network that needs some: errors and warnings. Raises DeploymentError."""
    from ...deploy.keys import troubles
    from ...deploy.plan import Security

    if plan.security is not Security.LAN:
        return [], []
    now = datetime.datetime.now(datetime.UTC)
    network = shlex.join([str(options.network), *override_words(options)])
    return troubles(plan, keys_of(plan, options), now, network)


def _warn(text: str) -> None:
    print(f"rcdeploy: warning: {text}", file=sys.stderr, flush=True)
