"""What may have been meant by a misspelt name."""

import pytest

from robocomp_py.spelling import closest


@pytest.mark.parametrize(
    ("given", "known", "meant"),
    [
        ("stauts", ["start", "status"], "status"),
        ("stat", ["start", "status"], "status"),
        ("Laser", ["LaserPubTopic"], ""),
        ("laser", ["Laser", "LaserPub"], "Laser"),
        ("fly", ["walk", "swim"], ""),
    ],
)
def test_the_closest_name_is_proposed(given: str, known: list[str], meant: str) -> None:
    assert closest(given, known) == meant
