"""Model to diagnostics: what is wrong with a file, whatever the components it deploys.

`robocomp_py.deploy.planner` checks the resulting network.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from ..cdsl.qos import read_qos
from ..diagnostics import Report, did_you_mean
from ..source import Name
from . import model as m
from .clauses import CLAUSES, clause_type
from .order import process_dependences, processes_of, start_order
from .scope import meanings, offered


def check(model: m.Deployment, report: Report) -> None:
    blocks: list[m.Deployment | m.Host | m.System | m.Instance] = [model, *model.hosts]
    for block in (*blocks, *model.systems, *model.instances):
        _check_once(block.clauses, report)
    _check_names(model, report)
    for check_clause in dict.fromkeys(each.check for each in CLAUSES):
        if check_clause:
            check_clause(model, report)
    _check_named(model, report)
    _check_dependences(model, report)
    _check_processes(model, report)
    for instance in model.instances:
        _check_qos(instance, report)


def _check_once(clauses: tuple[m.Clause, ...], report: Report) -> None:
    seen: dict[str, m.Clause] = {}
    for clause in clauses:
        first = seen.setdefault(clause.kind, clause)
        if first is not clause and not clause_type(clause.kind).many:
            report.error(
                "duplicate",
                f"`{clause.kind}` is given twice",
                clause.span,
                "remove one of them",
                ("first here", first.span),
            )


def _check_names(model: m.Deployment, report: Report) -> None:
    """Check that the full names of instances and systems are unique."""
    seen: dict[str, tuple[str, Name]] = {}
    named = [("system", each.name) for each in model.systems]
    named += [("instance", each.name) for each in model.instances]
    for what, name in sorted(named, key=lambda each: each[1].span.start):
        first, at = seen.setdefault(name.text, (what, name))
        if at is not name:
            message = (
                f"{what} `{name}` is defined twice" if what == first else f"`{name}` is the name of a {first}, too"
            )
            hint = "" if what == first else "rename one of them"
            report.error("duplicate", message, name.span, hint, ("first here", at.span))


def _check_named(model: m.Deployment, report: Report) -> None:
    """Check that instances that others wait for or use exist, unless a syntax error may have hidden them."""
    known = {instance.name.text: instance.name for instance in model.instances}
    offers = offered(model.instances)
    providers = {offer.name.text: offer.name for instance in model.instances for offer in instance.offers} | known
    written = {*known, *offers.values()}
    providers |= {alias: providers[name] for alias, name in offers.items()}
    owners = {offer.name.text: instance.name for instance in model.instances for offer in instance.offers}
    for instance in model.instances:
        used = [(name, known) for name in instance.dependences]
        for name, there in (*used, *((wiring.instance, providers) for wiring in instance.wirings)):
            if name.text in there:
                _check_meaning(instance, name, there, report)
            elif not model.skipped.intersection(name.text.split("/")):
                hint = did_you_mean(name.text, there) or _elsewhere(name.text, written & there.keys())
                if owner := owners.get(offers.get(name.text, "")):
                    hint = f"`{owner}` offers it: write `{owner}`"
                report.error("unknown-instance", f"unknown instance `{name}`", name.span, hint)


def _elsewhere(name: str, known: Iterable[str]) -> str:
    """A hint for a name that is missing here but exists in a system."""
    found = [each for each in known if each.endswith(f"/{name.rpartition('/')[2]}")]
    if len(found) == 1:
        return f"write `{found[0]}` instead"
    return f"write {' or '.join(f'`{each}`' for each in found[:3])}" if found else ""


def _check_meaning(instance: m.Instance, name: Name, known: Mapping[str, Name], report: Report) -> None:
    """Warn if a name could also be read as another instance than the one it resolves to."""
    meant, *others = meanings(name.span.text, instance.system, known) or [name.text]
    others = [each for each in others if known[each] is not known[meant]]
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
        report.error("dependence-cycle", f"`{waiting}` depends on itself through `{name}`", name.span)
    if closing:
        return  # the processes then have the same cycles
    _, closing = start_order(process_dependences(model))
    for waiting, name in closing:
        message = f"the process `{waiting}` depends on itself through `{name}`, which is ready when all in it are"
        report.error("dependence-cycle", message, name.span)


def _check_processes(model: m.Deployment, report: Report) -> None:
    """Check that instances in one process can share it."""
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
            message = f"the process `{name}` has the name of an instance that is not part of it"
            hint = f"rename it, or write in the block of `{name}`: process {name};"
            report.error("duplicate", message, name.span, hint, ("the instance", apart[name.text].span))
    for together in processes_of(model).values():
        _check_environment(together, report)
        _check_alike(model, together, report)


def _check_alike(model: m.Deployment, together: Sequence[m.Instance], report: Report) -> None:
    """Check that the instances of a process agree on the clauses that hold for all of it."""
    first, *others = together
    for each in others:
        for clause in CLAUSES:
            if clause.alike and clause.alike(model, first) != clause.alike(model, each):
                message = f"`{each.name}` and `{first.name}` share a process, which has one `{clause.name}`"
                hint = f"write the same `{clause.name}` for both, or give each a process"
                at, other = (getattr(one, clause.in_model) or one.name for one in (each, first))
                report.error("unshared-process", message, at.span, hint, ("the other one", other.span))


def _check_environment(together: Sequence[m.Instance], report: Report) -> None:
    """A process has one environment."""
    seen: dict[str, tuple[m.Instance, m.Variable]] = {}
    for instance in together:
        for each in instance.env:
            first, theirs = seen.setdefault(each.name.text, (instance, each))
            if first is not instance and theirs.value.text != each.value.text:
                message = f"`{each.name}` is something else for `{first.name}`, but a process has only one environment"
                report.error("env-clash", message, each.span, "", ("the other one", theirs.span))


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
