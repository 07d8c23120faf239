"""`allow wander/GotoPoint/go, speech/Speech;`: what an agent may do through `rc mcp`.

A path names an instance, an interface as `rc list` shows it, and an operation: a query or command that the instance
serves, an action, or a topic that it subscribes to. Without an operation it stands for all of the interface except
those that are marked `[confirm]`. In the block of a component it begins with the interface.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ...contract.component import Component, Port
from ...contract.interface import Action, Operation, Verb
from ..diagnostics import Report, did_you_mean
from ..source import Name
from . import model as m
from .scope import offered


@dataclass(frozen=True, slots=True)
class Path:
    """A path of an `allow`, in its parts."""

    instance: m.Instance
    lead: Name | None
    """The whole name of the instance, or of a named instance, where the path names it; None in its own block."""
    named: str
    """The named instance, in its system; "" if the instance itself is meant."""
    port: Name
    operation: Name | None


def check_allow(model: m.Deployment, report: Report) -> None:
    """Check that paths name instances, and each operation once."""
    seen: dict[tuple[str, ...], Name] = {}
    for block, written in _written(model):
        path = split(model, block, written)
        if path is None:
            _tell_unknown(model, block, written, report)
            continue
        called = (path.instance.name.text, path.named, path.port.text, path.operation.text if path.operation else "")
        if (first := seen.setdefault(called, written)) is not written:
            report.error("duplicate", f"`{written}` is allowed twice", written.span, "", ("first here", first.span))


def read_allow(model: m.Deployment, components: Mapping[str, Component], report: Report) -> list[dict[str, str]]:
    """The operations that are allowed, as JSON has them: `instance`, `named`, `interface`, `operation`, `kind`.

    What a component neither serves nor subscribes to is an error. `components` are those of the instances, by name.
    """
    found: dict[tuple[str, ...], dict[str, str]] = {}
    for block, written in _written(model):
        path = split(model, block, written)
        component = components.get(path.instance.name.text) if path else None
        if path is None or component is None or (port := _port(path, component, report)) is None:
            continue
        for operation, kind in _operations(path, port, report):
            told = (path.instance.name.text, path.named, component.segment(port), operation)
            found[told] = dict(zip(("instance", "named", "interface", "operation", "kind"), (*told, kind), strict=True))
    return list(found.values())


def split(model: m.Deployment, block: m.Deployment | m.Instance, written: Name) -> Path | None:
    """The parts of a path that stands in a block; None if it names no instance, or is too long."""
    parts = _parts(written)
    if isinstance(block, m.Instance):
        return Path(block, None, "", parts[0], parts[1] if len(parts) > 1 else None) if len(parts) <= 2 else None
    instances = {each.name.text: each for each in model.instances}
    offers = offered(model.instances)
    owners = {offer.name.text: each for each in model.instances for offer in each.offers}
    for behind in (1, 2):
        if behind >= len(parts):
            break
        lead = "/".join(each.text for each in parts[:-behind])
        port, operation = parts[-behind], parts[-1] if behind == 2 else None
        at = Name(offers.get(lead, lead), written.span.source.span(written.span.start, parts[-behind - 1].span.end))
        if lead in instances:
            return Path(instances[lead], at, "", port, operation)
        if at.text in owners:
            return Path(owners[at.text], at, at.text.rpartition("/")[2], port, operation)
    return None


def _written(model: m.Deployment) -> Iterator[tuple[m.Deployment | m.Instance, Name]]:
    """Each path with the block that it stands in."""
    blocks: list[m.Deployment | m.Instance] = [model, *model.instances]
    return ((block, path) for block in blocks for path in block.allow)


def _parts(written: Name) -> list[Name]:
    source, start = written.span.source, written.span.start
    found = re.finditer(r"\w+", written.span.text)
    return [Name(each[0], source.span(start + each.start(), start + each.end())) for each in found]


def _tell_unknown(model: m.Deployment, block: m.Deployment | m.Instance, written: Name, report: Report) -> None:
    parts = [each.text for each in _parts(written)]
    if model.skipped.intersection(parts):
        return
    if isinstance(block, m.Instance):
        message = f"`{written}` has more parts than an interface and its operation"
        report.error("unknown-operation", message, written.span, "as in: allow GotoPoint/go;")
        return
    known = {*(each.name.text for each in model.instances), *offered(model.instances)}
    lead = "/".join(parts[:-2] or parts[:-1])
    hint = did_you_mean(lead, known) if lead else ""
    if not hint:
        example = next(iter(known), "wander")
        hint = f"write the instance, the interface and the operation, as in: {example}/{'/'.join(parts[-2:])}"
    message = f"unknown instance `{lead}`" if lead else f"`{written}` names no instance"
    report.error("unknown-instance", message, written.span, hint)


def _port(path: Path, component: Component, report: Report) -> Port | None:
    """The port that a path names, if the component serves it, or subscribes to it."""
    name = path.port.text
    ports = [each for each in component.ports if component.segment(each) == name]
    usable = [each for each in ports if each.verb is Verb.IMPLEMENTS]
    usable += [each for each in ports if each.verb is Verb.SUBSCRIBES]
    lead = path.lead or component.name
    if found := next((each for each in usable if each.each == bool(path.named)), None):
        return found
    if usable:
        offers = [each.local for each in path.instance.offers] or ["front"]
        message = (
            f"`{path.instance.name}` serves `{name}` by {'its own name' if path.named else 'named instances'} only"
        )
        hint = f"write {path.instance.name if path.named else offers[0]}/{name}"
        report.error("wrong-allow", message, path.port.span, hint)
    elif ports:
        topic = ports[0].verb.is_topic
        message = f"`{lead}` {ports[0].verb} `{name}`, it neither serves it nor subscribes to it"
        hint = "remove it: topics are read without being allowed" if topic else "name the instance that implements it"
        report.error("wrong-allow", message, path.port.span, hint)
    else:
        others = [
            component.segment(each)
            for each in component.ports
            if each.verb in (Verb.IMPLEMENTS, Verb.SUBSCRIBES) and each.each == bool(path.named)
        ]
        hint = did_you_mean(name, others) or (f"there are {', '.join(others)}" if others else "there is none")
        message = f"`{lead}` neither serves an interface `{name}` nor subscribes to one"
        report.error("unknown-port", message, path.port.span, hint)
    return None


def _operations(path: Path, port: Port, report: Report) -> Iterator[tuple[str, str]]:
    """The names and kinds of the operations that a path means."""
    kind = "publication" if port.verb.is_topic else "call"
    operations = [each for each, _ in port.interface.under(port.verb)]
    known: dict[str, Operation[Any] | Action] = {each.name: each for each in operations}
    known |= {each.name: each for each in port.interface.actions_under(port.verb)}
    interface = port.interface.short
    if path.operation is None:
        wanted = [each.name for each in known.values() if not each.confirm]
        if not wanted:
            message = f"`{interface}` has no operation without `[confirm]`"
            listed = ", ".join(f"{interface}/{each}" for each in known)
            report.error("wrong-allow", message, path.port.span, f"name each: {listed}" if listed else "remove it")
    elif path.operation.text in known:
        wanted = [path.operation.text]
    else:
        name, wanted = path.operation.text, []
        hint = did_you_mean(name, known) or (f"it has {', '.join(known)}" if known else "it has none")
        report.error("unknown-operation", f"`{interface}` has no operation `{name}`", path.operation.span, hint)
    for each in wanted:
        yield each, "goal" if isinstance(known[each], Action) else kind
