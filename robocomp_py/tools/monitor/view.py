"""The picture of a running network: its instances and connections, beside what it declares. Pure."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...errors import ConfigurationError
from ...graph.network import Edge, Graph, Group, Mark, Node, Place, host_title, nested
from ..drift import Instance, Presence, Use
from ..flows import Flow, Told, answers_of, merged
from ..lookout import Look
from ..measure import Load, milliseconds
from ..network import Process

_MARKS = {Presence.MISSING: Mark.MISSING, Presence.UNDECLARED: Mark.UNDECLARED}


@dataclass(frozen=True)
class Connection:
    """An arrow: everything that two instances exchange in the same way."""

    edge: Edge
    flow: Flow
    uses: tuple[Use, ...]


def picture(look: Look, arrows: Sequence[Connection] | None = None) -> Graph:
    """The graph of a look; `arrows` are its connections if they are known already.

    Raises ConfigurationError if the plan of the network is of another version.
    """
    name = look.drift.network or "what runs here"
    found = connections(look) if arrows is None else arrows
    return Graph(name, nested(name, _places(look)), tuple(each.edge for each in found))


def connections(look: Look) -> list[Connection]:
    """In the order of the graph's arrows."""
    found: dict[tuple[Any, ...], list[Use]] = {}
    for use in (*look.drift.uses, *look.drift.unheard):
        ends = (use.provider, use.client) if use.is_topic else (use.client, use.provider)
        found.setdefault((*ends, use.is_topic, use.middleware, use.presence), []).append(use)
    prefixes = {each.name: each.prefix for each in look.drift.instances}
    return [_connection(key, uses, look, prefixes) for key, uses in found.items()]


def form(graph: Graph) -> Hashable:
    """What decides how a picture looks besides its figures: where they are of one form, only figures differ."""
    edges = tuple(replace(each, figures=("",) * len(each.figures), is_strained=False) for each in graph.edges)
    return edges, _outline(graph.root)


def told(look: Look, graph: Graph, arrows: Sequence[Connection]) -> dict[str, Any]:
    """What the page shows of a look besides the picture of its graph, as JSON."""
    nodes = list(graph.root.nodes())
    shapes: list[tuple[str, Node | Edge]] = [(f"node-{place}", each) for place, each in enumerate(nodes)]
    shapes += [(f"edge-{place}", each) for place, each in enumerate(graph.edges)]
    return {
        "name": graph.name,
        "at": look.at,
        "summary": _summary(look, nodes, arrows),
        "troubles": list(look.troubles),
        "texts": {f"{name}-{line}": text for name, each in shapes for line, text in enumerate(each.figures)},
        "strained": [name for name, each in shapes if each.is_strained],
        "components": _components(look, nodes),
        "connections": [row for number, each in enumerate(arrows) for row in _rows(number, each, look)],
    }


def number(value: float) -> str:
    """A rate for people, with three digits at most; "" if it is not known."""
    if math.isnan(value):
        return ""
    return f"{value:.1f}" if 0 < value < 9.95 else f"{value:.0f}"


def state_of(instance: Instance, answer: Told | None, silent: Iterable[str]) -> str:
    """What an instance does, in a few words."""
    if instance.presence is Presence.MISSING:
        return "missing"
    if answer is not None:
        return answer.now.state
    if instance.prefix in silent:
        return "does not answer"
    return "not visible from here" if instance.presence is Presence.UNSEEN else ""


def host_of(instance: Instance) -> str:
    """The name of its host in its network; "" for this host, or if that is not known."""
    return next((each.host for each in instance.processes), "")


def _connection(
    key: tuple[str, str, bool, str, Presence], uses: Sequence[Use], look: Look, prefixes: Mapping[str, str]
) -> Connection:
    source, target, is_topic, middleware, presence = key
    flow = merged([look.flows.get(use, Flow()) for use in uses])
    interfaces = tuple(dict.fromkeys(_interface(use, prefixes) for use in uses))
    mark = _MARKS.get(presence, Mark.NONE)
    lines = tuple(_flow_lines(flow, mark)) if target else (_rate(flow), _UNHEARD)
    edge = Edge(source, target, is_topic, middleware, interfaces, mark, lines, flow.is_strained)
    return Connection(edge, flow, tuple(uses))


