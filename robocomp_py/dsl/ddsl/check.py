"""Model to diagnostics: what is wrong with a file, whatever the components it deploys.

What its network comes to is checked by `robocomp_py.deploy.plan`.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..cdsl.qos import read_qos
from ..diagnostics import Report, did_you_mean
from ..numbers import whole
from ..source import Name
from . import model as m
from .order import process_dependences, processes_of, start_order

_ONCE = ("path", "ip", "port", "config", "middleware", "namespace", "process")

_HERE = ("localhost", "127.0.0.1", "::1")
"""How this machine is called."""

_MOST_PORTS = 65535


def check(model: m.Deployment, report: Report) -> None:
    for clauses in (model.clauses, *(instance.clauses for instance in model.instances)):
        _check_once(clauses, report)
    _check_instances(model, report)
    _check_ports(model, report)
    _check_named(model, report)
    _check_dependences(model, report)
    _check_processes(model, report)
    for instance in model.instances:
        _check_variables(instance, report)
        _check_qos(instance, report)
        here = instance.ip is not None and instance.ip.text in _HERE  # other hosts are the plan's to judge
        if instance.ip and here and not instance.port and "port" not in model.skipped:
            message = "`ip` has no effect without a `port`"
            report.warning("ineffective-ip", message, instance.ip.span, "add, for example, `port 10003;`")


def _check_once(clauses: tuple[m.Clause, ...], report: Report) -> None:
    seen: dict[str, m.Clause] = {}
    for clause in clauses:
        first = seen.setdefault(clause.kind, clause)
        if first is not clause and clause.kind in _ONCE:
            report.error("duplicate", f"`{clause.kind}` is given twice", clause.span, "", ("first here", first.span))


def _check_instances(model: m.Deployment, report: Report) -> None:
    seen: dict[str, Name] = {}
    for name in (instance.name for instance in model.instances):
        first = seen.setdefault(name.text, name)
        if first is not name:
            message = f"instance `{name}` is there twice"
            report.error("duplicate", message, name.span, "", ("first here", first.span))


def _check_ports(model: m.Deployment, report: Report) -> None:
    seen: dict[int, Name] = {}
    for port in (instance.port for instance in model.instances if instance.port):
        number = whole(port.text)
        if not 1 <= number <= _MOST_PORTS:
            report.error("bad-port", f"{number} is no port; allowed: 1 to {_MOST_PORTS}", port.span)
        first = seen.setdefault(number, port)
        if first is not port:
            report.error("port-clash", f"port {number} is taken", port.span, "", ("first here", first.span))


def _check_named(model: m.Deployment, report: Report) -> None:
    """Instances that others wait for or use are there, unless a syntax error may have hidden them."""
    known = [instance.name.text for instance in model.instances]
    for instance in model.instances:
        for name in (*instance.dependences, *(wiring.instance for wiring in instance.wirings)):
            if name.text not in known and name.text not in model.skipped:
                hint = did_you_mean(name.text, known)
                report.error("unknown-instance", f"unknown instance `{name}`", name.span, hint)


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
        if name and instance.path:
            message = f"`{instance.name}` is a program of your own, which is a process itself"
            report.error("unshared-process", message, name.span, "remove one of them", ("here", instance.path.span))
        if name and name.text in apart and name.text not in told:
            told.add(name.text)
            message = f"the process `{name}` is called like an instance that is not in it"
            hint = f"call it otherwise, or write in the block of `{name}`: process {name};"
            report.error("duplicate", message, name.span, hint, ("the instance", apart[name.text].span))
    for together in processes_of(model).values():
        _check_environment(together, report)


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
