from __future__ import annotations

import math

import numpy as np
import pytest
from camera.view import House, Lens, Pixels, Things, read_house, render
from rescue.vision import NOTHING, Blob, find_red, pixels_of

from .conftest import COMPONENTS

LENS = Lens(160, 120, math.radians(70))
GREY = (200, 200, 200)


def house(*edges: tuple[float, float, float, float], height_m: float = 2.4, victim: tuple[float, float]) -> House:
    walls = Things(height_m, GREY, np.array(edges, dtype=float).reshape(-1, 4), np.empty((0, 3)))
    return House((walls,), victim)


def seen(house: House, x: float = 0.0, z: float = 0.0, heading: float = 0.0) -> Pixels:
    return render(house, LENS, x, z, heading)


def test_a_picture_has_the_size_of_its_lens() -> None:
    pixels = seen(house(victim=(0.0, 3.0)))
    assert pixels.shape == (120, 160, 3)
    assert pixels.dtype == np.uint8


def test_the_victim_is_red_and_stands_where_it_is() -> None:
    left, right = (seen(house(victim=(x, 3.0))) for x in (-1.0, 1.0))
    assert find_red(left[:, :80]).area > 100
    assert find_red(left[:, 80:]) == NOTHING
    assert find_red(right[:, 80:]).area == find_red(left).area


def test_the_victim_looks_half_as_tall_from_twice_as_far() -> None:
    near, far = (find_red(seen(house(victim=(0.0, z)))).height for z in (3.0, 6.0))
    assert near / 2 == pytest.approx(far, abs=2)


def test_the_victim_is_not_seen_from_behind_a_wall() -> None:
    assert find_red(seen(house((-9, 2, 9, 2), victim=(0.0, 3.0)))) == NOTHING
    assert find_red(seen(house((-9, 4, 9, 4), victim=(0.0, 3.0)))).area > 100


def test_low_furniture_hides_only_the_lower_part() -> None:
    whole = find_red(seen(house(victim=(0.0, 4.0))))
    part = find_red(seen(house((-9, 2, 9, 2), height_m=0.5, victim=(0.0, 4.0))))
    assert 0 < part.height < whole.height


def test_the_victim_is_not_seen_behind_ones_back() -> None:
    assert find_red(seen(house(victim=(0.0, 3.0)), heading=math.pi)) == NOTHING


def test_nearer_walls_are_taller_and_brighter() -> None:
    near, far = (seen(house((-9, z, 9, z), victim=(0.0, -5.0))) for z in (3.0, 6.0))
    middle = near[60, 80], far[60, 80]
    assert middle[0].sum() > middle[1].sum()
    assert (near[:, 80] == near[60, 80]).all(axis=1).sum() > (far[:, 80] == far[60, 80]).all(axis=1).sum()


def test_the_view_turns_with_the_robot() -> None:
    shown = house(victim=(3.0, 0.0))
    assert find_red(seen(shown)) == NOTHING
    assert find_red(seen(shown, heading=math.pi / 2)).area > 100


@pytest.mark.parametrize(("x", "z", "heading"), [(0.6, 4.2, 0.0), (6.0, 1.0, 1.2), (6.5, 7.5, -2.0), (11.5, 7.5, 3.9)])
def test_nothing_else_in_the_shipped_house_is_red(x: float, z: float, heading: float) -> None:
    shown = read_house(COMPONENTS / "house.toml")
    without_victim = House(shown.things, (-100.0, -100.0))
    assert find_red(render(without_victim, LENS, x, z, heading)) == NOTHING


def test_red_is_measured_from_its_first_row_and_column_to_its_last() -> None:
    pixels = np.full((30, 40, 3), 128, np.uint8)
    pixels[5:15, 10:30] = (200, 30, 30)
    pixels[7, 12] = (128, 128, 128)
    assert find_red(pixels) == Blob(area=199, height=10, width=20)


@pytest.mark.parametrize("colour", [(255, 255, 255), (0, 0, 0), (90, 0, 0), (200, 150, 60), (0, 200, 0)])
def test_other_colours_are_not_red(colour: tuple[int, int, int]) -> None:
    assert find_red(np.full((4, 4, 3), colour, np.uint8)) == NOTHING


def test_pixels_come_row_after_row() -> None:
    pixels = pixels_of(np.arange(2 * 3 * 3), width=3, height=2)
    assert pixels[1, 0].tolist() == [9, 10, 11]
