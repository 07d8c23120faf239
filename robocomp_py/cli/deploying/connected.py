"""Shared by the commands for running networks: how a network is named, and the error if it is not running."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from ..common import UNREACHABLE, complain, raise_if_signalled
from ..completing import What, completed

if TYPE_CHECKING:
    from ...deploy.client import Connection
    from ...deploy.table import Line

NETWORK = "NET.ddsl"


def add_network(to: argparse.ArgumentParser) -> None:
    completed(to.add_argument("network", metavar=NETWORK, help="the network, by its file or by its name"), What.NETWORK)


def connected(network: str, action: Callable[[Connection], int], absent: Callable[[], int | None] | None = None) -> int:
    """Call `action` with the connection to a running network. Prints an error, with advice, if that fails.

    `absent` may handle a network that does not run here; then it returns the exit code.
    """
    from ...deploy.client import Connection, NotRunning, network_of
    from ...errors import DeploymentError, HostUnreachable
    from ...spelling import and_then

    try:
        try:
            with Connection(network_of(network)) as connection:
                raise_if_signalled()  # on a signal that came meanwhile: some of these run without end
                return action(connection)
        except NotRunning:
            if absent and (code := absent()) is not None:
                return code
            raise
    except NotRunning as exc:
        start = f"start it: rcdeploy {shlex.quote(network)}"
        return complain(f"rcdeploy: {and_then(str(exc), start) if os.path.isfile(network) else exc}")
    except HostUnreachable as exc:
        complain(f"rcdeploy: {exc}")
        return UNREACHABLE
    except DeploymentError as exc:
        return complain(f"rcdeploy: {exc}")


# Output, styled without a library: importing one would take longer than the rest of the command.

_CODES = {
    "bold": "1", "dim": "2", "red": "31", "green": "32", "yellow": "33", "blue": "34", "magenta": "35", "cyan": "36",
}  # fmt: skip


def show(line: Line) -> None:
    from ...deploy.harmless import harmless

    line = [(harmless(text), style) for text, style in line]
    if sys.stdout.isatty() and "NO_COLOR" not in os.environ:
        print("".join(_styled(text, style) for text, style in line))
    else:
        print("".join(text for text, _ in line))


def _styled(text: str, style: str) -> str:
    codes = ";".join(_CODES[word] for word in style.split())
    return f"\033[{codes}m{text}\033[0m" if codes else text
