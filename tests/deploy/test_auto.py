"""The best way for each link, by where its ends are and what they leave open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import pytest

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.qos import QoS, Reliability
from robocomp_py.deploy import auto, qos
from robocomp_py.deploy.auto import Choice, choose
from robocomp_py.deploy.routes import Configured
from robocomp_py.runtime import settings
from robocomp_py.testing import everything as e
from robocomp_py.transports.base import Capability

OFFERED = {
    "inproc": Capability.RELIABLE | Capability.LATCHED,
    "shm": Capability.CROSS_PROCESS,
    "zeromq": ~Capability.NONE,
    "dds": ~Capability.NONE,
}
RELIABLE = QoS(Reliability.RELIABLE)


@pytest.fixture(autouse=True)
def offered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Transports that are not opened; here `shm` is not reliable."""
    monkeypatch.setattr(qos, "find_transport", lambda name: SimpleNamespace(capabilities=OFFERED[name]))


SERVER = Component("server", (Port(Verb.IMPLEMENTS, e.EVERYTHING), Port(Verb.PUBLISHES, e.EVERYTHING)))
CLIENT = Component("client", (Port(Verb.REQUIRES, e.EVERYTHING),))
READER = Component("reader", (Port(Verb.SUBSCRIBES, e.EVERYTHING),))


def instance(component: Component, name: str, *sets: str, process: str = "", generated_for: str = "auto") -> Configured:
    document = settings.Document()
    for assignment in sets:
        settings.override(document, assignment)
    return Configured(name, component, settings.check(component, document, name), document, generated_for, process)


def fine(middleware: str, connections: int = 0) -> str:
    return ""


def over(choice: Choice, operation: str) -> list[tuple[str, str, str]]:
    """The client, provider and middleware of each link of an operation."""
    return [(way.client, way.provider, way.middleware) for way in choice.ways if way.operation == operation]


def lines(choice: Choice, name: str) -> list[str]:
    return list(choice.settings.get(name, ()))


def test_on_one_host_it_is_shared_memory() -> None:
    choice = choose([instance(SERVER, "server"), instance(CLIENT, "client")], fine)
    assert over(choice, "divide") == [("client", "server", "shm")]
    assert lines(choice, "client") == ["ports.everything.middleware=shm"]
    assert lines(choice, "server") == ['ports.Everything.also=["shm"]']
    assert choice.notes == ()


def test_in_one_process_it_is_objects() -> None:
    choice = choose([instance(SERVER, "server", process="p"), instance(CLIENT, "client", process="p")], fine)
    assert over(choice, "divide") == [("client", "server", "inproc")]
    assert lines(choice, "client") == ["ports.everything.middleware=inproc"]
    assert lines(choice, "server") == ['ports.Everything.also=["inproc"]']


def test_instances_with_different_process_names_share_no_process() -> None:
    choice = choose([instance(SERVER, "server", process="p"), instance(CLIENT, "client", process="q")], fine)
    assert over(choice, "divide") == [("client", "server", "shm")]


def test_a_publisher_offers_what_each_of_its_subscribers_needs() -> None:
    network = [
        instance(SERVER, "server", process="p"),
        instance(READER, "beside", process="p"),
        instance(READER, "away"),
        instance(READER, "elsewhere", "ports.Everything.middleware=dds"),
    ]
    choice = choose(network, fine)
    assert over(choice, "news") == [
        ("beside", "server", "inproc"),
        ("away", "server", "shm"),
        ("elsewhere", "server", "dds"),
    ]
    assert lines(choice, "server") == ['ports.everything.also=["inproc", "shm", "dds"]']
    assert [lines(choice, name) for name in ("beside", "away", "elsewhere")] == [
        ["ports.Everything.middleware=inproc"],
        ["ports.Everything.middleware=shm"],
        [],
    ]


