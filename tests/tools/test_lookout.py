"""Looks at running components: what is there, what it counts, and what does not answer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any

import pytest

from robocomp_py.errors import ConfigurationError
from robocomp_py.runtime.RoboCompIntrospection import Description, Measures
from robocomp_py.testing.patience import wait_until
from robocomp_py.tools import asking
from robocomp_py.tools.access import Access
from robocomp_py.tools.census import take_each
from robocomp_py.tools.drift import Presence
from robocomp_py.tools.lookout import Look, Lookout, Rounds
from robocomp_py.tools.network import Network
from robocomp_py.transports.base import find_transport

from ..runtime.components import Calculator
from ..runtime.running import make, running
from .facts import plan, way
from .test_top import Asking

PLAN = plan(way("pupil", "calculator", "desk/calculator/Everything/divide", middleware="shm")) | {
    "processes": [{"instances": [name], "host": ""} for name in ("calculator", "pupil")],
    "ours": {name: {"channels": f"desk/{name}", "over": ["shm"]} for name in ("calculator", "pupil")},
}


@pytest.fixture
def access() -> Iterator[Access]:
    with Access() as made:
        yield made


def comes(lookout: Lookout, is_it: Any) -> Look:
    """The first look of this kind."""
    found: list[Look] = []

    def looked() -> bool:
        found.append(lookout.look())
        return bool(is_it(found[-1]))

    wait_until(looked)
    return found[-1]


def test_what_runs_is_compared_and_measured_until_it_ends(access: Access) -> None:
    lookout = Lookout(access, lambda: PLAN, partial(take_each, ["shm"]))
    over = ("middleware=shm", "namespace=desk")
    with ExitStack() as ends:
        ends.enter_context(running(make(Calculator, find_transport, *over)))
        with running(make(Asking, find_transport, *over, name="pupil")):
            look = comes(lookout, lambda it: any(each.rate > 0 for each in it.flows.values()))
            (use,) = look.drift.uses
            assert use.presence is Presence.PRESENT
            assert 0 < look.flows[use].p50 <= look.flows[use].p99
            assert {each.now.state for each in look.told.values()} == {"compute"}
            assert not look.silent
            assert look.troubles == ()
            ends.close()
            look = comes(lookout, lambda it: it.drift.presence_of("calculator") is Presence.MISSING)
            assert look.drift.presence_of("pupil") is Presence.PRESENT
            assert look.drift.uses[0].presence is Presence.MISSING


def test_without_a_plan_everything_that_runs_is_there(access: Access) -> None:
    with running(make(Calculator, find_transport, "middleware=shm")):
        look = comes(Lookout(access, lambda: None, partial(take_each, ["shm"])), lambda it: it.told)
    assert [(each.name, each.presence) for each in look.drift.instances] == [("calculator", Presence.PRESENT)]


def test_a_plan_of_another_version_is_an_error(access: Access) -> None:
    with pytest.raises(ConfigurationError, match="is of another version"):
        Lookout(access, lambda: {"name": 1}, partial(take_each, ["shm"])).look()


def test_components_that_did_not_answer_are_asked_a_few_at_a_time(
    monkeypatch: pytest.MonkeyPatch, access: Access
) -> None:
    asked: list[list[str]] = []
    answering = {"a", "b"}

    def measured(_: Access, __: Network, names: Sequence[str], patience: float) -> dict[str, Measures]:
        asked.append(list(names))
        return {name: Measures() for name in names if name in answering}

    monkeypatch.setattr(asking, "measure_all", measured)
    monkeypatch.setattr(asking, "describe", lambda *_: Description())
    monkeypatch.setattr(asking, "AT_ONCE", 2)
    rounds = Rounds(access)

    def ask() -> list[str]:
        return list(rounds.ask(Network([]), ["a", "b", "c", "d", "e"], 1.0))

    assert [ask(), ask(), ask(), ask()] == [["a", "b"]] * 4
    assert asked == [["a", "b", "c", "d", "e"], ["a", "b", "c", "d"], ["a", "b", "e", "c"], ["a", "b", "d", "e"]]
    answering.add("c")
    assert ask() == ["a", "b", "c"]
    assert asked[-1] == ["a", "b", "c", "d"]
