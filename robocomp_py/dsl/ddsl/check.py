"""Model to diagnostics: what is wrong with a file, whatever the components it deploys.

What its network comes to is checked by `robocomp_py.deploy.plan`.
"""

from __future__ import annotations

from ..diagnostics import Report
from . import model as m

_ONCE = ("path", "ip", "port", "config", "middleware", "namespace")

_HERE = ("localhost", "127.0.0.1", "::1")
"""How this machine is called."""


def check(model: m.Deployment, report: Report) -> None:
    for clauses in (model.clauses, *(instance.clauses for instance in model.instances)):
        _check_once(clauses, report)
    for instance in model.instances:
        _check_variables(instance, report)
        here = instance.ip is not None and instance.ip.text in _HERE  # other hosts are the plan's to judge
        if instance.ip and here and not instance.port and "port" not in model.skipped:
            message = "`ip` has no effect without a `port`"
            report.warning("ineffective-ip", message, instance.ip.span, "add, for example, `port 10003;`")


def _check_variables(instance: m.Instance, report: Report) -> None:
    seen: dict[str, m.Variable] = {}
    for each in instance.env:
        first = seen.setdefault(each.name.text, each)
        if first is not each:
            message = f"the variable `{each.name}` is given twice"
            report.error("duplicate", message, each.span, "", ("first here", first.span))


def _check_once(clauses: tuple[m.Clause, ...], report: Report) -> None:
    seen: dict[str, m.Clause] = {}
    for clause in clauses:
        first = seen.setdefault(clause.kind, clause)
        if first is not clause and clause.kind in _ONCE:
            report.error("duplicate", f"`{clause.kind}` is given twice", clause.span, "", ("first here", first.span))
