"""Those that require something of others start after them, and stop before them."""

from __future__ import annotations

import os
import subprocess
import sys

from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.deploy.events import Exited, Ready, Start, Stop, StopRequested
from robocomp_py.deploy.ordering import Order, ordered
from robocomp_py.deploy.policy import Child, State, Supervisor


def test_without_circles_everything_is_in_order() -> None:
    needs = {("rescue", "wander"): 2, ("wander", "world"): 5}
    assert ordered(["rescue", "wander", "world"], {}, needs) == Order(
        {"rescue": ("wander",), "wander": ("world",)}, {"rescue": ("wander",), "wander": ("world",)}, (), ()
    )


def test_a_circle_starts_together_and_is_broken_where_the_fewest_operations_lose_their_provider() -> None:
    needs = {("a", "b"): 7, ("b", "c"): 1, ("c", "a"): 3, ("d", "a"): 1}
    found = ordered("abcd", {}, needs)
    assert found.circles == (("a", "b", "c"),)
    assert found.ready_after == {"d": ("a",)}
    assert found.broken == (("b", "c"),)
    assert found.stops_before == {"a": ("b",), "c": ("a",), "d": ("a",)}


def test_equal_circles_are_broken_the_same_way_in_every_run() -> None:
    code = (
        "from robocomp_py.deploy.ordering import ordered\n"
        "names = ['north', 'east', 'south', 'west']\n"
        "print(ordered(names, {}, {(a, b): 1 for a in names for b in names if a != b}).broken)"
    )
    seeds = [{**os.environ, "PYTHONHASHSEED": str(seed)} for seed in range(4)]
    assert len({subprocess.check_output([sys.executable, "-c", code], env=seed) for seed in seeds}) == 1


def test_what_the_network_says_is_never_broken() -> None:
    found = ordered("ab", {"a": ["b"]}, {("b", "a"): 9})
    assert (found.broken, found.stops_before, found.ready_after) == ((("b", "a"),), {}, {})


_EDGES = st.dictionaries(
    st.tuples(st.sampled_from("abcdef"), st.sampled_from("abcdef")), st.integers(1, 9), max_size=14
)


@given(_EDGES)
def test_every_network_comes_up_and_ends(edges: dict[tuple[str, str], int]) -> None:
    """Histories of a whole life: everything starts and ends, and nothing stops while a client that it outlives runs."""
    needs = {edge: weight for edge, weight in edges.items() if edge[0] != edge[1]}
    order = ordered("abcdef", {}, needs)
    assert set(order.broken) <= {e for e in needs if any(set(e) <= set(circle) for circle in order.circles)}
    children = [
        Child(name, ready_after=order.ready_after.get(name, ()), stops_before=order.stops_before.get(name, ()))
        for name in "abcdef"
    ]
    supervisor = Supervisor(children)
    actions = supervisor.begin()
    ready: list[str] = []
    while actions:
        started = [each.name for each in actions if isinstance(each, Start)]
        for name in started:
            assert set(order.ready_after.get(name, ())) <= set(ready)
        actions = []
        for name in started:
            ready.append(name)
            actions += supervisor.handle(Ready(name))
    assert supervisor.up
    stopping = supervisor.handle(StopRequested())
    while told := [each.name for each in stopping if isinstance(each, Stop)]:
        stopping = []
        for name in told:
            clients = [edge[0] for edge in needs if edge[1] == name and edge not in order.broken]
            assert all(supervisor.states[client].gone for client in clients)
            stopping += supervisor.handle(Exited(name, 0))
    assert set(supervisor.states.values()) == {State.ENDED}


def test_a_client_does_not_wait_for_a_provider_that_is_gone_for_good() -> None:
    supervisor = Supervisor([Child("server"), Child("client", ready_after=("server",), stops_before=("server",))])
    assert supervisor.begin() == [Start("server")]
    assert supervisor.awaited("client") == ["server"]
    assert supervisor.handle(Ready("server")) == [Start("client")]
    supervisor.handle(Ready("client"))
    supervisor.handle(Exited("server", 1))
    assert supervisor.awaited("client") == []
