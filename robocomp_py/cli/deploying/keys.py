"""`rcdeploy keys`: the keys and certificates of the processes that may take part in a network."""

from __future__ import annotations

import argparse
import datetime
from typing import TYPE_CHECKING

from ..common import FINE, complain
from ..network import add_network
from .guarding import add_keys, keys_of
from .planning import planned
from .up import seconds

if TYPE_CHECKING:
    from ...deploy.keys import Made

NAME = "keys"
HELP = "make the keys and certificates of a network"

_EXAMPLES = """\
examples:
  rcdeploy keys net.ddsl              make what is missing, has expired, or will within 30 days
  rcdeploy keys net.ddsl --operator   ... also for tools: rc echo --network net.ddsl LaserPub
  rcdeploy keys net.ddsl --renew      make all of them again, except the authority
  rcdeploy keys net.ddsl --days 90    ... certificates for three months, instead of a year
  rcdeploy keys net.ddsl -o DIR       ... in that folder; start it with rcdeploy net.ddsl --keys DIR

exit status: 0 fine, 1 the network is wrong or the keys cannot be written, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = "Make the keys and certificates of a network with `security lan`.", _EXAMPLES
    add_network(to)
    add_keys(to, ("-o", "--keys"))
    to.add_argument(
        "--operator",
        action=argparse.BooleanOptionalAction,
        help="also make, or remove, keys for tools such as rc echo: they may hear all topics, ask components what "
        "they are and count, and call what `allow` in the network lists (default: as it is)",
    )
    to.add_argument("--renew", action="store_true", help="make all keys and certificates again")
    to.add_argument("--days", type=_days, metavar="N", help="validity of the certificates in days (default: 365)")


def run(options: argparse.Namespace) -> int:
    from ...deploy.keys import DAYS, make_keys
    from ...deploy.plan import Security
    from ...errors import DeploymentError

    plan = planned(options)
    if isinstance(plan, int):
        return plan
    folder = keys_of(plan, options)
    now = datetime.datetime.now(datetime.UTC)
    try:
        made = make_keys(plan, folder, now, days=options.days or DAYS, renew=options.renew, operator=options.operator)
    except DeploymentError as exc:
        return complain(f"rcdeploy: {exc}")
    print(f"keys of {plan.name} in {folder}")
    for each in made:
        print(f"  {_told(each)}")
    if plan.security is not Security.LAN:
        print(f"{options.network} does not use them yet: add `security lan;` to it")
    return FINE


def _told(made: Made) -> str:
    state = "" if "removed" in made.what else ": made" if made.is_new else ": there already"
    until = f", valid until {made.expires:%Y-%m-%d}" if made.expires else ""
    return f"{made.what}{state}{until}"


def _days(text: str) -> float:
    try:
        days = seconds(text)
    except argparse.ArgumentTypeError:
        days = 0.0
    if not 0 < days <= 3650:
        raise argparse.ArgumentTypeError(f"`{text}` is not a number of days up to 3650, as in --days 90")
    return days
