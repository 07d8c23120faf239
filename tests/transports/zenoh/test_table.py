"""What is known of other links does not depend on how many a hostile program announces, or in which names."""

from __future__ import annotations

import pytest

from robocomp_py.transports.zenoh import table
from robocomp_py.transports.zenoh.table import Table, Token

CHANNEL = "robot/arm/Arm/move"


def key(link: int, channel: str = CHANNEL, fingerprint: int = 7) -> str:
    return "rc_lv/0/" + Token("serves", "-", fingerprint, 4711, link, channel).key_expr()


def test_links_beyond_the_limit_are_ignored_and_logged_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(table, "MOST_OF_OPERATION", 100)
    noted = Table()
    assert sum(noted.update(key(link), there=True) for link in range(1000)) == 100
    assert len(noted.find("serves", CHANNEL)) == 100
    assert caplog.text.count("robot/arm/Arm/move: too many links are announced") == 1
    assert noted.update(key(1, "robot/arm/Arm/stop"), there=True)  # others have room
    assert noted.update(key(99), there=False)
    assert noted.update(key(1000), there=True)


def test_links_of_all_operations_together_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "MOST", 100)
    noted = Table()
    assert sum(noted.update(key(link, f"robot/arm/Arm/op{link}"), there=True) for link in range(1000)) == 100


def test_a_token_that_ends_in_the_name_of_another_link_ends_nothing() -> None:
    noted = Table()
    noted.update(key(5), there=True)
    (token,) = noted.find("serves", CHANNEL)
    noted.reach(token)
    assert not noted.update(key(5, fingerprint=8), there=False)
    assert noted.find("serves", CHANNEL)
    assert noted.update(key(5), there=False)
    assert not noted.find("serves", CHANNEL)
