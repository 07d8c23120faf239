"""`rc doctor`: what is wrong with this machine, and with what runs on it."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from .common import FINE, USAGE, WRONG, add_include, counted
from .completing import What, completed
from .hosts import add_hosts, code_of, hosts_of
from .live import add_json, add_middleware, reported
from .model import declared

if TYPE_CHECKING:
    from ..deploy.client import Connection
    from ..deploy.snapshot import ProcessStatus
    from ..tools.doctor.facts import Complaints, Launched

NAME = "doctor"

_EXAMPLES = """\
examples:
  rc doctor                        look at this machine, and at everything that runs on it
  rc doctor rescue.ddsl            ... and compare it with what a network declares
  rc doctor --check qos            only one check; may be repeated
  rc doctor --host base            only one host of a network that rcdeploy runs here
  rc doctor --list                 the names of all checks
  rc doctor --json                 a finding a line, for machines

A finding is an error or a warn(ing): what is wrong, and what to do. A note may be meant to be so.
Without a network, what runs is compared with the plans of all networks that rcdeploy runs here. The other hosts of
networks that run are looked at, too.

exit status: 0 nothing is wrong (there may be notes), 1 something is, 2 usage, 3 a host is out of reach, 130/143 by a
signal
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Look for what is wrong with this machine, and with the components that run on it."
    to.epilog = _EXAMPLES
    about = "a network, by its DDSL file or by its name if it runs"
    completed(to.add_argument("network", nargs="?", metavar="NET", help=about), What.NETWORK)
    check = to.add_argument(
        "--check", action="append", default=[], metavar="NAME", help="only this check; may be repeated"
    )
    completed(check, What.CHECK)
    to.add_argument("--list", action="store_true", help="list the checks")
    add_include(to)
    add_hosts(to, network=False)
    add_middleware(to)
    add_json(to)


def run(options: argparse.Namespace) -> int:
    from ..spelling import unknown
    from ..tools.census import check_names
    from ..tools.doctor.checks import CHECKS, examine
    from ..tools.doctor.collect import collect
    from ..tools.doctor.facts import Weight

    known = {each.NAME: each.HELP for each in CHECKS}
    for name in options.check:
        if name not in known:
            print(f"rc doctor: {unknown('check', name, known)}", file=sys.stderr)
            return USAGE
    if options.list:
        width = max(map(len, known))
        for name, text in known.items():
            print(json.dumps({"check": name, "finds": text}) if options.json else f"{name:{width}}  {text}")
        return FINE
    with reported("rc doctor") as code:
        check_names(options.middleware)
        plans = list(_plans(options))
        launched, complaints, unheard = _told_by_launchers(plans)
        with hosts_of(options, running=False) as hosts:
            told = plans, list(_killed()) if hosts.here else [], launched, complaints
            facts, troubles = collect(options.middleware, *told, look=hosts.look, posts=hosts.posts, here=hosts.here)
        troubles += unheard
        for each in troubles:
            print(f"rc doctor: could not look: {_shown(each)}", file=sys.stderr)
        found = list(examine(facts, options.check))
        for name, finding in found:
            if options.json:
                print(json.dumps({"check": name, **asdict(finding)}))
            else:
                there, do = (f"{finding.host}: ", f"on {finding.host}: ") if finding.host else ("", "")
                print(f"{finding.weight:5}  {there}{_shown(finding.text)}: {do}{_shown(finding.advice)}")
        wrong = sum(finding.weight is not Weight.NOTE for _, finding in found)
        notes = len(found) - wrong
        if not options.json:
            components = counted(len(facts.network.components()), "component")
            machines = [*(["this machine"] if hosts.here else []), *(each.host for each in facts.places)]
            checks = counted(len(set(options.check)) or len(CHECKS), "check")
            looked = f"{checks} of {', '.join(machines)} and {components}"
            also = f", {counted(notes, 'note')}" if notes else ""
            print(f"{looked}: {counted(wrong, 'finding')}{also}", file=sys.stderr)
        return code_of(hosts, WRONG if wrong or troubles else FINE)
    return code()


def _plans(options: argparse.Namespace) -> Iterator[Mapping[str, Any]]:
    """Of the network that is named, else of all that run here."""
    from ..deploy.client import networks, running_plan

    if options.network:
        yield declared(options.network, options.include)
        return
    for name in networks():
        plan = running_plan(name)
        if plan is not None:
            yield plan


def _told_by_launchers(
    plans: Sequence[Mapping[str, Any]],
) -> tuple[list[Launched], list[Complaints], list[str]]:
    """What those that run a network know of its processes, and why one could not be asked."""
    from ..deploy.client import Connection, NotRunning
    from ..errors import DeploymentError

    launched: list[Launched] = []
    complaints: list[Complaints] = []
    troubles = []
    for plan in plans:
        name = str(plan.get("name", ""))
        try:
            with Connection(name) as connection:
                processes = connection.status().processes
                launched += (_launched(name, each) for each in processes)
                complaints += _complaints(name, processes, connection)
        except NotRunning:
            continue  # it is given by its file
        except DeploymentError as exc:
            troubles.append(str(exc))
    return launched, complaints, troubles


def _launched(network: str, status: ProcessStatus) -> Launched:
    from ..deploy.policy import State
    from ..tools.doctor.facts import Launched

    wrong = status.state in (State.FAILED, State.HUNG, State.LOST, State.RESTARTING)
    return Launched(network, status.name, str(status.state), status.how, status.restarts, wrong)


def _complaints(network: str, processes: Iterable[ProcessStatus], connection: Connection) -> Iterator[Complaints]:
    """The errors of each instance since its process was started the last time."""
    from ..deploy.client import lines
    from ..deploy.ring import MOST_LINES
    from ..tools.doctor.facts import Complaints

    now = time.time()
    begun = {each.name: now - each.uptime for each in processes if each.uptime is not None}
    found: dict[tuple[str, str], list[str]] = {}
    for line in lines(connection, [], MOST_LINES, follow=False):
        if line.record and line.level in ("ERROR", "CRITICAL") and line.at >= begun.get(line.name, now):
            found.setdefault((line.name, line.record.instance or line.name), []).append(line.message)
    for (name, instance), texts in found.items():
        yield Complaints(network, name, instance, len(texts), texts[-1])


def _killed() -> Iterator[str]:
    """The networks whose launcher was killed, and left a note of what it had started."""
    from ..deploy.place import Place
    from ..transports.runtime_folder import runtime_dir

    for note in sorted(runtime_dir("deploy").glob("*/leftovers")):
        if Place(note.parent.name).runner() is None and note.exists():
            yield note.parent.name


def _shown(text: str) -> str:
    """In one line, without control characters: names come from other programs."""
    from ..printable import one_line

    return one_line(text)
