"""What runs, from what is announced."""

from __future__ import annotations

from dataclasses import replace

import pytest

from robocomp_py.contract.interface import Pattern
from robocomp_py.testing import everything as e
from robocomp_py.tools.hosts import network_of_hosts, places
from robocomp_py.tools.network import Channel, End, Network
from robocomp_py.tools.posts import Post
from robocomp_py.tools.recording.session import way_of
from robocomp_py.transports.census import Told


def end(owner: str, role: str, channel: str, *, middleware: str = "near", pid: int = 1, traits: str = "") -> End:
    operation = e.news if role in ("publishes", "subscribes") else e.divide
    return End(middleware, Told(owner, pid, role, channel, operation.fingerprint, operation.text, traits))


ENDS = [
    end("world", "publishes", "world/Everything/news", traits="rl"),
    end("world", "publishes", "world/Everything/news", middleware="far", traits="rl"),
    end("world", "serves", "world/Everything/divide"),
    end("world", "serves", "world/CommonBehavior/getState"),
    end("eye", "subscribes", "*/Everything/news", pid=2),
    end("hand", "calls", "world/Everything/divide", pid=3),
    end("hand", "calls", "gone/Everything/divide", pid=3),
]


def test_components_are_listed_with_what_they_offer_and_use() -> None:
    eye, hand, world = Network(ENDS).components()
    assert (eye.owner, eye.pid, eye.offers, eye.uses) == ("eye", 2, [], ["Everything"])
    assert (hand.offers, hand.uses) == ([], ["Everything of world", "Everything of gone"])
    assert (world.offers, world.uses, world.middlewares) == (["Everything"], [], ["near", "far"])


def test_the_interfaces_of_the_framework_are_shown_if_asked_for() -> None:
    assert "world/CommonBehavior/getState" not in Network(ENDS).channels
    assert "world/CommonBehavior/getState" in Network(ENDS, own=True).channels


def test_an_instance_that_a_component_stands_for_is_named() -> None:
    (world,) = Network([end("world", "serves", "front/Everything/divide")]).components()
    assert world.offers == ["front/Everything"]


def test_components_of_one_name_in_two_namespaces_are_two() -> None:
    ends = [
        end("left/arm", "serves", "left/arm/Everything/divide", pid=4),
        end("right/arm", "serves", "right/arm/Everything/divide", pid=4),
        end("right/hand", "calls", "right/arm/Everything/divide", pid=5),
    ]
    assert [(each.owner, each.offers, each.uses) for each in Network(ends).components()] == [
        ("left/arm", ["Everything"], []),
        ("right/arm", ["Everything"], []),
        ("right/hand", [], ["Everything of right/arm"]),
    ]


POSTS = {host: Post(host, lambda: pytest.fail("no scout is needed")) for host in ("base", "arm")}


def published(middleware: str = "near", pid: int = 1, on: str = "", seen_by: str = "") -> End:
    """`world/Everything/news` of a process on a host, seen by the scout of one, or by this process."""
    told = end("world", "publishes", "world/Everything/news", pid=pid)
    return replace(told, middleware=middleware, host=on, via=POSTS[seen_by] if seen_by else None)


@pytest.mark.parametrize(
    ("ends", "ways"),
    [
        ([published(), published(on="base", seen_by="base")], ["over near", "over near of base"]),
        ([published(on=each, seen_by=each) for each in POSTS], ["over near of base", "over near of arm"]),
        ([published(pid=1), published(pid=2)], ["over near"]),
        ([published("near", pid=1), published("far", pid=2)], ["over near", "over far"]),
        ([published("near"), published("far")], ["over near"]),
        ([published("far", on="base"), published("near", on="base", seen_by="base")], ["over far"]),
        (
            [
                published("near", pid=1),
                published("far", pid=1),
                published("far", pid=1, on="base"),
                published("near", pid=1, on="base", seen_by="base"),
            ],
            ["over far"],
        ),
    ],
)
def test_a_topic_is_heard_by_as_few_subscriptions_as_hear_all_its_publishers(ends: list[End], ways: list[str]) -> None:
    assert [way_of(each) for each in Network(ends).topic("news").each_way()] == ways


def test_subscriptions_that_are_open_are_used_further() -> None:
    here, also = published("near", pid=1), published("far", pid=1)
    far = published("far", pid=1, on="base")

    def opened(each: Channel) -> bool:
        return way_of(each) == "over near"

    assert [way_of(each) for each in Network([here, also, far]).topic("news").each_way(opened)] == ["over far"]
    assert Network([here, also]).topic("news").each_way(opened) == []


