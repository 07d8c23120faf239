"""What pictures of state machines show, and that it can be told apart."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings

from robocomp_py.contract.statemachine import State, StateMachine, Transition
from robocomp_py.graph.layers import Arrow, Box, layered
from robocomp_py.graph.statemachine import draw
from tests.hostile import NASTY

from ..runtime.test_statechart import PATROL, machines

SVG = "{http://www.w3.org/2000/svg}"
Rectangle = tuple[float, float, float, float]


class Picture:
    """What can be read back from a picture."""

    def __init__(self, machine: StateMachine) -> None:
        self.root = ElementTree.fromstring(draw(machine))
        self.texts = [each.text for each in self.root.iter(f"{SVG}text")]
        self.arrows = [each for each in self.root.iter(f"{SVG}path") if each.get("marker-end")]
        self.fired = sorted(title.text or "" for each in self.arrows for title in each)
        self.dashed = [each for each in self.root.iter(f"{SVG}path") if each.get("class") == "region"]
        self.boxes: dict[str, Rectangle] = {}
        last: Rectangle = (0, 0, 0, 0)
        for each in self.root:
            if each.tag == f"{SVG}rect" and each.get("class") in (None, "around") and each.get("x"):
                last = rectangle(each)
            elif each.tag == f"{SVG}text" and each.get("class") in (None, "title"):
                self.boxes[each.text or ""] = last


def rectangle(element: ElementTree.Element) -> Rectangle:
    x, y, width, height = (float(element.get(key, 0)) for key in ("x", "y", "width", "height"))
    return x, y, x + width, y + height


def inside(one: Rectangle, other: Rectangle) -> bool:
    return other[0] < one[0] and other[1] < one[1] and one[2] < other[2] and one[3] < other[3]


def apart(one: Rectangle, other: Rectangle) -> bool:
    return one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]


def test_every_state_is_a_box_with_its_name() -> None:
    assert list(Picture(PATROL).boxes) == [state.name for state in PATROL.every_state()]


@pytest.mark.parametrize("text", NASTY)
def test_a_text_is_a_text(text: str) -> None:
    inner, other = State(f"inner{text}"), State(f"other{text}")
    outer = State(f"outer{text}", (inner,), inner.name)
    machine = StateMachine(text, (outer, other), outer.name, (Transition(outer.name, other.name, (text,)),))
    plain = StateMachine("x", (State("outer", (State("inner"),), "inner"), State("other")), "outer",
                         (Transition("outer", "other", ("go",)),))  # fmt: skip
    assert tags(machine) == tags(plain)


def tags(machine: StateMachine) -> set[tuple[str, tuple[str, ...]]]:
    return {(each.tag, tuple(each.attrib)) for each in ElementTree.fromstring(draw(machine)).iter()}


def test_arrows_tell_what_has_them_taken_and_what_fires_them() -> None:
    found = Picture(PATROL)
    assert {"go", "stop, turn, error.*", "t_driving_to_arrived"} <= set(found.texts)
    assert found.fired == sorted(PATROL.triggers())


def test_an_arrow_leads_from_a_mark_to_every_initial_state() -> None:
    found = Picture(PATROL)
    assert len(list(found.root.iter(f"{SVG}circle"))) == 3
    assert len(found.arrows) == len(PATROL.triggers()) + 3


def test_dashed_lines_stand_between_regions() -> None:
    found = Picture(PATROL)
    [line] = found.dashed
    x = float(re.match(r"M([\d.]+)", line.get("d", ""))[1])  # type: ignore[index]  # it begins so
    assert found.boxes["moving"][2] < x < found.boxes["watching"][0]


def test_an_end_state_has_two_borders() -> None:
    found = Picture(PATROL)
    ends = [rectangle(each) for each in found.root.iter(f"{SVG}rect") if each.get("class") == "end"]
    assert len(ends) == 3
    assert inside(ends[-1], found.boxes["off"])


def test_end_states_of_one_name_are_two_boxes_with_that_name() -> None:
    def part(name: str) -> State:
        return State(name, (State(f"{name}_begin"), State(f"{name}.done", final=True)), f"{name}_begin")

    picture = draw(StateMachine("m", (part("one"), part("two")), "one", (Transition("one_begin", "one.done"),)))
    assert picture.count(">done</text>") == 2
    assert "t_one_begin_to_done" in picture


def test_transitions_between_the_same_states_are_one_arrow() -> None:
    twice = (Transition("a", "b", ("go",)), Transition("a", "b", ("run",)))
    found = Picture(StateMachine("m", (State("a"), State("b")), "a", twice))
    assert "go, run" in found.texts
    assert found.fired == ["t_a_to_b"]


def test_texts_that_are_no_xml_are_escaped() -> None:
    found = Picture(StateMachine('<&">', (State("a"), State("b")), "a", (Transition("a", "b", ("<x>&y",)),)))
    assert found.root.find(f"{SVG}title").text == '<&">'  # type: ignore[union-attr]  # it is there
    assert "<x>&y" in found.texts


def test_the_same_machine_gives_the_same_picture() -> None:
    assert draw(PATROL) == draw(PATROL)


@settings(max_examples=60)
@given(machines())
def test_whatever_the_machine_states_are_inside_of_what_they_are_in_and_apart_from_others(
    machine: StateMachine,
) -> None:
    found = Picture(machine)
    x, y, width, height = map(float, found.root.get("viewBox", "").split())
    whole = (x, y, x + width, y + height)
    assert set(found.boxes) == {state.name for state in machine.every_state()}
    assert found.fired == sorted(machine.triggers())
    groups = [(whole, machine.states), *((found.boxes[each.name], each.states) for each in machine.every_state())]
    for around, states in groups:
        boxes = [found.boxes[state.name] for state in states]
        assert all(inside(box, around) for box in boxes)
        assert all(apart(one, other) for number, one in enumerate(boxes) for other in boxes[:number])


def test_boxes_come_below_those_that_lead_to_them() -> None:
    boxes = dict.fromkeys("abcd", Box(40, 20))
    found = layered(boxes, [Arrow("a", "b"), Arrow("b", "c"), Arrow("a", "c"), Arrow("c", "a"), Arrow("c", "d")])
    down = {name: y for name, (_, y) in found.corners.items()}
    assert down["a"] < down["b"] < down["c"] < down["d"]
    assert [route.up for route in found.routes] == [False, False, False, True, False]


def test_a_chain_is_drawn_straight() -> None:
    found = layered({"a": Box(40, 20), "b": Box(80, 20, beside=50)}, [Arrow("a", "b", (60, 10))])
    (ax, _), (bx, _) = found.corners["a"], found.corners["b"]
    assert abs((ax + 20) - (bx + 40)) < 0.5
    [(x, _)] = found.routes[0].points
    assert abs(x - (ax + 20)) < 0.5
