"""Model to diagnostics: what is wrong with a file, whatever the components it deploys.

What its network comes to is checked by `robocomp_py.deploy.planner`.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from ipaddress import ip_address

from ...contract.component import MAX_SECONDS
from ..cdsl.model import Amount
from ..cdsl.qos import read_qos
from ..diagnostics import Report, did_you_mean
from ..numbers import whole as whole_number
from ..source import Name
from . import model as m
from .order import process_dependences, processes_of, start_order
from .restarts import read_restart
from .scope import HERE, host_of, meanings, restart_of

_MANY = ("dependences", "env", "args", "wiring", "qos")
"""What may be said several times."""

_MOST_PORTS = 65535


def check(model: m.Deployment, report: Report) -> None:
    blocks: list[m.Deployment | m.Host | m.System | m.Instance] = [model, *model.hosts]
    for block in (*blocks, *model.systems, *model.instances):
        _check_once(block.clauses, report)
    _check_names(model, report)
    _check_hosts(model, report)
    _check_restarts(model, report)
    _check_ports(model, report)
    _check_named(model, report)
    _check_dependences(model, report)
    _check_processes(model, report)
    for instance in model.instances:
        _check_program(instance, report)
        _check_variables(instance, report)
        _check_qos(instance, report)
        _check_place(model, instance, report)


def _check_once(clauses: tuple[m.Clause, ...], report: Report) -> None:
    seen: dict[str, m.Clause] = {}
    for clause in clauses:
        first = seen.setdefault(clause.kind, clause)
        if first is not clause and clause.kind not in _MANY:
            report.error("duplicate", f"`{clause.kind}` is given twice", clause.span, "", ("first here", first.span))


def _check_names(model: m.Deployment, report: Report) -> None:
    """Each instance, and each system, can be told from the others by its whole name."""
    seen: dict[str, tuple[str, Name]] = {}
    named = [("system", each.name) for each in model.systems]
    named += [("instance", each.name) for each in model.instances]
    for what, name in sorted(named, key=lambda each: each[1].span.start):
        first, at = seen.setdefault(name.text, (what, name))
        if at is not name:
            message = f"{what} `{name}` is there twice" if what == first else f"`{name}` is the name of a {first}, too"
            hint = "" if what == first else "call one of them otherwise"
            report.error("duplicate", message, name.span, hint, ("first here", at.span))


# Hosts.


def _check_hosts(model: m.Deployment, report: Report) -> None:
    names: dict[str, Name] = {}
    addresses: dict[tuple[str, str], m.Host] = {}
    for host in model.hosts:
        first = names.setdefault(host.name.text, host.name)
        if first is not host.name:
            message = f"host `{host.name}` is there twice"
            report.error("duplicate", message, host.name.span, "", ("first here", first.span))
        _check_host(model, host, report)
        if host.address:
            key = host.address.text.lower(), str(whole_or_none(host.port))
            other = addresses.setdefault(key, host)
            if other is not host and other.address:
                message = f"`{host.name}` and `{other.name}` are one machine: they have one address"
                hint = "write one `host` block, and name it wherever it is meant"
                report.error("host-clash", message, host.address.span, hint, ("the other one", other.address.span))
    known = list(names)
    for name in (*(each.host for each in model.systems), *(each.host for each in model.instances)):
        if name and name.text not in names and name.text not in model.skipped:
            hint = did_you_mean(name.text, known) or f'say where it is: host {name} {{ address "192.168.1.10"; }};'
            report.error("unknown-host", f"unknown host `{name}`", name.span, hint)


def whole_or_none(number: Name | None) -> int | None:
    return whole_number(number.text) if number else None


def _check_host(model: m.Deployment, host: m.Host, report: Report) -> None:
    if host.address is None:
        if "address" not in model.skipped:
            hint = 'add, for example: address "192.168.1.10";'
            report.error("bad-host", f"host `{host.name}` has no address", host.name.span, hint)
    elif not is_address(host.address.text):
        message = f"`{host.address}` is no address"
        report.error("bad-host", message, host.address.span, "write a number, as in 192.168.1.10, or a host's name")
    if host.user and not _USER.match(host.user.text):
        message = f"`{host.user}` is no user's name"
        hint = "letters, digits, `_`, `.` and `-`, and no `-` in front"
        report.error("bad-host", message, host.user.span, hint)
    if host.port:
        _check_port(host.port, report)
    if host.workdir and not _WORKDIR.match(host.workdir.text):
        message = f"`{host.workdir}` is no folder that is the same wherever it is asked for"
        report.error("bad-host", message, host.workdir.span, "write its whole path, which begins with `/`")
    if host.python and not _PROGRAM.match(host.python.text):
        message = f"`{host.python}` is no name or path of an interpreter"
        report.error("bad-host", message, host.python.span, 'as in: python "python3.12";')


def is_address(text: str) -> bool:
    """Whether a text is the number of a host, or may be its name."""
    try:
        ip_address(text)
    except ValueError:
        return len(text) < 254 and not _NUMBERS.match(text) and all(map(_LABEL.match, text.rstrip(".").split(".")))
    return True


_LABEL = re.compile(r"(?!-)[A-Za-z0-9_-]{1,63}(?<!-)\Z")
_NUMBERS = re.compile(r"[0-9.]*\Z")
_USER = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}\Z")
_WORKDIR = re.compile(r"/(?:(?!\.\.(?:/|\Z))[^/\x00-\x1f\x7f]*(?:/|\Z))*\Z")
_PROGRAM = re.compile(r"[A-Za-z0-9_/][A-Za-z0-9_./+-]*\Z")


def _check_place(model: m.Deployment, instance: m.Instance, report: Report) -> None:
    ip = instance.ip
    if ip and instance.host:
        message = "`ip` and `host` both say where it runs"
        report.error("duplicate", message, ip.span, "remove the `ip`", ("the host is here", instance.host.span))
    elif ip and not is_address(ip.text):
        report.error("bad-host", f"`{ip}` is no address", ip.span, "write localhost, a number, or a host's name")
    elif ip and ip.text in HERE and not instance.port and "port" not in model.skipped:
        said = host_of(model, _without_ip(instance))
        if said is None:  # else it says that this one runs here
            message = "`ip` has no effect without a `port`"
            report.warning("ineffective-ip", message, ip.span, "add, for example, `port 10003;`")


def _without_ip(instance: m.Instance) -> m.Instance:
    return replace(instance, ip=None)


# What is started, and started again.


def _check_program(instance: m.Instance, report: Report) -> None:
    command = instance.existing
    if command is None:
        return
    if instance.path:
        message = "`existing` and `path` both say what is run"
        related = "the path is here", instance.path.span
        report.error("duplicate", message, command.span, "remove one of them", related)
    try:
        words = shlex.split(command.text)
    except ValueError as exc:
        message = f"`{command}` cannot be split into words: {str(exc).lower()}"
        report.error("bad-command", message, command.span, "a word with spaces stands in single quotes")
        return
    if not words:
        report.error("bad-command", "there is no command", command.span, 'as in: existing "urg_node --frame base";')
    elif found := _shell_syntax(command.text):
        message = f"`{found}` is for a shell, but none reads this: it would be given to the program"
        hint = "put it into single quotes if that is meant; else write a script, and name it here"
        report.error("bad-command", message, command.span, hint)


def _shell_syntax(command: str) -> str:
    """What only a shell would understand, outside of quotes; "" if there is nothing."""
    found = _FOR_SHELLS.search(_QUOTED.sub("_", command))
    return found[0] if found else ""


_QUOTED = re.compile(r"'[^']*'|\\.")
_FOR_SHELLS = re.compile(r"[|&;<>()]+|`|\*|\?|\$[\w{(]\w*|(?<!\S)~")


def _check_restarts(model: m.Deployment, report: Report) -> None:
    said = (*(each.restart for each in model.systems), *(each.restart for each in model.instances))
    for each in (model.restart, *said):
        if each:
            read_restart(each, report)
    scopes: list[m.Deployment | m.System] = [model, *model.systems]
    for scope in scopes:
        prefix = f"{scope.name}/" if isinstance(scope, m.System) else ""
        within = [each for each in model.instances if each.name.text.startswith(prefix)]
        policies = [restart_of(model, each) for each in within]
        restarted = any(each and each.policy.text != "never" for each in policies)
        escalation = scope.escalation
        if escalation and escalation.text != "one_for_one" and not restarted and "restart" not in model.skipped:
            message = f"`{escalation}` has no effect: nothing is started again here"
            report.warning("ineffective-escalation", message, escalation.span, "add, for example: restart on_failure;")
    for instance in model.instances:
        if (grace := instance.grace) and not (0 <= _seconds(grace, -1) <= MAX_SECONDS):
            message = f"`grace` is a time, 0 to {MAX_SECONDS:.0f} s"
            report.error("bad-restart", message, grace.span, "as in: grace 10;")


def _seconds(amount: Amount, otherwise: float) -> float:
    """Without a unit they are seconds."""
    seconds = amount.seconds if amount.unit else amount.number
    return otherwise if seconds is None else seconds


def _check_ports(model: m.Deployment, report: Report) -> None:
    seen: dict[tuple[str, int], Name] = {}
    for instance in model.instances:
        port, host = instance.port, host_of(model, instance)
        if port is None:
            continue
        number = _check_port(port, report)
        where = "" if host is None or host.text in HERE else host.text
        first = seen.setdefault((where, number), port)
        if first is not port:
            report.error("port-clash", f"port {number} is taken", port.span, "", ("first here", first.span))


def _check_port(port: Name, report: Report) -> int:
    number = whole_number(port.text)
    if not 1 <= number <= _MOST_PORTS:
        report.error("bad-port", f"{number} is no port; allowed: 1 to {_MOST_PORTS}", port.span)
    return number


def _check_named(model: m.Deployment, report: Report) -> None:
    """Instances that others wait for or use are there, unless a syntax error may have hidden them."""
    known = {instance.name.text: instance.name for instance in model.instances}
    for instance in model.instances:
        for name in (*instance.dependences, *(wiring.instance for wiring in instance.wirings)):
            if name.text in known:
                _check_meaning(instance, name, known, report)
            elif not model.skipped.intersection(name.text.split("/")):
                hint = did_you_mean(name.text, known) or _elsewhere(name.text, known)
                report.error("unknown-instance", f"unknown instance `{name}`", name.span, hint)


def _elsewhere(name: str, known: Iterable[str]) -> str:
    """How to say whom a name may mean that is one in a system."""
    found = [each for each in known if each.endswith(f"/{name.rpartition('/')[2]}")]
    if len(found) == 1:
        return f"write `{found[0]}` instead"
    return f"write {' or '.join(f'`{each}`' for each in found[:3])}" if found else ""


def _check_meaning(instance: m.Instance, name: Name, known: Mapping[str, Name], report: Report) -> None:
    """Nobody takes a name for another instance than the one that is meant."""
    meant, *others = meanings(name.span.text, instance.system, known) or [name.text]
    if others:
        message = f"`{name.span.text}` is `{meant}` here, and not `{others[0]}`"
        whole = meant if meant in meanings(meant, instance.system, known)[:1] else f"/{meant}"
        hint = f"write `{whole}` for it, or `/{others[0]}` for the other one"
        related = "the other one", known[others[0]].span
        report.warning("shadowed-name", message, name.span, hint, related)


def _check_dependences(model: m.Deployment, report: Report) -> None:
    waits_for: dict[str, tuple[Name, ...]] = {}
    for instance in model.instances:
        waits_for.setdefault(instance.name.text, instance.dependences)
    _, closing = start_order(waits_for)
    for waiting, name in closing:
        report.error("dependence-cycle", f"`{waiting}` depends on itself, by way of `{name}`", name.span)
    if closing:
        return  # the processes then have the same cycles
    _, closing = start_order(process_dependences(model))
    for waiting, name in closing:
        message = f"the process `{waiting}` depends on itself, by way of `{name}`, which is ready when all in it are"
        report.error("dependence-cycle", message, name.span)


def _check_processes(model: m.Deployment, report: Report) -> None:
    """Those that share a process can do so."""
    apart = {each.name.text: each.name for each in model.instances if each.process is None}
    told: set[str] = set()
    for instance in model.instances:
        name = instance.process
        program = instance.program
        if name and program:
            message = f"`{instance.name}` is a program of your own, which is a process itself"
            report.error("unshared-process", message, name.span, "remove one of them", ("here", program.span))
        if name and name.text in apart and name.text not in told:
            told.add(name.text)
            message = f"the process `{name}` is called like an instance that is not in it"
            hint = f"call it otherwise, or write in the block of `{name}`: process {name};"
            report.error("duplicate", message, name.span, hint, ("the instance", apart[name.text].span))
    for together in processes_of(model).values():
        _check_environment(together, report)
        _check_alike(model, together, report)


def _check_alike(model: m.Deployment, together: Sequence[m.Instance], report: Report) -> None:
    """A process runs in one place, and is started again as a whole."""
    first, *others = together
    for each in others:
        here, there = _place(model, first), _place(model, each)
        if here != there:
            where = f"on {there or 'this host'}, `{first.name}` on {here or 'this host'}"
            message = f"`{each.name}` runs {where}, but they share a process"
            at = each.host or each.process or each.name
            report.error(
                "unshared-process", message, at.span, "give each host a process", ("the other one", first.name.span)
            )
        ours, theirs = restart_of(model, first), restart_of(model, each)
        if _meaning(ours) != _meaning(theirs):
            message = f"`{each.name}` and `{first.name}` share a process, which is started again as a whole"
            at_span = each.restart.span if each.restart else each.name.span
            other = first.restart.span if first.restart else first.name.span
            report.error("unshared-process", message, at_span, "say one `restart` for both", ("the other one", other))


def _place(model: m.Deployment, instance: m.Instance) -> str:
    """On which host it runs, as its file calls it; "" for the one that launches the network."""
    said = host_of(model, instance)
    if said is None or said.text in HERE:
        return ""
    return f"`{said}`"


def _meaning(restart: m.Restart | None) -> tuple[str, dict[str, float]]:
    return (restart.policy.text, read_restart(restart, Report())) if restart else ("never", {})


def _check_environment(together: Sequence[m.Instance], report: Report) -> None:
    """A process has one environment."""
    seen: dict[str, tuple[m.Instance, m.Variable]] = {}
    for instance in together:
        for each in instance.env:
            first, theirs = seen.setdefault(each.name.text, (instance, each))
            if first is not instance and theirs.value.text != each.value.text:
                message = f"`{each.name}` is something else for `{first.name}`, but a process has one environment"
                report.error("env-clash", message, each.span, "", ("the other one", theirs.span))


def _check_variables(instance: m.Instance, report: Report) -> None:
    seen: dict[str, m.Variable] = {}
    for each in instance.env:
        first = seen.setdefault(each.name.text, each)
        if first is not each:
            message = f"the variable `{each.name}` is given twice"
            report.error("duplicate", message, each.span, "", ("first here", first.span))


def _check_qos(instance: m.Instance, report: Report) -> None:
    seen: dict[str, dict[str, m.Quality]] = {}
    for each in instance.qos:
        read_qos(each.settings, report)
        verb, said = each.verb.text if each.verb else "", seen.setdefault(each.port.text, {})
        first = said.get(verb) or said.get("") if verb else next(iter(said.values()), None)
        said.setdefault(verb, each)
        if first:
            message = f"`qos` of `{each.port}` is given twice"
            report.error("duplicate", message, each.span, "", ("first here", first.span))