def test_a_subscription_goes_its_own_way_to_each_publisher() -> None:
    network = [
        instance(READER, "reader", process="p"),
        instance(SERVER, "near", process="p"),
        instance(SERVER, "far"),
        instance(SERVER, "foreign", "ports.everything.middleware=dds"),
    ]
    choice = choose(network, fine)
    assert over(choice, "news") == [
        ("reader", "near", "inproc"),
        ("reader", "far", "shm"),
        ("reader", "foreign", "dds"),
    ]
    assert lines(choice, "reader") == [
        "ports.Everything.middleware=inproc",
        "ports.Everything.from=near",
        'ports.Everything.also=[{ from = "far", middleware = "shm" }, { from = "foreign", middleware = "dds" }]',
    ]
    checked = instance(READER, "reader", *lines(choice, "reader"))
    assert checked.settings.middlewares(READER.ports[0], "news", "zeromq") == ["inproc", "shm", "dds"]


def test_a_way_says_by_which_name_its_client_looks_for_the_channel() -> None:
    servers = [instance(SERVER, name, "middleware=zeromq") for name in ("a", "b")]
    anyone, one = instance(READER, "anyone"), instance(READER, "one", "ports.Everything.from=a")
    found = {(way.client, way.provider): way for way in choose([*servers, anyone, one], fine).ways}
    names = {ends: (way.channel.rpartition("/")[0], way.looked_up.rpartition("/")[0]) for ends, way in found.items()}
    assert names == {
        ("anyone", "a"): ("a/Everything", "*/Everything"),
        ("anyone", "b"): ("b/Everything", "*/Everything"),
        ("one", "a"): ("a/Everything", "a/Everything"),
    }
    servers[1] = instance(SERVER, "b", "middleware=dds")  # then there is a subscription for each
    assert {way.looked_up == way.channel for way in choose([*servers, anyone], fine).ways} == {True}


@pytest.mark.parametrize("named", ["client", "server"])
def test_an_end_that_names_a_middleware_decides_for_the_other(named: str) -> None:
    port = {"client": "everything", "server": "Everything"}
    sets = {name: (f"ports.{port[name]}.middleware=dds",) if name == named else () for name in port}
    choice = choose([instance(SERVER, "server", *sets["server"]), instance(CLIENT, "client", *sets["client"])], fine)
    assert over(choice, "divide") == [("client", "server", "dds")]
    assert "named" in choice.ways[0].why
    other = {"client": 'ports.Everything.also=["dds"]', "server": "ports.everything.middleware=dds"}
    assert [*lines(choice, "client"), *lines(choice, "server")] == [other[named]]


def test_one_operation_may_go_another_way() -> None:
    client = instance(CLIENT, "client", "ports.everything.divide.middleware=dds")
    choice = choose([instance(SERVER, "server"), client], fine)
    assert over(choice, "divide") == [("client", "server", "dds")]
    assert over(choice, "work") == [("client", "server", "shm")]
    assert 'ports.Everything.divide.also=["dds"]' in lines(choice, "server")
    assert 'ports.Everything.work.also=["shm"]' in lines(choice, "server")
    assert "ports.everything.work.middleware=shm" in lines(choice, "client")
    assert not any("divide" in line for line in lines(choice, "client"))


def network_without(usable: auto.Usable, sets: Sequence[str] = ()) -> Choice:
    return choose([instance(SERVER, "server", *sets), instance(CLIENT, "client")], usable)


def test_an_unusable_middleware_is_reported_once_with_its_replacement() -> None:
    choice = network_without(lambda name, connections=0: "no shared memory here" if name == "shm" else "")
    assert over(choice, "divide") == [("client", "server", "zeromq")]
    assert choice.settings == {}
    [note] = choice.notes
    count = len(choice.ways)
    assert note == f"shm is not used for {count} operations, which go over zeromq instead: no shared memory here"


def test_a_middleware_that_cannot_carry_all_connections_carries_none() -> None:
    """A connection is a client and its provider, however many operations it uses of it."""

    def for_two(middleware: str, connections: int = 0) -> str:
        return f"{connections} are too many" if middleware == "shm" and connections > 2 else ""

    network = [instance(SERVER, "server"), *(instance(CLIENT, name) for name in ("one", "two", "three"))]
    assert {way.middleware for way in choose(network[:3], for_two).ways} == {"shm"}
    choice = choose(network, for_two)
    assert {(way.middleware, way.why) for way in choice.ways} == {("zeromq", "no shm: 3 are too many")}
    apart = [network[0], *(replace(each, host="far") for each in network[1:])]
    assert {way.middleware for way in choose(apart, for_two).ways} == {"zeromq"}


