"""A census asks all middlewares before it waits for any of them."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import pytest

from robocomp_py.errors import TransportError
from robocomp_py.tools.census import take_census, take_each

SLOW = """
from contextlib import contextmanager

from robocomp_py.errors import TransportError
from robocomp_py.transports.census import Told
from robocomp_py.transports.deployment import Deployment

events = []


class Slow(Deployment):
    @contextmanager
    def asking(self, options):
        events.append("open")

        def heard():
            if options.get("broken"):
                raise TransportError("no answer")
            events.append("heard")
            return [Told("lamp", 1, "serves", "lamp/Lamp/light", 0, "")]

        try:
            yield heard
        finally:
            events.append("closed")
"""


@pytest.fixture
def events(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What happens to two middlewares that have to wait."""
    information = tmp_path / "slow-1.dist-info"
    information.mkdir()
    groups = ("robocomp_py.transports", "robocomp_py.deployments")
    names = "".join(f"{name} = slow_of_test:Slow\n" for name in ("slow", "slower"))
    (information / "entry_points.txt").write_text("".join(f"[{group}]\n{names}" for group in groups))
    (tmp_path / "slow_of_test.py").write_text(SLOW)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "slow_of_test", raising=False)
    found: list[str] = import_module("slow_of_test").events
    return found


def test_other_work_is_done_while_middlewares_wait(events: list[str]) -> None:
    network = take_census(["slow", "slower"], meanwhile=lambda: events.append("work"))
    assert events == ["open", "open", "work", "heard", "heard", "closed", "closed"]
    assert list(network.channels) == ["lamp/Lamp/light"]


def test_what_was_opened_is_closed_if_a_middleware_fails(events: list[str]) -> None:
    with pytest.raises(TransportError, match="slow: no answer"):
        take_census(["slow", "slower"], options={"slow": {"broken": True}})
    assert events == ["open", "open", "closed", "closed"]


def test_a_middleware_that_fails_leaves_the_others(events: list[str]) -> None:
    seen = take_each(["slow", "slower"], {"slow": {"broken": True}})
    assert seen.troubles == ["slow: no answer"]
    assert [each.middleware for each in seen.ends] == ["slower"]
    assert events == ["open", "closed", "open", "heard", "closed"]
