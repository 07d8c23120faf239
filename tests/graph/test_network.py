"""Pictures of networks: groups and links, and that links do not cross unrelated boxes."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from robocomp_py.contract.interface import Verb
from robocomp_py.deploy.auto import Way
from robocomp_py.deploy.plan import Host, Link, Plan
from robocomp_py.deploy.process import Member, Process
from robocomp_py.graph.layers import Arrow, Box, layered
from robocomp_py.graph.netsvg import draw
from robocomp_py.graph.nettext import dot, mermaid
from robocomp_py.graph.network import Around, Graph, Group, Node, graph_of

SVG = "{http://www.w3.org/2000/svg}"


def process(name: str, component: str = "", *members: str, host: str = "") -> Process:
    inside = tuple(Member(each, "arm") for each in members)
    system = tuple(name.split("/")[:-1])
    return Process(name, component or name.rpartition("/")[2], ("true",), Path("/"), members=inside, host=host,
                   system=system)  # fmt: skip


def uses(client: str, interface: str, provider: str, verb: Verb = Verb.REQUIRES, middleware: str = "zeromq"):  # type: ignore[no-untyped-def]
    way = Way(client, interface, provider, verb, f"RoboComp{interface}.{interface}", "get", middleware, "")
    return Link(interface, provider, client, verb), way


def plan(*processes: Process, used: tuple[tuple[Link, Way], ...] = (), hosts: tuple[Host, ...] = ()) -> Plan:
    return Plan("house", "auto", processes, tuple(link for link, _ in used), ways=tuple(way for _, way in used),
                hosts=hosts)  # fmt: skip


HOUSE = plan(
    process("world", "world2d", host="robot"),
    process("left/arms", "", "left/upper", "left/lower", host="robot"),
    process("left/eye", "camera", host="robot"),
    process("brain"),
    used=(
        uses("brain", "Laser", "world"),
        uses("brain", "Arm", "left/upper"),
        uses("brain", "ImagePub", "left/eye", Verb.SUBSCRIBES),
        uses("left/eye", "LaserPub", "world", Verb.SUBSCRIBES, "shm"),
        uses("left/upper", "Arm", "left/lower", middleware="inproc"),
    ),
    hosts=(Host("robot", "192.168.1.10"),),
)


def outline(group: Group) -> object:
    return [
        each.name if isinstance(each, Node) else {f"{each.kind} {each.title}": outline(each)} for each in group.inner
    ]


def test_instances_stand_in_their_process_in_its_systems_on_its_host() -> None:
    assert outline(graph_of(HOUSE).root) == [
        {
            "host robot (192.168.1.10)": [
                "world",
                {"system left": [{"process arms": ["left/upper", "left/lower"]}, "left/eye"]},
            ]
        },
        {"host this machine": ["brain"]},
    ]


def test_without_other_hosts_no_host_is_drawn() -> None:
    assert outline(graph_of(plan(process("a"), process("b"))).root) == ["a", "b"]


def test_arrows_lead_from_client_to_server_and_from_publisher_to_subscriber() -> None:
    said = {(each.source, each.target, each.topic, each.middleware, each.interfaces) for each in graph_of(HOUSE).edges}
    assert said == {
        ("brain", "world", False, "zeromq", ("Laser",)),
        ("brain", "left/upper", False, "zeromq", ("Arm",)),
        ("left/eye", "brain", True, "zeromq", ("ImagePub",)),
        ("world", "left/eye", True, "shm", ("LaserPub",)),
        ("left/upper", "left/lower", False, "inproc", ("Arm",)),
    }


def test_what_goes_the_same_way_between_two_is_one_arrow() -> None:
    used = (uses("a", "Laser", "b"), uses("a", "Base", "b"), uses("a", "Camera", "b", middleware="shm"))
    edges = graph_of(plan(process("a"), process("b"), used=used)).edges
    assert [(each.middleware, each.interfaces) for each in edges] == [
        ("zeromq", ("Laser", "Base")),
        ("shm", ("Camera",)),
    ]


# The picture.

Rectangle = tuple[float, float, float, float]


def boxes(root: ElementTree.Element) -> dict[str, Rectangle]:
    """Left, top, right, bottom of each instance."""
    found = {}
    for each in root.iter(f"{SVG}rect"):
        title = each.find(f"{SVG}title")
        if title is not None:
            x, y, width, height = (float(each.attrib[key]) for key in ("x", "y", "width", "height"))
            found[str(title.text)] = (x, y, x + width, y + height)
    return found


def points(path: str) -> list[tuple[float, float]]:
    """Points on a line, near to each other."""
    found: list[tuple[float, float]] = []
    for command, rest in re.findall(r"([MLC])([^MLC]+)", path):
        numbers = [float(number) for number in rest.split()]
        ends = list(zip(numbers[::2], numbers[1::2], strict=True))
        start = found[-1] if found else ends[0]
        for step in range(1, 21):
            t = step / 20
            if command == "C":
                parts = (start, *ends)
                weights = ((1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3)
                found.append(
                    (
                        sum(w * p[0] for w, p in zip(weights, parts, strict=True)),
                        sum(w * p[1] for w, p in zip(weights, parts, strict=True)),
                    )
                )
            else:
                found.append((start[0] + t * (ends[0][0] - start[0]), start[1] + t * (ends[0][1] - start[1])))
    return found


def crossed(graph: Graph) -> list[tuple[str, str]]:
    """Arrows that are drawn over an instance that is none of their ends, and over which."""
    root = ElementTree.fromstring(draw(graph))
    places = boxes(root)
    lines = [each for each in root.iter(f"{SVG}path") if each.find(f"{SVG}title") is not None]
    assert len(lines) == len(graph.edges)
    found = []
    for edge, line in zip(graph.edges, lines, strict=True):
        for name, (left, top, right, bottom) in places.items():
            inside = any(left + 2 < x < right - 2 and top + 2 < y < bottom - 2 for x, y in points(line.attrib["d"]))
            if inside:
                found.append((f"{edge.source} -> {edge.target}", name))
    return found


def test_every_instance_stands_in_the_picture_and_no_two_on_each_other() -> None:
    root = ElementTree.fromstring(draw(graph_of(HOUSE)))
    places = boxes(root)
    assert set(places) == {"world", "left/upper", "left/lower", "left/eye", "brain"}
    for (a, one), (b, other) in itertools.combinations(places.items(), 2):
        apart = one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]
        assert apart, (a, b)


def test_an_arrow_begins_and_ends_at_the_borders_of_its_instances() -> None:
    graph = graph_of(HOUSE)
    root = ElementTree.fromstring(draw(graph))
    places = boxes(root)
    lines = [each for each in root.iter(f"{SVG}path") if each.find(f"{SVG}title") is not None]
    for edge, line in zip(graph.edges, lines, strict=True):
        whole = points(line.attrib["d"])
        for name, (x, y) in ((edge.source, whole[0]), (edge.target, whole[-1])):
            left, top, right, bottom = places[name]
            assert left <= x <= right, (edge, name)
            assert min(abs(y - top), abs(y - bottom)) < 4, (edge, name)


@pytest.mark.parametrize("seed", range(8))
def test_no_arrow_is_drawn_over_an_instance_that_it_does_not_concern(seed: int) -> None:
    assert crossed(graph_of(HOUSE)) == []
    hosts = ("", "robot", "arm")
    names = [f"{system}{letter}" for letter, system in zip("abcdefghi", ("", "left/", "right/") * 3, strict=True)]
    processes = [process(name, host=hosts[(number * (seed + 1) // 2) % 3]) for number, name in enumerate(names)]
    used = tuple(
        uses(one, f"I{n}", other, Verb.SUBSCRIBES if n % 2 else Verb.REQUIRES)
        for n, (one, other) in enumerate(itertools.permutations(names, 2))
        if (n * 7919 + seed * 104729) % 31 < 4
    )
    assert used
    graph = graph_of(plan(*processes, used=used, hosts=(Host("robot", "10.0.0.1"), Host("arm", "10.0.0.2"))))
    assert crossed(graph) == []


def test_middlewares_have_colours_and_a_legend() -> None:
    said = draw(graph_of(HOUSE))
    for word in ("zeromq", "shm", "inproc", "calls", "topic", "host", "system", "process", "LaserPub"):
        assert f">{word}<" in said or f">{word}</tspan>" in said


def test_names_are_no_markup() -> None:
    root = Group(Around.NETWORK, "x", [Node('<a> & "b"', "</svg>")])
    assert boxes(ElementTree.fromstring(draw(Graph("<x>", root, ())))).keys() == {'<a> & "b"'}


def test_an_empty_network_is_an_empty_picture() -> None:
    assert not boxes(ElementTree.fromstring(draw(graph_of(plan()))))


# As text.


def test_for_graphviz_groups_are_clusters() -> None:
    said = dot(graph_of(HOUSE))
    assert 'subgraph cluster_1 {\n        label="host robot (192.168.1.10)";' in said
    assert '"left/upper" [label="upper\\narm"];' in said
    assert '"brain" -> "world" [label="Laser\\n(zeromq)"];' in said
    assert '"left/eye" -> "brain" [label="ImagePub\\n(zeromq)", style=dashed];' in said
    assert said.count("{") == said.count("}")


def test_for_mermaid_groups_are_subgraphs() -> None:
    said = mermaid(graph_of(HOUSE))
    assert 'subgraph g1["host robot (192.168.1.10)"]' in said
    assert '["upper<br/>arm"]' in said
    assert '-.->|"ImagePub<br/>(zeromq)"|' in said
    assert said.count("subgraph ") == len(re.findall(r"^ *end$", said, re.MULTILINE))


def test_quotes_in_names_are_escaped() -> None:
    root = Group(Around.NETWORK, "x", [Node('a"]; b', 'c"')])
    assert '"a\\"]; b" [label="a\\"]; b\\nc\\""];' in dot(Graph("x", root, ()))
    assert 'n0["a&quot;]; b<br/>c&quot;"]' in mermaid(Graph("x", root, ()))


def test_what_comes_last_is_below_all_others() -> None:
    boxes_ = {name: Box(10, 10) for name in ("a", "b", "c", "out")}
    layout = layered(boxes_, [Arrow("a", "b"), Arrow("b", "c"), Arrow("a", "out")], ["out"])
    assert layout.corners["out"][1] == layout.corners["c"][1] > layout.corners["b"][1]
