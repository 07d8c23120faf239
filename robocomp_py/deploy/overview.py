"""A plan for people: processes, hosts, order and links, as lines of styled text."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

from ..runtime.notify import BETWEEN
from ..transports.deployment import deployment_of
from ..transports.network import Helper, named
from .changes import Change, Kind
from .plan import Host, Link, Plan
from .policy import Escalation, Restart, When
from .process import Member, Process
from .table import HERE, Line, Span

_GAP = "  "
_STYLES = {"instance": "cyan"}


def overview(plan: Plan) -> list[Line]:
    """The overview of a plan."""
    return [_title(plan), *map(_host, plan.hosts), *_helpers(plan), [], *_columns(_rows(plan))]


def difference(changes: Sequence[Change]) -> list[Line]:
    """The differences from the running network; empty if there are none."""
    lines: list[Line] = []
    for each in changes:
        match each.kind:
            case Kind.ADDED:
                lines.append([(f"+ {each.what}: {', '.join(each.added)}", "green")])
            case Kind.REMOVED:
                lines.append([(f"- {each.what}: {', '.join(each.removed)}", "red")])
            case Kind.CHANGED:
                lines.append([(f"~ {each.what or 'the network'}: {each.of}", "yellow")])
                lines += [[(f"    - {text}", "red")] for text in each.removed]
                lines += [[(f"    + {text}", "green")] for text in each.added]
    return lines


def command_line(process: Process, folder: Path) -> str:
    """A shell command that starts a process by hand, from `folder`, as the network starts it: with its environment.

    For a process on another host it shows the paths of this host.
    """
    words = list(process.command)
    if process.env:
        words = ["env", *(f"{name}={value}" for name, value in process.env.items()), *words]
    there = process.is_program and not process.host and process.cwd != folder
    change = f"cd {shlex.quote(str(process.cwd))} && " if there else ""
    where = f" (on {process.host})" if process.host else ""
    return f"{process.name}{where}: {change}{shlex.join(words)}"


def _title(plan: Plan) -> Line:
    number = sum(len(each.instances) for each in plan.processes)
    said = f": {number} {'component' if number == 1 else 'components'}"
    if number != len(plan.processes):
        said += f" in {len(plan.processes)} {'process' if len(plan.processes) == 1 else 'processes'}"
    if plan.carriers:
        said += f" over {', '.join(plan.carriers)}"
    escalation = plan.escalations.get((), Escalation.ONE_FOR_ONE)
    if escalation is not Escalation.ONE_FOR_ONE:
        said += f"; escalation {escalation}"
    if plan.clock:
        said += f"; clock of {plan.clock}"
    return [(plan.name, "bold"), (f"{said}; security {plan.security}", "")]


def _host(host: Host) -> Line:
    user = f"{host.user}@" if host.user else ""
    port = f":{host.port}" if host.port else ""
    where = f", in {host.workdir}" if host.workdir else ""
    keep = ", keeps running when the controller is lost" if host.keep else ""
    return [(f"host {host.name}", "bold"), (f": {user}{host.address}{port}, {host.python}{where}{keep}", "")]


def _helpers(plan: Plan) -> list[Line]:
    return [[(each.title, "bold"), (f": {said}", "")] for each in plan.helpers if (said := each.note or _helped(each))]


def _helped(helper: Helper) -> str:
    """Where a helper runs, and the addresses that it opens."""
    reached = [each.address for each in deployment_of(helper.middleware).reached(helper.options)]
    where = "on the host of its address" if helper.host is None else named(helper.host)
    return ", ".join((f"helper {where}", *dict.fromkeys(reached)))


def _rows(plan: Plan) -> list[list[list[Span]]]:
    """The lines of each cell, by row and column; empty columns are left out."""
    orders, uses = orders_of(plan.processes), _uses(plan)
    rows: list[dict[str, list[str]]] = [
        {
            "order": [str(orders[process.name])],
            "instance": [member.name],
            "component": [member.component],
            "process": [process.name] if process.members else [],
            "host": [process.host or HERE] if plan.hosts else [],
            "starts after": [", ".join(dict.fromkeys((*process.after, *process.ready_after)))],
            "restart": [_restart(process.restart)],
            "address": _addresses(process),
            "uses": uses.get(member.name, []),
        }
        for process in plan.processes
        for member in process.members or (Member(process.name, process.component),)
    ]
    kept = [title for title in (rows[0] if rows else ()) if any("".join(row[title]) for row in rows)]
    cells = ([[(text, _STYLES.get(title, "")) for text in row[title]] for title in kept] for row in rows)
    return [[[(title, "dim")] for title in kept], *cells]


def orders_of(processes: Iterable[Process]) -> dict[str, int]:
    """The position of each process in the start order, from 1; processes of one number start at the same time."""
    found: dict[str, int] = {}
    for process in processes:
        found[process.name] = 1 + max(
            (found.get(other, 0) for other in (*process.after, *process.ready_after)), default=0
        )
    return found


def _restart(restart: Restart) -> str:
    if restart.when is When.NEVER:
        return ""
    return f"{restart.when}, {restart.intensity} in {restart.period:g} s"


def _addresses(process: Process) -> list[str]:
    """The addresses at which its instances listen outside the run-time folder."""
    found: dict[tuple[int, str], str] = {}
    instance = 0
    for word in process.command:
        instance += word == BETWEEN
        key, _, value = word.partition("=")
        value = value.strip('"')
        _, middleware, *option = key.split(".") if key.startswith("transports.") else ("", "", "")
        if option in (["bind"], ["interface"]):
            found[instance, key] = value and f"{middleware} {value}"
        elif option[:1] == ["endpoints"]:
            served = option[-1].strip('"')
            found[instance, key] = f"{middleware} {served} {value}"
    return [said for said in found.values() if said]


def _uses(plan: Plan) -> dict[str, list[str]]:
    """The links of each client, with their middlewares."""
    ways: dict[Link, dict[str, None]] = {}
    for way in plan.ways:
        link = Link(way.interface.rpartition(".")[2], way.provider, way.client, way.verb, way.named)
        ways.setdefault(link, {})[way.middleware + (f" ({way.origin})" if way.origin else "")] = None
    found: dict[str, list[str]] = {}
    for each in plan.links:
        over = f" over {', '.join(ways[each])}" if each in ways else ""
        found.setdefault(each.client, []).append(f"{each.interface} of {each.source}{over}")
    return found


def _columns(rows: Sequence[Sequence[Sequence[Span]]]) -> list[Line]:
    """Rows of cells of several lines as lines."""
    widths = [max(len(text) for row in rows for text, _ in row[n] or [("", "")]) for n in range(len(rows[0]))]
    lines: list[Line] = []
    for row in rows:
        for number in range(max((1, *(len(cell) for cell in row)))):
            cells = [cell[number] if number < len(cell) else ("", "") for cell in row]
            line: Line = [(f"{text:<{width}}{_GAP}", style) for (text, style), width in zip(cells, widths, strict=True)]
            while line and not line[-1][0].strip():
                line.pop()
            if line:
                line[-1] = (line[-1][0].rstrip(), line[-1][1])
            lines.append(line)
    return lines
