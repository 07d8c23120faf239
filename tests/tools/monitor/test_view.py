"""The picture of a running network."""

from __future__ import annotations

import re
from typing import Any
from xml.etree import ElementTree

import pytest

from robocomp_py.errors import ConfigurationError
from robocomp_py.graph.netsvg import draw
from robocomp_py.graph.network import Mark
from robocomp_py.tools.drift import compare, observed
from robocomp_py.tools.flows import Flow, Told
from robocomp_py.tools.lookout import Look
from robocomp_py.tools.measure import Load
from robocomp_py.tools.monitor.view import connections, picture, told
from robocomp_py.tools.network import Network

from ...graph.test_network import outline
from ..facts import DIVIDE, EYE, HAND, HEARD, NEWS, THERE, WORLD, end, plan

SPY = end("spy", "subscribes", "world/Everything/news", pid=8)
ALL = (WORLD, HAND, NEWS, EYE, *THERE)


def house(hosts: dict[str, str] | None = None) -> dict[str, Any]:
    """What `house` declares: `world` and `hand` in one process of the system `left`, and `eye`."""
    both = [{"name": name, "component": f"a_{name}"} for name in ("world", "hand")]
    at = (hosts or {}).get
    processes = [
        {"name": "left/pair", "component": "", "members": both, "system": ["left"], "instances": ["world", "hand"]},
        {"name": "eye", "component": "camera", "members": [], "system": [], "instances": ["eye"]},
    ]
    placed = [each | {"host": at(str(each["name"]), "")} for each in processes]
    addresses = [{"name": name, "address": "10.0.0.7"} for name in dict.fromkeys((hosts or {}).values())]
    return plan(DIVIDE, HEARD) | {"processes": placed, "hosts": addresses}


def look(*ends: Any, of: Any = None, flow: Flow | None = None, **more: Any) -> Look:
    drift = compare(of or house(), Network(ends))
    return Look(drift, more.pop("told", {}), more.pop("silent", frozenset()),
                dict.fromkeys(drift.uses, flow) if flow else {}, of or house())  # fmt: skip


def test_components_stand_in_their_processes_systems_and_hosts() -> None:
    spies = {"host this machine": [{"system left": [{"process pair": ["world", "hand"]}]}, "spy (process 8)"]}
    other = {"host robot (10.0.0.7)": ["eye"]}
    assert outline(picture(look(*ALL, SPY, of=house({"eye": "robot"}))).root) == [spies, other]


def test_what_is_missing_and_what_is_not_declared_is_marked() -> None:
    found = picture(look(WORLD, HAND, NEWS, SPY, *THERE[:2]))
    assert {each.name: each.mark for each in found.root.nodes()} == {
        "world": Mark.NONE,
        "hand": Mark.NONE,
        "eye": Mark.MISSING,
        "spy (process 8)": Mark.UNDECLARED,
    }
    assert {(each.source, each.target): (each.topic, each.mark) for each in found.edges} == {
        ("hand", "world"): (False, Mark.NONE),
        ("world", "eye"): (True, Mark.MISSING),
        ("world", "spy (process 8)"): (True, Mark.UNDECLARED),
    }


def test_marks_have_colours_lines_and_a_legend() -> None:
    drawn = draw(picture(look(WORLD, HAND, NEWS, SPY, *THERE[:2])))
    root = ElementTree.fromstring(drawn)
    texts = ["".join(each.itertext()) for each in root.iter() if each.tag.endswith("}text")]
    assert texts.count("missing") == 3  # in the box, at its arrow, in the legend
    assert {"not in the model", "spy (process 8)"} <= set(texts)
    assert 'class="topic missing"' in drawn
    assert "rect.undeclared { " in drawn


def test_an_arrow_has_rate_durations_and_what_went_wrong() -> None:
    (arrow, _) = picture(look(*ALL, flow=Flow(20.04, 0.00031, 0.0012, 3, 2, True))).edges
    assert arrow.figures == ("20/s · 0.31 / 1.20 ms", "3 failed, 2 lost")
    assert arrow.is_strained
    (quiet, _) = picture(look(*ALL)).edges
    assert quiet.figures == ("",)


def test_a_component_tells_its_state_and_one_that_does_not_answer_is_strained() -> None:
    load = Load("eye", "compute", "here", 3, 0.05, 40_000_000, 20.0, 0.05, 0, 0, 0)
    found = {each.name: each for each in picture(look(*ALL, told={"eye": Told(load)}, silent={"hand"})).root.nodes()}
    assert found["eye"].figures == ("process 3", "compute 20/s · 5% · 40 MB")
    assert found["hand"].figures == ("process 2", "does not answer")
    assert (found["hand"].is_strained, found["eye"].is_strained) == (True, False)


def test_a_topic_without_a_subscriber_leads_to_an_open_end() -> None:
    drift = compare(house() | {"ways": [DIVIDE]}, Network((WORLD, HAND, NEWS, *THERE)))
    shown = Look(drift, {}, frozenset(), dict.fromkeys(drift.unheard, Flow(20.04)), house())
    arrows = connections(shown)
    graph = picture(shown, arrows)
    (edge,) = (each for each in graph.edges if each.topic)
    assert (edge.source, edge.target, edge.figures) == ("world", "", ("20/s", "no subscriber"))
    drawn = draw(graph)
    assert drawn.count('<circle class="end"') == 1
    assert "<title>world publishes, without a subscriber: Everything, over near</title>" in drawn
    page = told(shown, graph, arrows)
    assert page["summary"] == "3 components, 1 connections, 1 topics without a subscriber"
    (row,) = (each for each in page["connections"] if each["kind"] == "topic")
    assert (row["name"], row["from"], row["to"], row["rate"]) == ("Everything/news", "world", "", "20")
    assert (row["state"], row["mark"], row["strained"]) == ("no subscriber", "", False)


def test_without_a_model_all_that_runs_is_shown_unmarked() -> None:
    found = picture(Look(observed(Network((*ALL, SPY))), {}, frozenset()))
    assert {each.name for each in found.root.nodes()} == {"world", "hand", "eye", "spy"}
    assert {(each.source, each.target) for each in found.edges} == {
        ("hand", "world"),
        ("world", "eye"),
        ("world", "spy"),
    }
    assert not any(each.mark for each in (*found.root.nodes(), *found.edges))


def test_the_form_of_a_picture_does_not_change_with_its_figures() -> None:
    def form(flow: Flow) -> list[str]:
        return re.findall(r' (?:x|y|d|width|height)="[^"]*"', draw(picture(look(*ALL, flow=flow))))

    assert form(Flow(1.0, 0.001, 0.001)) == form(Flow(1234.0, 0.12345, 1.2345))


def test_names_of_others_cannot_change_the_page() -> None:
    evil = end('</svg><script>"', "subscribes", "world/Everything/news", pid=8)
    assert "<script" not in draw(picture(look(*ALL, evil)))


def test_a_plan_of_another_version_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="is of another version"):
        picture(look(*ALL, of=plan(DIVIDE, HEARD)))
