"""What is looked at before a network is started: whether its security lets it be, and whether its keys are there."""

from __future__ import annotations

import argparse
import datetime
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ..common import complain

if TYPE_CHECKING:
    from ...deploy.plan import Plan


def add_keys(to: argparse.ArgumentParser, flags: tuple[str, ...] = ("--keys",)) -> None:
    to.add_argument(
        *flags, dest="keys", type=Path, metavar="DIR", help="the folder of its keys (default: keys/NAME beside it)"
    )


def add_guards(to: argparse.ArgumentParser) -> None:
    add_keys(to)
    to.add_argument(
        "--insecure", action="store_true", help="yes, `security open;` is meant: whoever comes may listen and command"
    )


def keys_of(plan: Plan, options: argparse.Namespace) -> Path:
    """The folder of a network's keys."""
    network: Path = options.network
    chosen: Path | None = options.keys
    return chosen or network.absolute().parent / "keys" / plan.name


def with_keys(plan: Plan, options: argparse.Namespace) -> Plan:
    """The network as it would be started, if it has keys; nothing is looked at or told."""
    from ...deploy import security
    from ...errors import DeploymentError

    try:
        return security.secured(plan, keys_of(plan, options))
    except DeploymentError:
        return plan


def guarded(plan: Plan, options: argparse.Namespace) -> Plan | int:
    """The network with its keys, or the exit code if it must not be started as it is, why having been told."""
    from ...deploy import security
    from ...deploy.keys import troubles
    from ...deploy.plan import Security
    from ...errors import DeploymentError

    if reason := security.why_not(plan, insecure=options.insecure):
        return complain(f"rcdeploy: {reason}")
    if told := security.warning(plan):
        print(f"rcdeploy: WARNING: {told}", file=sys.stderr, flush=True)
    if plan.security is not Security.LAN:
        return plan
    folder = keys_of(plan, options)
    try:
        errors, warnings = troubles(plan, folder, datetime.datetime.now(datetime.UTC), str(options.network))
    except DeploymentError as exc:
        return complain(f"rcdeploy: {exc}")
    for each in warnings:
        print(f"rcdeploy: warning: {each}", file=sys.stderr, flush=True)
    for each in errors:
        complain(f"rcdeploy: {each}")
    return 1 if errors else security.secured(plan, folder)