def plan(address: str, **hosts: str) -> dict[str, object]:
    """Of a network that has its instances on these hosts."""
    return {
        "hosts": [{"name": each, "address": address} for each in dict.fromkeys(hosts.values())],
        "processes": [{"instances": [name], "host": host} for name, host in hosts.items()],
    }


def test_an_instance_that_networks_have_on_different_hosts_has_no_known_host() -> None:
    plans = {"one": plan("10.0.0.1", laser="left", arm="left"), "two": plan("10.0.0.2", laser="right")}
    assert places(plans) == {"arm": "left"}
    assert network_of_hosts(plans) == ({"left": "one", "right": "two"}, [])


def test_a_name_of_different_hosts_is_told() -> None:
    one, two = plan("10.0.0.1", laser="robot"), plan("10.0.0.2", laser="robot")
    assert network_of_hosts({"one": one, "two": one}) == ({"robot": "two"}, [])
    assert network_of_hosts({"one": one, "two": two}) == (
        {"robot": "two"},
        ["host robot of one is left out, because robot of two is another machine; look at it with --network one"],
    )


def test_a_whole_name_means_only_its_own_channel() -> None:
    network = Network([end(name, "serves", f"{name}/Everything/divide") for name in ("arm", "left/arm")])
    assert [each.name for each in network.named("arm/Everything/divide")] == ["arm/Everything/divide"]
    assert [each.name for each in network.named("Everything/divide")] == list(network.channels)


def test_what_an_unprintable_owner_tells_keeps_its_host() -> None:
    (one,) = Network([replace(end("a\nrm", "serves", "arm/Everything/divide"), host="base")]).components()
    assert (one.owner, one.host) == ("a rm", "base")


def test_commands_are_shown_if_asked_for() -> None:
    ends = [*ENDS, end("rc", "subscribes", "world/Everything/news", pid=9)]
    assert [each.owner for each in Network(ends).components()] == ["eye", "hand", "world"]
    assert [each.owner for each in Network(ends).components(tools=True)] == ["eye", "hand", "rc", "world"]


def test_a_component_that_is_called_as_commands_are_is_shown() -> None:
    ends = [end("rc", "subscribes", "*/Everything/news"), end("rc", "serves", "rc/CommonBehavior/getState")]
    assert [each.owner for each in Network(ends).components()] == ["rc"]


def test_a_channel_knows_its_ends_its_contract_and_its_qos() -> None:
    news = Network(ENDS).channels["world/Everything/news"]
    assert (news.pattern, news.instance, news.interface) == (Pattern.PUBLISH, "world", "Everything")
    assert [each.told.owner for each in news.providers] == ["world", "world"]
    assert [each.told.owner for each in news.users] == ["eye"], "it hears every instance"
    assert news.middlewares == ["near", "far"]
    assert news.operation.name == "news"
    assert news.qos.reliable
    assert news.qos.latched


@pytest.mark.parametrize(
    "name", ["world/Everything/news", "/world/Everything/news", "Everything/news", "news", "world/Everything"]
)
def test_a_part_of_a_name_is_enough(name: str) -> None:
    assert "world/Everything/news" in [each.name for each in Network(ENDS).named(name)]


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("Everythin", "`Everythin` is not there; did you mean `Everything`?"),
        ("wrld/Everything", "did you mean `world/Everything`?"),
        ("thing/news", "did you mean `Everything/news`?"),
        ("world/news", "did you mean `world/Everything/news`?"),
        ("elephant", "`rc list --channels` shows all"),
    ],
)
def test_a_name_that_is_not_there_is_refused_with_the_closest(name: str, hint: str) -> None:
    with pytest.raises(ValueError, match=r"is not there") as caught:
        Network(ENDS).named(name)
    assert hint in str(caught.value)


def test_a_topic_may_be_one_that_nothing_publishes_yet() -> None:
    network = Network(ENDS)
    assert network.topic("news").name == "world/Everything/news"
    phantom = network.topic("phantom/Everything/news")
    assert [each.told.owner for each in phantom.users] == ["eye"]
    assert phantom.operation.name == "news"
    with pytest.raises(ValueError, match="`divide` is no topic"):
        network.topic("divide")


@pytest.mark.parametrize(("role", "channel"), [("dances", "a/B/c"), ("serves", "c"), ("serves", "a/\n/c")])
def test_what_is_not_understood_is_left_out(role: str, channel: str) -> None:
    assert not Network([End("near", Told("x", 1, role, channel, 0, ""))]).components()


def test_a_contract_that_is_not_understood_is_no_reason_to_hide_a_channel() -> None:
    found = Network([End("near", Told("x", 1, "serves", "a/B/c", 0, "riddle"))])
    assert list(found.channels) == ["a/B/c"]
    with pytest.raises(ValueError, match=r"^the contract of a/B/c is not understood: "):
        _ = found.channels["a/B/c"].operation