def _flow_lines(flow: Flow, mark: Mark) -> Iterator[str]:
    p50, p99 = milliseconds(flow.p50), milliseconds(flow.p99)
    durations = f"{p50} / {p99} ms" if p50 else ""
    yield "missing" if mark is Mark.MISSING else " · ".join(filter(None, (_rate(flow), durations)))
    if flow.failed or flow.lost:
        counted = ((flow.failed, "failed"), (flow.lost, "lost"))
        yield ", ".join(f"{many} {what}" for many, what in counted if many)


def _rate(flow: Flow) -> str:
    rate = number(flow.rate)
    return rate and f"{rate}/s"


def _interface(use: Use, prefixes: Mapping[str, str]) -> str:
    """An interface; that of a named instance with its name."""
    prefix, interface, _ = use.channel.rsplit("/", 2)
    named = prefix.rpartition("/")[2]
    own = prefixes.get(use.provider, prefix)
    return interface if named == own.rpartition("/")[2] else f"{named}/{interface}"


def _places(look: Look) -> list[Place]:
    instances = {each.name: each for each in look.drift.instances}
    if look.plan is None:
        return _running(look, instances.values())
    try:
        declared = list(_declared(look, look.plan, instances))
    except (KeyError, TypeError, AttributeError) as exc:
        text = f"the plan of a network is of another version ({exc!r}); start the network again"
        raise ConfigurationError(text) from exc
    strangers = [each for each in instances.values() if each.presence is Presence.UNDECLARED]
    return declared + _running(look, strangers)


def _declared(look: Look, plan: Mapping[str, Any], instances: Mapping[str, Instance]) -> Iterator[Place]:
    addresses = _addresses(plan)
    for process in plan["processes"]:
        members = [(str(each["name"]), str(each["component"])) for each in process["members"]]
        name, host = str(process["name"]), str(process["host"])
        yield Place(
            tuple(
                _node(instances[one], component, look) for one, component in members or [(name, process["component"])]
            ),
            host_title(host, addresses.get(host, "")),
            tuple(map(str, process["system"])),
            name.rpartition("/")[2] if members else "",
        )


def _addresses(plan: Mapping[str, Any]) -> dict[str, str]:
    """Those of the hosts of a network, by name."""
    return {str(each["name"]): str(each["address"]) for each in plan["hosts"]}


def _running(look: Look, instances: Iterable[Instance]) -> list[Place]:
    """What is known of a place by the answers of components alone."""
    by_process: dict[tuple[Process, ...], list[Instance]] = {}
    for each in instances:
        by_process.setdefault(tuple(sorted(each.processes)), []).append(each)
    addresses = _addresses(look.plan) if look.plan is not None else {}
    places = []
    for processes, together in by_process.items():
        nodes = tuple(_node(each, _component_of(each, look), look) for each in together)
        title = f"{processes[0].pid}" if len(together) > 1 and processes else ""
        host = processes[0].host if processes else ""
        places.append(Place(nodes, host_title(host, addresses.get(host, "")), (), title))
    return places


def _component_of(instance: Instance, look: Look) -> str:
    answer = answers_of(instance, look.told)
    about = answer.about.component if answer and answer.about else ""
    return about or ("not in the model" if instance.presence is Presence.UNDECLARED else "")


def _node(instance: Instance, component: str, look: Look) -> Node:
    answer = answers_of(instance, look.told)
    state = state_of(instance, answer, look.silent)
    process = ", ".join(f"process {pid}" for pid in sorted(instance.pids)[:2])
    lines = (process, _load_line(state, answer.now) if answer else state)
    is_strained = state in ("does not answer", "emergency")
    return Node(instance.name, component, _MARKS.get(instance.presence, Mark.NONE), lines, is_strained)


