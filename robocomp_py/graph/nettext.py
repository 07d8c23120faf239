"""Networks as text for other programs: Graphviz's DOT, Mermaid, and JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from ..printable import spaced
from .network import Edge, Graph, Group, Node


def dot(graph: Graph) -> str:
    lines = [
        f"digraph {_quoted(graph.name)} {{",
        '    node [shape=box, style="rounded,filled", fillcolor="#e9f1fa", fontname="sans-serif"];',
        '    edge [fontname="sans-serif", fontsize=10];',
        *_dot_group(graph.root, "    ", [0]),
        *(f"    {_dot_edge(edge)}" for edge in graph.edges),
        "}",
    ]
    return "\n".join(lines) + "\n"


def as_json(graph: Graph) -> str:
    """One object: the network, its components with what is around each, and the links between them."""
    links = [
        {
            "from": each.source,
            "to": each.target,
            "kind": "topic" if each.topic else "call",
            "over": each.middleware,
            "interfaces": each.interfaces,
            **_told(each),
        }
        for each in graph.edges
    ]
    return json.dumps({"network": graph.name, "components": list(_listed(graph.root, [])), "links": links}) + "\n"


def _listed(group: Group, around: list[dict[str, str]]) -> Iterator[dict[str, Any]]:
    for each in group.inner:
        if isinstance(each, Node):
            yield {"name": each.name, "component": each.component, "within": around, **_told(each)}
        else:
            yield from _listed(each, [*around, {"kind": str(each.kind), "name": each.title}])


def _told(each: Node | Edge) -> dict[str, Any]:
    return {"mark": str(each.mark), "strained": each.is_strained, "figures": each.figures}


def _dot_group(group: Group, indent: str, count: list[int]) -> Iterator[str]:
    for each in group.inner:
        if isinstance(each, Node):
            yield f"{indent}{_quoted(each.name)} [label={_quoted(_node_text(each))}];"
            continue
        count[0] += 1
        yield f"{indent}subgraph cluster_{count[0]} {{"
        yield f"{indent}    label={_quoted(f'{each.kind} {each.title}')};"
        yield from _dot_group(each, f"{indent}    ", count)
        yield f"{indent}}}"


def _dot_edge(edge: Edge) -> str:
    style = ", style=dashed" if edge.topic else ""
    return f"{_quoted(edge.source)} -> {_quoted(edge.target)} [label={_quoted(_edge_text(edge))}{style}];"


def mermaid(graph: Graph) -> str:
    ids = {node.name: f"n{number}" for number, node in enumerate(graph.root.nodes())}
    lines = [
        "flowchart TB",
        *_mermaid_group(graph.root, "    ", ids, [0]),
        *(f"    {_mermaid_edge(edge, ids)}" for edge in graph.edges),
    ]
    return "\n".join(lines) + "\n"


def _mermaid_group(group: Group, indent: str, ids: dict[str, str], count: list[int]) -> Iterator[str]:
    for each in group.inner:
        if isinstance(each, Node):
            yield f'{indent}{ids[each.name]}["{_shown(_node_text(each))}"]'
            continue
        count[0] += 1
        yield f'{indent}subgraph g{count[0]}["{_shown(f"{each.kind} {each.title}")}"]'
        yield from _mermaid_group(each, f"{indent}    ", ids, count)
        yield f"{indent}end"


def _mermaid_edge(edge: Edge, ids: dict[str, str]) -> str:
    arrow = "-.->" if edge.topic else "-->"
    return f'{ids[edge.source]} {arrow}|"{_shown(_edge_text(edge))}"| {ids[edge.target]}'


def _node_text(node: Node) -> str:
    return node.short if node.component.lower() == node.short.lower() else f"{node.short}\n{node.component}"


def _edge_text(edge: Edge) -> str:
    return "\n".join([*edge.interfaces, *([f"({edge.middleware})"] if edge.middleware else [])])


def _quoted(text: str) -> str:
    return json.dumps(spaced(text), ensure_ascii=False)


def _shown(text: str) -> str:
    """For Mermaid, whose quotes cannot be escaped but by an entity."""
    return spaced(text).replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;").replace("\n", "<br/>")
