from __future__ import annotations

from xml.etree import ElementTree

from world2d.picture import Story, battery_colour, draw
from world2d.robot import Pose
from world2d.room import read_room

from .conftest import COMPONENTS

HOUSE = read_room(COMPONENTS / "house.toml")


def story_of(*places: tuple[float, float]) -> Story:
    story = Story()
    for x, z in places:
        story.note(1.0, Pose(x, z, 0.0), 80.0, [(x, z + 1), (x + 1, z)])
    return story


def words_of(svg: str) -> str:
    return " ".join(ElementTree.fromstring(svg).itertext())


def test_the_picture_is_well_formed_and_says_how_far_it_went() -> None:
    svg = draw(HOUSE, story_of((1.0, 1.0), (1.0, 3.0), (2.0, 3.0)))
    assert "3.0 m driven in 3 s" in words_of(svg)


def test_there_is_a_picture_of_nothing() -> None:
    assert "0.0 m driven in 0 s" in words_of(draw(HOUSE, Story()))


def test_places_are_named() -> None:
    words = words_of(draw(HOUSE, story_of((1.0, 1.0), (1.0, 3.0))))
    assert {"start", "victim"} <= set(words.split())
    assert "charging station" in words


def test_the_way_has_a_mark_every_ten_seconds() -> None:
    words = words_of(draw(HOUSE, story_of(*((1.0, 1.0 + 0.1 * number) for number in range(25)))))
    assert "10 s" in words
    assert "20 s" in words
    assert "30 s" not in words


def test_the_colour_goes_from_red_over_amber_to_green() -> None:
    assert [battery_colour(percent) for percent in (0, 50, 100)] == ["#d64541", "#f0b429", "#1f9d55"]


def test_what_is_remembered_is_bounded() -> None:
    story = Story()
    for number in range(20_500):
        story.note(0.05, Pose(number % 7, 0.0, 0.0), 50.0, [])
    assert len(story.moments) == 20_000
    assert len(story.views) == 1_000