def _load_line(state: str, now: Load) -> str:
    processor = "" if math.isnan(now.processor) else f"{now.processor:.0%}"
    memory = f"{now.memory / 1e6:.0f} MB" if now.memory else ""
    computes = f"{state} {number(now.computes)}/s" if now.computes > 0 else state
    return " · ".join(filter(None, (computes, processor, memory)))


def _summary(look: Look, nodes: Sequence[Node], arrows: Sequence[Connection]) -> str:
    strained = sum(each.is_strained for each in nodes) + sum(each.flow.is_strained for each in arrows)
    counted = (
        (sum(each.mark is Mark.MISSING for each in nodes), "components missing"),
        (sum(each.presence is Presence.MISSING for each in look.drift.uses), "connections missing"),
        (sum(each.mark is Mark.UNDECLARED for each in nodes), "components not in the model"),
        (sum(each.presence is Presence.UNDECLARED for each in look.drift.uses), "connections not in the model"),
        (len(look.drift.unheard), "topics without a subscriber"),
        (strained, "in trouble: silent, failing, losing, or near a deadline"),
    )
    parts = [f"{len(nodes)} components", f"{len(look.drift.uses)} connections"]
    parts += [f"{many} {what}" for many, what in counted if many]
    return ", ".join(parts) + ("" if look.plan is not None else "; no model to compare with")


def _components(look: Look, nodes: Sequence[Node]) -> list[dict[str, Any]]:
    instances = {each.name: each for each in look.drift.instances}
    answers = {name: answers_of(each, look.told) for name, each in instances.items()}
    declared = look.plan["processes"] if look.plan is not None else ()
    runs_in = {str(name): str(each["name"]) for each in declared for name in each["instances"]}
    rows = []
    for place, node in enumerate(nodes):
        instance, answer = instances[node.name], answers[node.name]
        now = answer.now if answer else None
        rows.append(
            {
                "id": node.name,
                "shape": f"node-{place}",
                "name": node.name,
                "runs_in": runs_in.get(node.name, ""),
                "kind": node.component,
                "mark": str(node.mark),
                "strained": node.is_strained,
                "state": state_of(instance, answer, look.silent) or _WORDS.get(node.mark, ""),
                "host": host_of(instance) or (now.host if now else ""),
                "process": ", ".join(map(str, sorted(instance.pids))),
                "computes": number(now.computes) if now else "",
                "processor": "" if now is None or math.isnan(now.processor) else f"{now.processor:.0%}",
                "memory": f"{now.memory / 1e6:.0f} MB" if now and now.memory else "",
                "queued": str(now.queued or "") if now else "",
                "overruns": str(now.overruns or "") if now else "",
            }
        )
    return rows


def _rows(place: int, connection: Connection, look: Look) -> Iterator[dict[str, Any]]:
    edge = connection.edge
    for use in connection.uses:
        flow = look.flows.get(use, Flow())
        yield {
            "id": f"{use.client} {use.provider} {use.channel} {use.middleware} {use.presence}",
            "shape": f"edge-{place}",
            "name": "/".join(use.channel.rsplit("/", 2)[1:]),
            "from": edge.source,
            "to": edge.target,
            "kind": "topic" if use.is_topic else "call",
            "over": use.middleware,
            "mark": str(edge.mark),
            "strained": flow.is_strained,
            "state": "in trouble" if flow.is_strained else _WORDS.get(edge.mark, "" if use.client else _UNHEARD),
            "rate": number(flow.rate),
            "p50": milliseconds(flow.p50),
            "p99": milliseconds(flow.p99),
            "failed": str(flow.failed or ""),
            "lost": str(flow.lost or ""),
        }


_UNHEARD = "no subscriber"

_WORDS = {Mark.MISSING: "missing", Mark.UNDECLARED: "not in the model"}


def _outline(group: Group) -> Hashable:
    return (
        group.kind,
        group.title,
        tuple(
            replace(each, figures=("",) * len(each.figures), is_strained=False)
            if isinstance(each, Node)
            else _outline(each)
            for each in group.inner
        ),
    )
