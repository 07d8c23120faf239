"""`rcdeploy trust`: save the key of a host, once the user has confirmed it."""

from __future__ import annotations

import argparse
import sys

from ...spelling import enumerated
from ..common import FINE, UNREACHABLE, WRONG, complain

NAME = "trust"
HELP = "save the SSH key of a host"

_EXAMPLES = """\
examples:
  rcdeploy trust 192.168.1.10           show the key of a host, ask, and save it
  rcdeploy trust robot@onboard:2222     ... of one at another port
  rcdeploy trust onboard --fingerprint SHA256:…
                                        ... save it without a question if it is this one
  on the host itself: ssh-keygen -lf /etc/ssh/ssh_host_ed25519_key.pub

exit status: 0 fine, 1 refused, 2 usage, 3 the host cannot be reached
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Show the SSH key of a host, ask, and save it.", _EXAMPLES
    to.add_argument("host", metavar="HOST", help="[USER@]ADDRESS[:PORT]")
    given = to.add_mutually_exclusive_group()
    given.add_argument("--yes", action="store_true", help="do not ask")
    given.add_argument("--fingerprint", metavar="SHA256:…", help="do not ask, and take this key alone")


def run(options: argparse.Namespace) -> int:
    from ...deploy.hosts.fleet import check_ssh
    from ...errors import DeploymentError, HostUnreachable

    try:
        check_ssh()
        from ...deploy.hosts import ssh, trusting

        presented = ssh.presented(options.host)
        if not _agreed(options, presented):
            return WRONG
        path = trusting.remember(presented)
    except HostUnreachable as exc:
        complain(f"rcdeploy: {exc}")
        return UNREACHABLE
    except DeploymentError as exc:
        return complain(f"rcdeploy: {exc}")
    print(f"saved the key of {presented.host} in {path}")
    return FINE


def _agreed(options: argparse.Namespace, presented: object) -> bool:
    from ...deploy.hosts.trusting import Presented

    assert isinstance(presented, Presented)
    print(f"{presented.host} (port {presented.port}) has the key {presented.fingerprint}", flush=True)
    if presented.fingerprint in presented.known:
        print("this key is known already")
    elif presented.known:
        known = enumerated(presented.known)
        print(f"another key is known: {known}; another machine may be intercepting the connection", flush=True)
    if options.fingerprint:
        if options.fingerprint != presented.fingerprint:
            complain(f"rcdeploy: the key is not {options.fingerprint}; it was not saved")
        return bool(options.fingerprint == presented.fingerprint)
    if options.yes:
        return True
    if not sys.stdin.isatty():
        complain("rcdeploy: cannot ask, since stdin is not a terminal; use --fingerprint or --yes")
        return False
    print("On the host: ssh-keygen -lf /etc/ssh/ssh_host_ed25519_key.pub")
    try:
        answer = input("Is that right? [y/N] ")
    except EOFError:
        answer = ""
    if answer.strip().lower() not in ("y", "yes"):
        complain("rcdeploy: the key was not saved")
        return False
    return True
