"""What may have been meant by a misspelt name."""

from pathlib import Path

import pytest

from robocomp_py.spelling import and_then, beside, closest


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


def test_a_similar_name_in_the_same_folder_is_proposed(tmp_path: Path) -> None:
    (tmp_path / "yard.xml").touch()
    (tmp_path / "yard").mkdir()
    assert beside(tmp_path / "yrad.xml") == tmp_path / "yard.xml"
    assert beside(tmp_path / "yrad") == tmp_path / "yard"
    assert beside(tmp_path / "yard.ddsl") is None
    assert beside(tmp_path / "nowhere" / "yard.xml") is None


def test_two_parts_of_a_message_are_joined() -> None:
    assert and_then("it is gone", "start it") == "it is gone; start it"
    assert and_then("did you mean `a`?", "start it") == "did you mean `a`? start it"
