"""From the counters of all components: which messages are still under way."""

from __future__ import annotations

from robocomp_py.lockstep.balance import Balance
from robocomp_py.lockstep.RoboCompLockstep import Counter, Way

TOPIC = "world/LaserPub/push"


def balance(**counters: Counter) -> Balance:
    return Balance({name: [counter] for name, counter in counters.items()})


def under_way(balance: Balance, **numbers: int) -> list[str]:
    flows = balance.under_way({name: (number,) for name, number in numbers.items()})
    return [f"{flow.channel} to {', '.join(name for name, _ in flow.receivers)}" for flow in flows]


def test_each_subscriber_has_to_handle_each_publication() -> None:
    found = balance(
        world=Counter(Way.Publishes, [TOPIC]),
        eye=Counter(Way.Hears, [TOPIC]),
        ear=Counter(Way.Hears, ["*/LaserPub/push"]),
    )
    assert under_way(found, world=2, eye=2, ear=2) == []
    assert under_way(found, world=2, eye=1, ear=2) == [f"{TOPIC} to eye"]
    assert under_way(found, world=2, eye=2, ear=0) == ["*/LaserPub/push to ear"]


def test_a_subscriber_of_several_publishers_handles_the_messages_of_all() -> None:
    found = balance(
        left=Counter(Way.Publishes, ["left/LaserPub/push"]),
        right=Counter(Way.Publishes, ["right/LaserPub/push"]),
        eye=Counter(Way.Hears, ["left/LaserPub/push", "right/LaserPub/push"]),
    )
    assert under_way(found, left=2, right=3, eye=5) == []
    assert len(under_way(found, left=2, right=3, eye=4)) == 1


def test_what_was_published_is_under_way_also_when_the_publication_has_been_removed() -> None:
    left, right = Counter(Way.Publishes, ["left/LaserPub/push"]), Counter(Way.Publishes, ["right/LaserPub/push"])
    eye = [Counter(Way.Hears, ["*/LaserPub/push"])]
    before = Balance({"world": [left, right], "eye": eye})
    gone = Counter(Way.Publishes, [])
    found = Balance({"world": [left, gone, right], "eye": eye})  # removed, and added again
    found.take_over(before, {"world": (3, 3, 5), "eye": (4,)})
    assert found.under_way({"world": (3, 3, 5), "eye": (5,)})
    assert not found.under_way({"world": (3, 3, 5), "eye": (6,)})
    assert found.under_way({"world": (3, 3, 6), "eye": (6,)})


def test_messages_of_a_component_that_has_left_are_not_waited_for() -> None:
    eye = Counter(Way.Hears, [TOPIC])
    found = balance(eye=eye)
    found.take_over(balance(world=Counter(Way.Publishes, [TOPIC]), eye=eye), {"eye": (1,)})
    assert not found.ahead({"eye": (0,)})
    assert under_way(found, eye=1) == []


def test_a_component_does_not_wait_for_its_own_publications() -> None:
    own = [Counter(Way.Publishes, ["a/LaserPub/push"]), Counter(Way.Hears, ["*/LaserPub/push"])]
    assert Balance({"a": own}).under_way({"a": (3, 0)}) == []


def test_the_messages_of_other_topics_and_other_systems_do_not_count() -> None:
    found = balance(world=Counter(Way.Publishes, ["left/world/LaserPub/push"]), eye=Counter(Way.Hears, [TOPIC]))
    assert under_way(found, world=2, eye=0) == []


def test_a_command_without_a_chosen_server_may_be_handled_by_any() -> None:
    found = balance(
        client=Counter(Way.Sends, ["*/Speech/say"]),
        first=Counter(Way.Takes, ["first/Speech/say"]),
        second=Counter(Way.Takes, ["second/Speech/say"]),
    )
    assert under_way(found, client=3, first=1, second=2) == []
    assert under_way(found, client=3, first=1, second=1) == ["Speech/say to first, second"]


def test_a_call_is_not_under_way_while_its_server_executes_it() -> None:
    found = balance(client=Counter(Way.Calls, ["s/Speech/say"]), s=Counter(Way.Serves, ["s/Speech/say"]))
    assert under_way(found, client=1, s=1) == []
    assert under_way(found, client=1, s=0) == ["Speech/say to s"]
    assert under_way(found, client=0, s=1) == [], "the client gave up"


def test_what_was_sent_before_a_subscriber_was_there_is_not_under_way() -> None:
    found = balance(world=Counter(Way.Publishes, [TOPIC]), eye=Counter(Way.Hears, [TOPIC]))
    found.level({"world": (10,), "eye": (0,)}, all=True)
    assert under_way(found, world=10, eye=0) == []
    assert under_way(found, world=11, eye=0) == [f"{TOPIC} to eye"]


def test_more_handled_than_sent_is_no_credit_for_later() -> None:
    """A latched message reaches a late subscriber, for example."""
    found = balance(world=Counter(Way.Publishes, [TOPIC]), eye=Counter(Way.Hears, [TOPIC]))
    found.level({"world": (10,), "eye": (0,)}, all=True)
    found.level({"world": (10,), "eye": (1,)})
    assert under_way(found, world=11, eye=1) == [f"{TOPIC} to eye"]
