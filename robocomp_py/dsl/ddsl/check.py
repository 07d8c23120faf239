"""Model to diagnostics: what is wrong with a file, whatever the components it deploys.

What its network comes to is checked by `robocomp_py.deploy.plan`.
"""

from __future__ import annotations

from ..diagnostics import Report, did_you_mean
from ..numbers import whole
from ..source import Name
from . import model as m
from .order import start_order

_ONCE = ("path", "ip", "port", "config", "middleware", "namespace")

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
    for instance in model.instances:
        _check_variables(instance, report)
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


def _check_variables(instance: m.Instance, report: Report) -> None:
    seen: dict[str, m.Variable] = {}
    for each in instance.env:
        first = seen.setdefault(each.name.text, each)
        if first is not each:
            message = f"the variable `{each.name}` is given twice"
            report.error("duplicate", message, each.span, "", ("first here", first.span))