def test_the_middleware_for_all_else_is_that_of_the_provider() -> None:
    def nothing(name: str, connections: int = 0) -> str:
        return "not here"

    assert over(network_without(nothing, ["middleware=auto(dds)"]), "divide") == [("client", "server", "dds")]
    served = instance(SERVER, "server", generated_for="dds")
    choice = choose([served, instance(CLIENT, "client")], nothing)
    assert over(choice, "divide") == [("client", "server", "dds")]
    assert lines(choice, "client") == ["ports.everything.middleware=dds"]


def test_what_does_not_keep_a_promise_of_the_qos_is_not_chosen() -> None:
    reader = Component("reader", (Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=RELIABLE),))
    server = Component("server", (Port(Verb.PUBLISHES, e.EVERYTHING, qos=RELIABLE),))
    choice = choose([instance(server, "server"), instance(reader, "reader")], fine)
    assert over(choice, "news") == [("reader", "server", "zeromq")]
    assert choice.notes == (
        "shm is not used for 1 operation, which goes over zeromq instead: it does not offer reliable or keep_all",
    )


def test_two_providers_of_what_is_required_are_left_to_the_check_of_the_wiring() -> None:
    both = [instance(SERVER, "a"), instance(SERVER, "b", "middleware=dds"), instance(CLIENT, "client")]
    assert lines(choose(both, fine), "client") == []


def test_a_network_without_links_has_nothing_to_choose() -> None:
    assert choose([instance(SERVER, "server")], fine) == Choice()


def program(component: Component, name: str, *sets: str, generated_for: str = "") -> Configured:
    return replace(instance(component, name, *sets, generated_for=generated_for), is_program=True)


def test_a_program_of_ones_own_is_heard_beside_others() -> None:
    choice = choose([instance(READER, "reader"), instance(SERVER, "server"), program(SERVER, "own")], fine)
    assert over(choice, "news") == [("reader", "server", "shm"), ("reader", "own", "zeromq")]
    assert lines(choice, "reader") == [
        "ports.Everything.middleware=shm",
        "ports.Everything.from=server",
        'ports.Everything.also=[{ from = "own", middleware = "zeromq" }]',
    ]
    assert "own" not in choice.settings


def test_a_program_of_ones_own_speaks_what_the_network_says_or_what_it_was_generated_for() -> None:
    for own in (program(READER, "own", "middleware=dds"), program(READER, "own", generated_for="dds")):
        choice = choose([instance(SERVER, "server"), own], fine)
        assert over(choice, "news") == [("own", "server", "dds")]
        assert lines(choice, "server") == ['ports.everything.also=["dds"]']


def test_configured_offers_are_kept() -> None:
    server = instance(SERVER, "server", 'ports.everything.also=["dds"]')
    choice = choose([server, instance(READER, "reader")], fine)
    assert lines(choice, "server") == ['ports.everything.also=["shm", "dds"]']
    assert lines(choose([server, instance(READER, "reader", "middleware=dds")], fine), "server") == []


def test_each_configured_publisher_gets_a_way() -> None:
    reader = instance(READER, "reader", "ports.Everything.from=near", 'ports.Everything.also=[{from="far"}, "dds"]')
    network = [replace(reader, process="p"), instance(SERVER, "near", process="p"), instance(SERVER, "far")]
    choice = choose(network, fine)
    assert over(choice, "news") == [("reader", "near", "inproc"), ("reader", "far", "shm")]
    assert lines(choice, "reader") == [
        "ports.Everything.middleware=inproc",
        'ports.Everything.also=[{ from = "far", middleware = "shm" }, { from = "near", middleware = "dds" }]',
    ]
    assert lines(choice, "far") == ['ports.everything.also=["shm"]']


def test_what_is_set_for_one_operation_does_not_hide_the_choice() -> None:
    server = instance(SERVER, "server", 'ports.everything.news.also=["dds"]')
    assert lines(choose([server, instance(READER, "reader")], fine), "server") == [
        'ports.everything.news.also=["shm", "dds"]'
    ]
